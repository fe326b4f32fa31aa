"""Can what stands in the way be passed, and where: on the ego's own side, or only over the oncoming lane?"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.families.shapes import CLEARANCE_M, LARGEST_OFFSET_M
from interplan_sumo.scenario.constant_velocity import OVERLAP_M, beside, ego_ahead, ego_boxes
from interplan_sumo.scenario.kinds import OBSTACLES, SLOW_KINDS, SLOW_SIZES_M
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import PACIFICA, EgoShape
from interplan_sumo.world.geometry import Floats, Polyline, box_corners, penetration_m
from interplan_sumo.world.roads import Roads

OFFSET_SLACK_M: Final = 0.02
"""Places in scenarios are rounded to centimetres."""
AUDIT_SLACK_M: Final = 0.05
"""An audit takes a little more for a nudge than a start check lets pass: it asks what is meant."""

OffsetRule = Callable[[float | None], list[str]]
"""What is wrong with the offset that passing takes; None: the ego's own side has no room for any."""

_STATION_M: Final = 0.5
"""Raster of the search for a way past: along the lane (no cone slips through), and across it."""
_ACROSS_M: Final = 0.1
_REACH_M: Final = 14.0
"""The search looks this far to either side of the lane's centre."""
_APPROACH_M: Final = 20.0
"""The search begins and ends so far before and behind the obstacles."""
_STEEPEST: Final = 0.4
"""Metres sideways per metre ahead that a slow car can steer."""
_SEAM_M: Final = 0.05
"""Neighbouring polygons of a map may leave gaps of less."""


def obstacle_corners(scenario: Scenario, roads: Roads) -> Floats:
    """(N, 4, 2) corners of the obstacles' boxes."""
    poses = [obstacle.pose(roads) for obstacle in scenario.obstacles]
    rows = [(pose.x_m, pose.y_m, pose.heading_rad) for pose in poses]
    x_m, y_m, heading_rad = np.array(rows, dtype=np.float64).reshape(-1, 3).T
    length_m, width_m = np.array([each.size_m for each in scenario.obstacles], dtype=np.float64).reshape(-1, 2).T
    return box_corners(x_m, y_m, heading_rad, length_m, width_m)


def corners_in_the_way(scenario: Scenario, roads: Roads) -> Floats:
    """(N, 4, 2) corners of what must be passed: the obstacles, and slow vehicles where they start."""
    slow = [each for each in scenario.vehicles if each.kind in SLOW_KINDS]
    if not slow:
        return obstacle_corners(scenario, roads)
    poses = [each.place.pose(roads) for each in slow]
    x_m, y_m, heading_rad = np.array([(pose.x_m, pose.y_m, pose.heading_rad) for pose in poses]).T
    length_m, width_m = np.array([SLOW_SIZES_M[each.kind] for each in slow]).T
    boxes = box_corners(x_m, y_m, heading_rad, length_m, width_m)
    return np.concatenate((obstacle_corners(scenario, roads), boxes))


def any_offset(_offset_m: float | None) -> list[str]:
    """Passing may lead as far aside as there is room."""
    return []


def small_offset(offset_m: float | None) -> list[str]:
    """One passes on the own side, a little aside."""
    if offset_m is None:
        return [
            "obstacles: passing takes the ego's centre out of its own side of the road, "
            f"expected a lateral offset of at most {LARGEST_OFFSET_M} m; move the car towards the kerb"
        ]
    if offset_m > LARGEST_OFFSET_M + OFFSET_SLACK_M:
        return [
            f"obstacles: passing takes a lateral offset of {offset_m:.2f} m, expected at most {LARGEST_OFFSET_M} m; "
            "move the car towards the kerb"
        ]
    return []


def beyond_own_side(offset_m: float | None) -> list[str]:
    """The own side has no room to pass."""
    if offset_m is None or offset_m > LARGEST_OFFSET_M + OFFSET_SLACK_M:
        return []
    return [
        f"obstacles: the ego passes on its own side, {offset_m:.2f} m off the lane's centre, expected it to need "
        "the oncoming lane; move the car towards the road's middle, or make it a nudge"
    ]


