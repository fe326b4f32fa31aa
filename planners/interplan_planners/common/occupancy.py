"""Who is where on a path, and when: the stretches of it that boxes occupy, at each instant of a forecast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.forecast import Forecast
from interplan_planners.common.paths import DrivingPath
from interplan_sumo.world.geometry import Floats, Ints

_CAR_RADIUS_M = 3.0
_SHARPEST_BEND_M = 5.0


def _around(points: int) -> tuple[Floats, Floats]:
    """Places around a box of size 1: so many along either long side, so that long boxes follow bends."""
    side = np.linspace(0.5, -0.5, points)
    return np.concatenate((side, side[::-1])), np.repeat((0.5, -0.5), points)


_AROUND_CAR, _AROUND_LONG = _around(3), _around(7)


@dataclass(frozen=True, eq=False)
class StripOccupancy:
    """What B actors occupy of a strip along a path at K + 1 instants, as arc lengths of the path."""

    rows: Ints  # (B,) rows of the forecast
    near_m: Floats  # (B, K + 1) where it begins; inf where the actor is not in the strip
    far_m: Floats  # (B, K + 1) where it ends; -inf where the actor is not in the strip
    center_m: Floats  # (B, K + 1) of the box centre; nan where the actor is not in the strip
    speed_mps: Floats  # (B, K + 1) along the path, negative if oncoming; 0 where the actor is not in the strip


def occupancy(
    path: DrivingPath,
    half_width_m: float,
    forecast: Forecast,
    between_m: tuple[float, float],
    ignore: NDArray[np.bool_] | None = None,
) -> StripOccupancy:
    """The actors that reach into the strip of `half_width_m` on both sides of a stretch of the path, at any instant.

    `ignore` (A,) leaves actors out.
    """
    standing = forecast.stands
    looked = np.zeros(forecast.x_m.shape, dtype=np.bool_)
    looked[:, 0] = _ever_near(path, half_width_m, forecast, between_m)
    if ignore is not None:
        looked[ignore] = False
    looked[~standing] = looked[~standing, :1]
    actor, instant = np.nonzero(looked)
    vertices, away_m = path.nearest_vertices(forecast.x_m[actor, instant], forecast.y_m[actor, instant], between_m)
    # the nearest vertex looked at may be half a stride further than the nearest point
    close = np.flatnonzero(away_m <= forecast.radius_m[actor] + half_width_m + 0.5 * path.coarse_m)
    actor, instant = actor[close], instant[close]
    center, off_m, segments = path.project_near(
        forecast.x_m[actor, instant], forecast.y_m[actor, instant], vertices[close]
    )
    heading = forecast.heading_rad[actor, instant]
    path_cos, path_sin = path.unit[:, segments]
    cos, sin = np.cos(heading), np.sin(heading)
    length, width = forecast.length_m[actor], forecast.width_m[actor]
    # a straight path would be reached by this much of the box, a bent one by some more
    reach_m = 0.5 * (width * np.abs(cos * path_cos + sin * path_sin) + length * np.abs(sin * path_cos - cos * path_sin))
    close = np.flatnonzero(np.abs(off_m) <= half_width_m + reach_m + length * length / (8.0 * _SHARPEST_BEND_M))
    actor, instant, center = actor[close], instant[close], center[close]
    near, far = _stretches(path, half_width_m, forecast, actor, instant, segments[close])

    inside = np.flatnonzero((near <= far) & (far > between_m[0]) & (near < between_m[1]))
    instant, center = instant[inside], center[inside]
    rows, place = np.unique(actor[inside], return_inverse=True)
    lane_heading = np.interp(center, path.line.arc_m, path.line.vertex_heading_rad)
    speed = forecast.speed_mps[rows[place], instant] * np.cos(heading[close][inside] - lane_heading)

    def table(values: Floats, nobody: float) -> Floats:
        column = np.full((len(rows), forecast.instants), nobody)
        column[place, instant] = values
        column[standing[rows]] = column[standing[rows], :1]
        return column

    return StripOccupancy(
        rows, table(near[inside], np.inf), table(far[inside], -np.inf), table(center, np.nan), table(speed, 0.0)
    )


def _ever_near(
    path: DrivingPath, half_width_m: float, forecast: Forecast, between_m: tuple[float, float]
) -> NDArray[np.bool_]:
    """(A,) whether the circle around all boxes of an actor comes near the stretch; if not, it is never in the strip."""
    middle = forecast.instants // 2
    x_m, y_m = forecast.x_m[:, middle], forecast.y_m[:, middle]
    roams_m = np.hypot(forecast.x_m - x_m[:, None], forecast.y_m - y_m[:, None]).max(axis=1)
    _, away_m = path.nearest_vertices(x_m, y_m, between_m)
    return away_m <= roams_m + forecast.radius_m + half_width_m + 0.5 * path.coarse_m


def _stretches(
    path: DrivingPath, half_width_m: float, forecast: Forecast, actor: Ints, instant: Ints, segments: Ints
) -> tuple[Floats, Floats]:
    """Where boxes (M,) begin and end to occupy the strip; their centres project on `segments`."""
    heading = forecast.heading_rad[actor, instant]
    cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
    near, far = np.full(len(actor), np.inf), np.full(len(actor), -np.inf)
    long = forecast.radius_m[actor] > _CAR_RADIUS_M
    # few are long, and need more points and a wider search
    for group, (along, across) in ((np.flatnonzero(~long), _AROUND_CAR), (np.flatnonzero(long), _AROUND_LONG)):
        if group.size:
            members = actor[group]
            ahead, left = forecast.length_m[members, None] * along, forecast.width_m[members, None] * across
            x_m = forecast.x_m[members, instant[group]][:, None] + cos[group] * ahead - sin[group] * left
            y_m = forecast.y_m[members, instant[group]][:, None] + sin[group] * ahead + cos[group] * left
            span = int(np.ceil(forecast.radius_m[members].max() / path.fine_m)) + 1
            s_m, d_m, _ = path.project_near(x_m, y_m, segments[group], span)
            near[group], far[group] = _clipped(s_m, d_m, half_width_m)
    return near, far


def _clipped(s_m: Floats, d_m: Floats, half_width_m: float) -> tuple[Floats, Floats]:
    """Least and largest arc length (M,) of polygons (M, P) in path coordinates within the strip; inf, -inf if none."""
    ds, dd = np.roll(s_m, -1, axis=1) - s_m, np.roll(d_m, -1, axis=1) - d_m
    dd = np.where(np.abs(dd) < 1e-9, 1e-9, dd)
    one, other = (-half_width_m - d_m) / dd, (half_width_m - d_m) / dd
    enters, leaves = np.maximum(np.minimum(one, other), 0.0), np.minimum(np.maximum(one, other), 1.0)
    crosses = enters <= leaves
    ends = s_m + enters * ds, s_m + leaves * ds
    near = np.where(crosses, np.minimum(*ends), np.inf).min(axis=1)
    far = np.where(crosses, np.maximum(*ends), -np.inf).max(axis=1)
    return near, far
