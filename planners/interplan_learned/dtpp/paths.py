"""Reference paths: where the ego may go, as far as its own arrays show the lanes of the route."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.gameformer.candidates import NEAR_LANE_M, joined, joins
from interplan_sumo.features.schema import channel_index
from interplan_sumo.features.view import Arrays
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats, Polyline, Pose, wrap_angle

FIELDS: Final = ("lanes", "lanes_valid", "agents", "static_objects")
PATHS: Final = 3
"""The cheapest are kept, as published."""
POINTS: Final = 121
"""Points per path, a metre apart from the rear axle on; beyond its way's end a path goes straight on."""
OBSTACLE_COST, BESIDE_COST, CURVATURE_COST = 10.0, 1.0, 0.1
"""For a path on which something stands, per metre between its way and the ego, per 1/m of its largest curvature."""
LOOKED_AT_M: Final = 50
"""So much of a path is looked at for what stands on it and for curvature."""
STANDING_MPS: Final = 0.01
"""Vehicles as slow are obstacles."""
SHORT: Final = 0.2
"""Ways shorter than this share of `POINTS` are left out where a longer one leads on."""
_REACH_M: Final = POINTS - 1.0
_LEAST_M: Final = 1.0
_GAP_M: Final = 0.5
"""Pieces of lanes follow each other where an end and a start are so near."""
_ORIGIN: Final = Pose(0.0, 0.0, 0.0)
_ON_ROUTE = channel_index("lanes", "on_route")
_LENGTH, _WIDTH = (channel_index("agents", name) for name in ("length", "width"))
_VX, _VY = (channel_index("agents", name) for name in ("vx", "vy"))
_VEHICLE = [channel_index("agents", name) for name in ("is_car", "is_long_vehicle")]
_BOX = [channel_index("agents", name) for name in ("x", "y", "yaw", "length", "width")]
_CLASS = channel_index("static_objects", "class")


@dataclass(frozen=True, slots=True, eq=False)
class LaneChain:
    """A chain of pieces of lanes ahead of the ego."""

    line: Polyline
    from_m: float
    """Arc length beside the rear axle."""
    beside_m: float
    """From there to the rear axle."""

    @property
    def left_m(self) -> float:
        """What of it is ahead."""
        return self.line.length_m - self.from_m


def reference_paths(arrays: Arrays) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """(B, PATHS, POINTS, 4) x, y, yaw (unwrapped) and curvature (1/m) a metre apart, ego frame; and whether they exist.

    From arrays of the schema. The cheapest first; without a lane of the route near the ego there is none.
    """
    count = len(arrays["lanes"])
    paths, valid = np.zeros((count, PATHS, POINTS, 4), dtype=np.float32), np.zeros((count, PATHS), dtype=np.bool_)
    for sample in range(count):
        lanes, exists = arrays["lanes"][sample].astype(np.float64), arrays["lanes_valid"][sample]
        ways = ways_ahead(lanes[exists & (lanes[:, 0, _ON_ROUTE] > 0.0)])
        boxes = standing(arrays["agents"][sample, :, -1], arrays["static_objects"][sample])
        for row, path in enumerate(cheapest(ways, boxes)):
            paths[sample, row], valid[sample, row] = path, True
    return paths, valid


def ways_ahead(pieces: Floats) -> list[LaneChain]:
    """Ways along pieces of lanes (N, points, C) in driving order, from where the rear axle is."""
    if not len(pieces):
        return []
    starts, ends = pieces[:, 0], pieces[:, -1]
    apart_m = np.hypot(ends[:, None, 0] - starts[:, 0], ends[:, None, 1] - starts[:, 1])
    follows = (apart_m < _GAP_M) & (np.abs(wrap_angle(ends[:, None, 2] - starts[:, 2])) < np.pi / 4.0)
    beside_m = np.hypot(pieces[..., 0], pieces[..., 1])
    nearest = beside_m.argmin(axis=1)
    along = np.abs(np.take_along_axis(pieces[..., 2], nearest[:, None], axis=1)[:, 0]) < np.pi / 2.0
    begins = (beside_m.min(axis=1) < NEAR_LANE_M) & along & (nearest < pieces.shape[1] - 1)
    begins &= ~(follows & begins[:, None]).any(axis=0)  # what follows another beginning is on its way
    lengths_m = np.hypot(*np.moveaxis(np.diff(pieces[..., :2], axis=1), -1, 0)).sum(axis=1)
    ways: list[LaneChain] = []
    for first in np.flatnonzero(begins).tolist():
        first_m = float(lengths_m[first])
        for chain in _chains(first, follows, lengths_m, -first_m):
            line = Polyline(np.concatenate([pieces[row, :, :2] for row in chain]))
            from_m, aside_m = line.project_point(0.0, 0.0, (0.0, first_m))
            ways.append(LaneChain(line, from_m, abs(aside_m)))
    longest_m = max((way.left_m for way in ways), default=0.0)
    enough_m = max(min(SHORT * _REACH_M, longest_m), _LEAST_M)
    return [way for way in ways if way.left_m >= enough_m]


