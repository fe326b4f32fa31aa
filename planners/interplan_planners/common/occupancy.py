"""Who is where on a path, and when: the stretches of it that boxes occupy, at each instant of a forecast."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.forecast import Forecast
from interplan_planners.common.paths import DrivingPath, PathBundle
from interplan_sumo.world.geometry import Floats, Ints

_CAR_RADIUS_M = 3.0
_SHARPEST_BEND_M = 5.0


def _around(points: int) -> tuple[Floats, Floats]:
    """Places (2 N, 1) around a box of size 1: so many along either long side, so that long boxes follow bends."""
    side = np.linspace(0.5, -0.5, points)
    return np.concatenate((side, side[::-1]))[:, None], np.repeat((0.5, -0.5), points)[:, None]


_AROUND_CAR, _AROUND_LONG = _around(3), _around(7)


@dataclass(frozen=True, eq=False)
class StripOccupancy:
    """What B actors occupy of a strip along a path at K + 1 instants, as arc lengths of the path."""

    rows: Ints  # (B,) rows of the forecast
    near_m: Floats  # (B, K + 1) where it begins; inf where the actor is not in the strip
    far_m: Floats  # (B, K + 1) where it ends; -inf where the actor is not in the strip
    center_m: Floats  # (B, K + 1) of the box centre; nan where the actor is not in the strip
    speed_mps: Floats  # (B, K + 1) along the path, negative if oncoming; 0 where the actor is not in the strip


@dataclass(frozen=True, eq=False)
class Strip:
    """A stretch of a path with `half_width_m` on both sides."""

    path: DrivingPath
    half_width_m: float
    between_m: tuple[float, float]
    ignore: NDArray[np.bool_] | None = None  # (A,) actors that are left out


def occupancy(
    path: DrivingPath,
    half_width_m: float,
    forecast: Forecast,
    between_m: tuple[float, float],
    ignore: NDArray[np.bool_] | None = None,
) -> StripOccupancy:
    """The actors that reach into one strip at any instant."""
    return occupancies([Strip(path, half_width_m, between_m, ignore)], forecast)[0]


def occupancies(strips: Sequence[Strip], forecast: Forecast) -> list[StripOccupancy]:
    """The actors that reach into each of P strips at any instant; quicker than asking about one after the other."""
    paths = tuple(strip.path for strip in strips)
    bundle = paths[0].bundle if len(paths) == 1 else _bundle(paths)
    half_width_m = np.array([strip.half_width_m for strip in strips])
    between_m = [strip.between_m for strip in strips]
    standing, count = forecast.stands, len(forecast)
    ever = _ever_near(bundle, half_width_m, forecast, between_m)
    for p, strip in enumerate(strips):
        if strip.ignore is not None:
            ever[p, strip.ignore] = False
    # who stands is looked at once
    of, actor, instant = np.nonzero(ever[..., None] & (~standing[:, None] | (np.arange(forecast.instants) == 0)))
    vertices, away_m = bundle.nearest_vertices(
        of, forecast.x_m[actor, instant], forecast.y_m[actor, instant], between_m
    )
    # the nearest vertex looked at may be half a stride further than the nearest point
    slack_m = half_width_m[of], 0.5 * bundle.coarse_m[of]
    close = np.flatnonzero(away_m <= forecast.radius_m[actor] + slack_m[0] + slack_m[1])
    of, actor, instant = of[close], actor[close], instant[close]
    x_m, y_m, heading = (each[actor, instant] for each in (forecast.x_m, forecast.y_m, forecast.heading_rad))
    center, off_m, segments = bundle.project_near(of, x_m, y_m, vertices[close])
    path_cos, path_sin = bundle.directions(segments)
    cos, sin = np.cos(heading), np.sin(heading)
    length, width = forecast.length_m[actor], forecast.width_m[actor]
    # a straight path would be reached by this much of the box, a bent one by some more
    reach_m = 0.5 * (width * np.abs(cos * path_cos + sin * path_sin) + length * np.abs(sin * path_cos - cos * path_sin))
    close = np.flatnonzero(np.abs(off_m) <= half_width_m[of] + reach_m + length * length / (8.0 * _SHARPEST_BEND_M))
    of, actor, instant, center = of[close], actor[close], instant[close], center[close]
    boxes = _Boxes(
        x_m[close], y_m[close], cos[close], sin[close], length[close], width[close], forecast.radius_m[actor]
    )
    near, far = _stretches(bundle, half_width_m[of], of, boxes, segments[close])

    start_m, end_m = np.array(between_m).T
    inside = np.flatnonzero((near <= far) & (far > start_m[of]) & (near < end_m[of]))
    of, instant, center = of[inside], instant[inside], center[inside]
    pair = of * count + actor[inside]  # increases
    first = np.ones(len(pair), dtype=np.bool_)
    np.not_equal(pair[1:], pair[:-1], out=first[1:])
    known, place = pair[first], np.cumsum(first) - 1
    rows = actor[inside][first]
    by_path = np.searchsorted(of, np.arange(len(strips) + 1)).tolist()
    lane_heading = np.concatenate(
        [
            np.interp(center[a:b], path.line.arc_m, path.line.vertex_heading_rad)
            for path, (a, b) in zip(paths, pairwise(by_path), strict=True)
        ]
    )
    speed = forecast.speed_mps[rows[place], instant] * np.cos(heading[close][inside] - lane_heading)

    def table(values: Floats, nobody: float) -> Floats:
        column = np.full((len(rows), forecast.instants), nobody)
        column[place, instant] = values
        column[stand] = column[stand, :1]
        return column

    stand = np.flatnonzero(standing[rows])
    tables = table(near[inside], np.inf), table(far[inside], -np.inf), table(center, np.nan), table(speed, 0.0)
    pieces = pairwise(np.searchsorted(known, count * np.arange(len(strips) + 1)).tolist())
    return [StripOccupancy(rows[a:b], *(column[a:b] for column in tables)) for a, b in pieces]


@lru_cache(maxsize=4)
def _bundle(paths: tuple[DrivingPath, ...]) -> PathBundle:
    return PathBundle(paths)


def _ever_near(
    bundle: PathBundle, half_width_m: Floats, forecast: Forecast, between_m: Sequence[tuple[float, float]]
) -> NDArray[np.bool_]:
    """(P, A) whether the circle around all boxes of an actor comes near the stretch; if not, it is never in it."""
    middle, many, count = forecast.instants // 2, len(between_m), len(forecast)
    x_m, y_m = forecast.x_m[:, middle], forecast.y_m[:, middle]
    roams_m = np.hypot(forecast.x_m - x_m[:, None], forecast.y_m - y_m[:, None]).max(axis=1)
    of = np.repeat(np.arange(many), count)
    _, away_m = bundle.nearest_vertices(of, np.tile(x_m, many), np.tile(y_m, many), between_m)
    reach_m = (roams_m + forecast.radius_m) + half_width_m[:, None]
    return away_m.reshape(many, count) <= reach_m + 0.5 * bundle.coarse_m[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class _Boxes:
    """M boxes, (M,) each."""

    x_m: Floats
    y_m: Floats
    cos: Floats
    sin: Floats
    length_m: Floats
    width_m: Floats
    radius_m: Floats


def _stretches(
    bundle: PathBundle, half_width_m: Floats, of: Ints, boxes: _Boxes, segments: Ints
) -> tuple[Floats, Floats]:
    """Where boxes (M,) begin and end to occupy the strips of paths `of`; their centres project on `segments`."""
    near, far = np.full(len(of), np.inf), np.full(len(of), -np.inf)
    long = boxes.radius_m > _CAR_RADIUS_M
    # few are long, and need more points and a wider search
    for group, (along, across) in ((np.flatnonzero(~long), _AROUND_CAR), (np.flatnonzero(long), _AROUND_LONG)):
        if group.size:
            ahead, left = boxes.length_m[group] * along, boxes.width_m[group] * across
            cos, sin = boxes.cos[group], boxes.sin[group]
            x_m = boxes.x_m[group] + cos * ahead - sin * left
            y_m = boxes.y_m[group] + sin * ahead + cos * left
            mine = of[group]
            largest_m = np.zeros(len(bundle.paths))
            np.maximum.at(largest_m, mine, boxes.radius_m[group])
            spans = np.ceil(largest_m / bundle.fine_m).astype(np.int64) + 1
            s_m, d_m, _ = bundle.project_near(mine, x_m, y_m, segments[group], spans)
            near[group], far[group] = _clipped(s_m, d_m, half_width_m[group])
    return near, far


def _clipped(s_m: Floats, d_m: Floats, half_width_m: Floats) -> tuple[Floats, Floats]:
    """Least and largest arc length (M,) of polygons (P, M) in path coordinates within strips (M,); else inf, -inf."""
    following = np.arange(1, len(s_m) + 1) % len(s_m)
    ds, dd = s_m[following] - s_m, d_m[following] - d_m
    dd[np.abs(dd) < 1e-9] = 1e-9
    one, other = (-half_width_m - d_m) / dd, (half_width_m - d_m) / dd
    enters, leaves = np.maximum(np.minimum(one, other), 0.0), np.minimum(np.maximum(one, other), 1.0)
    crosses = enters <= leaves
    ends = s_m + enters * ds, s_m + leaves * ds
    near = np.where(crosses, np.minimum(*ends), np.inf).min(axis=0)
    far = np.where(crosses, np.maximum(*ends), -np.inf).max(axis=0)
    return near, far