def passing_problems(
    scenario: Scenario, roads: Roads, *, own_side_only: bool, offset: OffsetRule = any_offset
) -> list[str]:
    """What is wrong with obstacles that are to block the lane and leave a way past, on the ego's own side if asked."""
    corners = corners_in_the_way(scenario, roads)
    if not len(corners):
        return [f"obstacles: there are none, expected some that block the lane: the family is {scenario.family}"]
    line = ego_ahead(scenario, roads, _past_m(scenario, roads, corners) + 2.0 * _APPROACH_M)
    if not _blocks(line, scenario.start.left_m, corners):
        return [
            "obstacles: a drive that holds its lane touches none of them, expected them to block the lane; "
            "move them towards its centre"
        ]
    problems = [] if offset is any_offset else offset(passing_offset_m(scenario, roads, line, corners))
    if not problems and not has_way_past(scenario, roads, line, corners, own_side_only=own_side_only):
        where = "the ego's own side of the road" if own_side_only else "the drivable area"
        problems = [
            f"obstacles: they leave no way past on {where}, expected one with {CLEARANCE_M} m to spare on either side; "
            "move or remove some"
        ]
    return problems


def wreck_problems(scenario: Scenario, roads: Roads) -> list[str]:
    """Crashed cars really have crashed: every one into another."""
    corners = obstacle_corners(scenario, roads)
    cars = vehicles_standing(scenario)
    if len(cars) < 2:
        return [f"obstacles: {len(cars)} of them are vehicles, expected two or three that have crashed"]
    problems: list[str] = []
    for i in cars:
        others = [j for j in cars if j != i]
        depth_m = penetration_m(np.repeat(corners[i : i + 1], len(others), axis=0), corners[others])
        nearest = int(np.argmax(depth_m))
        if depth_m[nearest] <= OVERLAP_M:
            problems.append(
                f"obstacles[{i}]: its box goes {100 * float(depth_m[nearest]):.0f} cm into that of "
                f"obstacles[{others[nearest]}], expected more than {100 * OVERLAP_M:.0f} cm of a crashed car; "
                "move it nearer"
            )
    return problems


def vehicles_standing(scenario: Scenario) -> list[int]:
    """Indices of the obstacles that are vehicles."""
    return [i for i, each in enumerate(scenario.obstacles) if OBSTACLES[each.kind][0] == ActorKind.VEHICLE]


def _past_m(scenario: Scenario, roads: Roads, corners: Floats) -> float:
    """A generous bound of the way from the start to the last obstacle."""
    start = scenario.start.pose(roads)
    return 1.5 * float(np.hypot(corners[..., 0] - start.x_m, corners[..., 1] - start.y_m).max()) + 20.0


def _stretch(line: Polyline, corners: Floats, margin_m: float, step_m: float) -> Floats:
    """Arc lengths of a line beside boxes, and `margin_m` before and behind them."""
    arc_m, _ = line.project(corners.reshape(-1, 2))
    first_m, last_m = max(0.0, float(arc_m.min()) - margin_m), min(line.length_m, float(arc_m.max()) + margin_m)
    return np.linspace(first_m, last_m, max(2, int(np.ceil((last_m - first_m) / step_m)) + 1))


def _blocks(line: Polyline, left_m: float, corners: Floats) -> bool:
    """Whether an ego `left_m` to the left of a line touches one of the boxes."""
    boxes = shapely.polygons(ego_boxes(beside(line, _stretch(line, corners, PACIFICA.length_m, 0.25), left_m)))
    return bool(shapely.intersects(shapely.union_all(shapely.polygons(corners)), boxes).any())


# --- how far aside -------------------------------------------------------------------------------


@lru_cache(maxsize=8)
def offset_asked_m(scenario: Scenario, roads: Roads) -> float | None:
    """`passing_offset_m` of all that stands or crawls within 200 m; 0 where nothing does."""
    corners = corners_in_the_way(scenario, roads)
    if not len(corners):
        return 0.0
    return passing_offset_m(scenario, roads, ego_ahead(scenario, roads, 200.0), corners)


def is_small(offset_m: float | None) -> bool:
    """Whether an offset is one that the ego can take on its own side."""
    return offset_m is not None and offset_m <= LARGEST_OFFSET_M + AUDIT_SLACK_M


def passing_offset_m(scenario: Scenario, roads: Roads, line: Polyline, corners: Floats) -> float | None:
    """How far off the lane's centre the ego must go to pass, parallel to the lane and 0.3 m clear.

    The lesser of both sides; None where on either its centre would leave the
    route's roadblocks or its box the drivable area.
    """
    arc_m = _stretch(line, corners, PACIFICA.length_m / 2.0, 0.25)
    standing = shapely.union_all(shapely.polygons(corners))
    own, drivable = _surfaces(roads, scenario.route)
    found: list[float] = []
    for side in (1.0, -1.0):
        offset_m = _least_clear_m(line, arc_m, side, standing)
        if offset_m is None:
            continue
        boxes = ego_boxes(beside(line, arc_m, side * offset_m))
        inside = shapely.contains_xy(own, boxes.mean(axis=1)).all()
        if inside and shapely.contains_xy(drivable, boxes.reshape(-1, 2)).all():
            found.append(offset_m)
    return min(found, default=None)


