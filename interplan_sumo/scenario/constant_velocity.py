"""Holding on: where everybody would be if all kept their lane and speed, and who would touch whom."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats, Polyline, box_corners, penetration_m, wrap_angle
from interplan_sumo.world.roads import Roads, Turn

STEP_S: Final = 0.1
HOLD_S: Final = 3.0
"""Nobody may hit anybody within this time if all hold their speed (benchmark.md)."""
HOLD_TIMES_S: Final = np.linspace(0.0, HOLD_S, round(HOLD_S / STEP_S) + 1)
OVERLAP_M: Final = 0.05
"""Boxes that penetrate by more than this overlap (decisions.md)."""
ALONG_RAD: Final = np.radians(45.0)
"""A vehicle drives along a lane whose direction differs from its own by less than this."""
_FAR_M: Final = 1e6
"""Where those are who have left the map, each in a place of its own."""


def lane_ahead(roads: Roads, lane_id: str, arc_m: float, length_m: float, route: Collection[str] = ()) -> Polyline:
    """What lies ahead of a place for somebody who keeps the lane: at least `length_m`, if the map goes on.

    At forks the way in `route` (roadblock ids) is taken, else the straightest.
    """
    return next(_ways(roads, lane_id, arc_m, length_m, route))


def lanes_ahead(roads: Roads, lane_id: str, arc_m: float, length_m: float) -> tuple[Polyline, ...]:
    """The ways that background traffic may take from a place: straight on, where one cannot, every way."""
    return tuple(_ways(roads, lane_id, arc_m, length_m, ()))


def _ways(roads: Roads, lane_id: str, arc_m: float, length_m: float, route: Collection[str]) -> Iterator[Polyline]:
    line = roads[lane_id].centerline
    arc_m = min(arc_m, line.length_m - 1e-3)
    here = line.between(arc_m, line.length_m)
    left_m = length_m - here.length_m
    onward = roads.outgoing(lane_id) if left_m > 0.0 else ()
    for choice in (
        [way for way in onward if roads[way].roadblock_id in route],
        [way for way in onward if way in roads.connectors and roads.connectors[way].turn is Turn.STRAIGHT],
        list(onward),
    ):
        if choice:
            for way in sorted(choice, key=lambda way: (abs(roads[way].centerline.turned_rad), way)):
                yield from (here.joined(rest) for rest in _ways(roads, way, 0.0, left_m, route))
            return
    yield here


def ego_ahead(scenario: Scenario, roads: Roads, length_m: float) -> Polyline:
    """The lane ahead of the ego's start, along the route; the ego is `start.left_m` to its left."""
    start = scenario.start
    return lane_ahead(roads, start.lane, start.arc_m, length_m, scenario.route)


def ego_held(scenario: Scenario, roads: Roads) -> Floats:
    """(K, 3) poses of the ego at `HOLD_TIMES_S` if it holds lane and speed."""
    line = ego_ahead(scenario, roads, scenario.start_speed_mps * HOLD_S + PACIFICA.length_m)
    return beside(line, scenario.start_speed_mps * HOLD_TIMES_S, scenario.start.left_m)


def beside(line: Polyline, arc_m: Floats, left_m: float) -> Floats:
    """(K, 3) poses along a line at arc lengths (K,), `left_m` to its left."""
    poses = line.poses_at(arc_m)
    poses[:, 0] -= left_m * np.sin(poses[:, 2])
    poses[:, 1] += left_m * np.cos(poses[:, 2])
    return poses


def ego_boxes(poses: Floats) -> Floats:
    """(K, 4, 2) corners of the ego at poses (K, 3)."""
    x_m, y_m, heading_rad = poses.T
    return box_corners(x_m, y_m, heading_rad, np.full_like(x_m, PACIFICA.length_m), np.full_like(x_m, PACIFICA.width_m))


def held(roads: Roads, actors: Actors) -> Iterator[tuple[int, Floats]]:
    """For each actor (row) and each way it may take, its poses (K, 3) at `HOLD_TIMES_S`."""
    time_s = HOLD_TIMES_S
    for row in range(len(actors)):
        x_m, y_m, heading_rad = (float(column[row]) for column in (actors.x_m, actors.y_m, actors.heading_rad))
        driven_m = float(actors.speed_mps[row]) * time_s
        found = _lane_of(roads, x_m, y_m, heading_rad) if driven_m[-1] > 0.0 else None
        if found is None:
            ahead_x, ahead_y = actors.vx_mps[row] * time_s, actors.vy_mps[row] * time_s
            yield row, np.stack((x_m + ahead_x, y_m + ahead_y, np.full_like(time_s, heading_rad)), axis=1)
            continue
        lane_id, arc_m, left_m = found
        for line in lanes_ahead(roads, lane_id, arc_m, float(driven_m[-1])):
            poses = beside(line, driven_m, left_m)
            poses[driven_m > line.length_m + 1.0, :2] = _FAR_M * (row + 1)
            yield row, poses


def _lane_of(roads: Roads, x_m: float, y_m: float, heading_rad: float) -> tuple[str, float, float] | None:
    """Lane, arc length and offset to the left of a vehicle that drives along one; None otherwise."""
    best: tuple[float, str, float, float] | None = None
    for lane_id in roads.at(x_m, y_m):
        line = roads[lane_id].centerline
        arc_m, left_m = line.project_point(x_m, y_m)
        turned_rad = abs(float(wrap_angle(line.pose_at(arc_m).heading_rad - heading_rad)))
        if turned_rad < ALONG_RAD and (best is None or (abs(left_m), lane_id) < best[:2]):
            best = (abs(left_m), lane_id, arc_m, left_m)
    return None if best is None else best[1:]


def first_contacts(
    poses: Floats, size_m: Floats, owner: NDArray[np.int64], depth_m: float = OVERLAP_M
) -> dict[tuple[int, int], int]:
    """The first frame in which two of several boxes penetrate by more than `depth_m`, by pair of owners.

    `poses` (N, K, 3) over K frames, `size_m` (N, 2) length and width, `owner`
    (N,) whose box it is: the boxes of one owner, on different ways, never meet.
    """
    found: dict[tuple[int, int], int] = {}
    first, second = np.triu_indices(len(poses), 1)
    others = owner[first] != owner[second]
    first, second = first[others], second[others]
    reach_m = np.hypot(*size_m.T) / 2.0
    for frame in range(poses.shape[1]):
        x_m, y_m = poses[:, frame, 0], poses[:, frame, 1]
        apart_m = np.hypot(x_m[first] - x_m[second], y_m[first] - y_m[second])
        near = np.flatnonzero(apart_m < reach_m[first] + reach_m[second])
        if not near.size:
            continue
        corners = box_corners(x_m, y_m, poses[:, frame, 2], size_m[:, 0], size_m[:, 1])
        deep = near[penetration_m(corners[first[near]], corners[second[near]]) > depth_m]
        for pair in zip(owner[first[deep]].tolist(), owner[second[deep]].tolist(), strict=True):
            found.setdefault(pair, frame)
    return found