def standing(agents: NDArray[Any], objects: NDArray[Any]) -> Floats:
    """(K, 5) boxes x, y, yaw, length, width of things and of vehicles that stand, from their present rows."""
    slow = np.hypot(agents[:, _VX], agents[:, _VY]) < STANDING_MPS
    vehicle = (agents[:, _VEHICLE].sum(axis=1) > 0.0) & (agents[:, _LENGTH] > 0.0)
    things = objects[objects[:, _CLASS] > 0.0, :5]
    return np.concatenate((agents[slow & vehicle][:, _BOX], things)).astype(np.float64)


def cheapest(ways: list[LaneChain], boxes: Floats) -> list[Floats]:
    """At most `PATHS` paths (POINTS, 4), the cheapest first: of each way the path that joins it most cheaply."""
    found: list[tuple[float, int, Floats]] = []
    for number, way in enumerate(ways):
        paths = [sampled_path(joined(_ORIGIN, way.line, way.from_m, join_m)) for join_m in joins(way.left_m)]
        costs = [path_cost(path, way.beside_m, boxes) for path in paths]
        best = int(np.argmin(costs))
        found.append((costs[best], number, paths[best]))
    return [path for _, _, path in sorted(found, key=lambda each: each[:2])[:PATHS]]


def sampled_path(points: Floats) -> Floats:
    """(POINTS, 4) x, y, yaw, curvature a metre apart on a line (N, 2) that begins at the origin, heading along x."""
    line = Polyline(points)
    arc_m = np.arange(POINTS, dtype=np.float64)
    places = line.poses_at(np.minimum(arc_m, line.length_m))
    beyond_m = np.maximum(arc_m - line.length_m, 0.0)
    x_m = places[:, 0] + beyond_m * np.cos(places[-1, 2])
    y_m = places[:, 1] + beyond_m * np.sin(places[-1, 2])
    yaw = np.unwrap(np.arctan2(np.gradient(y_m), np.gradient(x_m)))
    yaw[0] = 0.0
    return np.stack((x_m, y_m, yaw, np.gradient(yaw)), axis=1)


def path_cost(path: Floats, beside_m: float, boxes: Floats) -> float:
    """Of a path (POINTS, 4) to a way that is so far beside the ego, among boxes (K, 5) that stand."""
    near = path[:LOOKED_AT_M]
    hit = bool(_on_path(near, boxes).any())
    return OBSTACLE_COST * hit + BESIDE_COST * beside_m + CURVATURE_COST * float(np.abs(near[:, 3]).max())


def _on_path(path: Floats, boxes: Floats) -> NDArray[np.bool_]:
    """(K,) whether boxes come nearer to the points of a path than half the ego's width."""
    x, y = path[:, None, 0] - boxes[:, 0], path[:, None, 1] - boxes[:, 1]
    c, s = np.cos(boxes[:, 2]), np.sin(boxes[:, 2])
    ahead_m = np.maximum(np.abs(c * x + s * y) - boxes[:, 3] / 2.0, 0.0)
    aside_m = np.maximum(np.abs(c * y - s * x) - boxes[:, 4] / 2.0, 0.0)
    return np.asarray(np.hypot(ahead_m, aside_m).min(axis=0) < PACIFICA.width_m / 2.0)


def _chains(first: int, follows: NDArray[np.bool_], lengths_m: Floats, passed_m: float) -> Iterator[tuple[int, ...]]:
    """Depth first: all chains of rows from one on, until they are long enough beyond the first or end."""
    passed_m += float(lengths_m[first])
    ahead = np.flatnonzero(follows[first]).tolist() if passed_m < _REACH_M else []
    if not ahead:
        yield (first,)
    for row in ahead:
        for chain in _chains(row, follows, lengths_m, passed_m):
            yield (first, *chain)