def _least_clear_m(line: Polyline, arc_m: Floats, side: float, standing: shapely.Geometry) -> float | None:
    """The least offset to one side at which the ego stays clear all along; None within reach."""

    def is_clear(offset_m: float) -> bool:
        boxes = shapely.polygons(ego_boxes(beside(line, arc_m, side * offset_m)))
        return bool((shapely.distance(standing, boxes) >= CLEARANCE_M).all())

    offsets_m = np.arange(0.0, _REACH_M / 2.0, 0.1)
    high_m = next((float(offset_m) for offset_m in offsets_m if is_clear(float(offset_m))), None)
    if high_m is None or high_m == 0.0:
        return high_m
    low_m = high_m - 0.1
    while high_m - low_m > 1e-3:
        middle_m = (low_m + high_m) / 2.0
        low_m, high_m = (low_m, middle_m) if is_clear(middle_m) else (middle_m, high_m)
    return high_m


# --- any obstacles: is there a way past ----------------------------------------------------------


def has_way_past(
    scenario: Scenario, roads: Roads, line: Polyline, corners: Floats, *, own_side_only: bool = False
) -> bool:
    """Whether a car can get past the boxes and back to the route's side, `CLEARANCE_M` from all of them.

    Searches a raster along the lane, 0.5 m by 0.1 m: the ego, parallel to the lane,
    must be free and on the drivable area, its centre on the route's roadblocks if
    `own_side_only`, and moves sideways by at most 0.4 m per metre.
    """
    arc_m = _stretch(line, corners, _APPROACH_M, _STATION_M)
    across_m = np.arange(-_REACH_M, _REACH_M + _ACROSS_M / 2.0, _ACROSS_M)
    poses = line.poses_at(arc_m)
    x_m = poses[:, 0, None] - across_m * np.sin(poses[:, 2, None])
    y_m = poses[:, 1, None] + across_m * np.cos(poses[:, 2, None])
    own, drivable = _surfaces(roads, scenario.route)
    standing = shapely.buffer(shapely.union_all(shapely.polygons(corners)), CLEARANCE_M)
    shapely.prepare(standing)
    room = shapely.contains_xy(drivable, x_m, y_m) & ~shapely.contains_xy(standing, x_m, y_m)
    free = _fits(room, PACIFICA, float(arc_m[1] - arc_m[0]))
    on_side: NDArray[np.bool_] = shapely.contains_xy(own, x_m, y_m)
    if own_side_only:
        free &= on_side
    reached = np.zeros(len(across_m), dtype=np.bool_)
    reached[int(np.argmin(np.abs(across_m - scenario.start.left_m)))] = True
    sideways = round(_STEEPEST * float(arc_m[1] - arc_m[0]) / _ACROSS_M)
    for station in free[1:]:
        reached = (np.convolve(reached, np.ones(2 * sideways + 1), mode="same") > 0.0) & station
    return bool((reached & on_side[-1]).any())


def _fits(room: NDArray[np.bool_], shape: EgoShape, station_m: float) -> NDArray[np.bool_]:
    """Where the centre of a body may be, of which every point must have room; at its rim the raster goes on alike."""
    along, across = int(np.ceil(shape.length_m / 2.0 / station_m)), int(shape.width_m / 2.0 / _ACROSS_M)
    padded = np.pad(room, ((along, along), (across, across)), mode="edge")
    for axis, reach in ((0, along), (1, across)):
        padded = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=axis).all(axis=-1)
    return np.asarray(padded, dtype=np.bool_)


@lru_cache(maxsize=64)
def _surfaces(roads: Roads, route: tuple[str, ...]) -> tuple[shapely.Geometry, shapely.Geometry]:
    """The route's roadblocks and the drivable area around them, made ready for many questions."""
    own = shapely.buffer(shapely.union_all([roads.roadblocks[block].polygon for block in route]), _SEAM_M)
    drivable = shapely.intersection(roads.drivable_area, shapely.buffer(own, 2.0 * _REACH_M))
    drivable = shapely.buffer(drivable, _SEAM_M)
    shapely.prepare(own)
    shapely.prepare(drivable)
    return own, drivable
