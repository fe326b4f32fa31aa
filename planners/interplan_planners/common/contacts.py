"""Which of many ego boxes touch which of many forecast boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from interplan_planners.common.forecast import Forecast
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, Ints


@dataclass(frozen=True, eq=False)
class Contacts:
    """Pairs of a pose and an actor whose boxes touch, in order of the poses' indices, then of the actors' rows."""

    pose: Ints  # (C,) index into the poses, raveled
    actor: Ints  # (C,) row of the forecast


def contacts(
    x_m: Floats,
    y_m: Floats,
    heading_rad: Floats,
    ahead_s: ArrayLike,
    forecast: Forecast,
    shape: EgoShape,
    ignore: NDArray[np.bool_] | None = None,
) -> Contacts:
    """Contacts of ego boxes, centres (M, T), at times from now (T,), with the forecast; touching edges count.

    `ignore` (A,) leaves actors out.
    """
    instants = forecast.instant(ahead_s)
    ego_radius_m = 0.5 * float(np.hypot(shape.length_m, shape.width_m))
    kept = np.arange(len(forecast)) if ignore is None else np.flatnonzero(~ignore)
    reach_m = (forecast.radius_m[kept] + ego_radius_m)[None, :]
    other_x, other_y = forecast.x_m[kept][:, instants].T, forecast.y_m[kept][:, instants].T  # (T, B)
    # whom none of the boxes of one time is near, seen from the rectangle around them all, needs no closer look
    near = (other_x > x_m.min(axis=0)[:, None] - reach_m) & (other_x < x_m.max(axis=0)[:, None] + reach_m)
    near &= (other_y > y_m.min(axis=0)[:, None] - reach_m) & (other_y < y_m.max(axis=0)[:, None] + reach_m)
    when, who = np.nonzero(near)
    off_x = other_x[when, who] - x_m[:, when]  # (M, pairs of a time and an actor)
    off_y = other_y[when, who] - y_m[:, when]
    reach_m = reach_m[0, who]
    close = np.flatnonzero(off_x * off_x + off_y * off_y <= reach_m * reach_m)
    if not close.size:
        return Contacts(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    drive, pair = np.divmod(close, len(when))
    pose, actor = drive * x_m.shape[1] + when[pair], kept[who[pair]]
    touching = boxes_touch(
        off_x.ravel()[close], off_y.ravel()[close], heading_rad.ravel()[pose],
        forecast.heading_rad[actor, instants[when[pair]]],
        shape.length_m, shape.width_m, forecast.length_m[actor], forecast.width_m[actor],
    )  # fmt: skip
    return Contacts(pose[touching], actor[touching])


def touched_now(ego: EgoState, forecast: Forecast, shape: EgoShape) -> NDArray[np.bool_]:
    """(A,) whether an actor's box touches the ego's at the first instant; PDM leaves such actors out of account."""
    x_m, y_m = forecast.x_m[:, 0] - ego.x_m, forecast.y_m[:, 0] - ego.y_m
    heading = np.full(len(forecast), ego.heading_rad)
    sizes = (shape.length_m, shape.width_m, forecast.length_m, forecast.width_m)
    return boxes_touch(x_m, y_m, heading, forecast.heading_rad[:, 0], *sizes)


def boxes_touch(
    off_x_m: Floats,
    off_y_m: Floats,
    heading_rad: Floats,
    other_heading_rad: Floats,
    length_m: ArrayLike,
    width_m: ArrayLike,
    other_length_m: ArrayLike,
    other_width_m: ArrayLike,
) -> NDArray[np.bool_]:
    """(C,) whether pairs of boxes touch, given the way from one centre to the other: no axis separates them."""
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    other_cos, other_sin = np.cos(other_heading_rad), np.sin(other_heading_rad)
    same, across = np.abs(cos * other_cos + sin * other_sin), np.abs(cos * other_sin - sin * other_cos)
    half_l, half_w = 0.5 * np.asarray(length_m), 0.5 * np.asarray(width_m)
    other_l, other_w = 0.5 * np.asarray(other_length_m), 0.5 * np.asarray(other_width_m)
    return (
        (np.abs(off_x_m * cos + off_y_m * sin) <= half_l + same * other_l + across * other_w)
        & (np.abs(off_y_m * cos - off_x_m * sin) <= half_w + across * other_l + same * other_w)
        & (np.abs(off_x_m * other_cos + off_y_m * other_sin) <= other_l + same * half_l + across * half_w)
        & (np.abs(off_y_m * other_cos - off_x_m * other_sin) <= other_w + across * half_l + same * half_w)
    )
