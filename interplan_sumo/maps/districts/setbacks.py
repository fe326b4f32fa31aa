"""How far from the middle of a junction its arms stop, so that kerbs round the corners as they should."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from interplan_sumo.maps.districts.geometry import beside_pose, crossing_m
from interplan_sumo.maps.districts.plan import Direction, Junction, Plan, Road
from interplan_sumo.maps.districts.sections import strips, way_at
from interplan_sumo.world.geometry import Pose, wrap_angle

CROSSWALK_ROOM_M = 6.0
"""Least distance of a stop line from the kerb of the crossing road, where a crosswalk lies between them."""
BARE_ROOM_M = 1.0
"""The same without a crosswalk."""
SIGHT_M = 15.0
"""Where the direction of an arm is taken at first, seen from the middle of the junction."""
SHORTEST_SETBACK_M = 8.0
STUB_M = 30.0
"""A road whose axis stops this close to the middle of a junction, on either side of it, ends there."""
STRAIGHT_RAD = np.radians(165.0)
"""Arms that enclose more than this have no corner between them."""
_ROUNDS = 5  # of fitting the corner to the direction of the arms at their cuts, which depends on the corner


@dataclass(frozen=True, slots=True)
class _Ray:
    """An arm seen from the middle: where it goes and how far its kerbs lie to its left and right."""

    key: str
    pose: Pose
    """On the axis, heading away from the junction."""
    left_m: float
    right_m: float


def junction_middle(plan: Plan, junction: Junction) -> tuple[float, float]:
    """Where the axes of the first two roads cross, prolonged if one of them stops short."""
    x_m, y_m = junction.at
    first, second = (plan.road[name].axis for name in junction.roads[:2])
    for _ in range(12):
        a, b = first.pose(first.station_of(x_m, y_m)), second.pose(second.station_of(x_m, y_m))
        if abs(np.sin(b.heading_rad - a.heading_rad)) < np.sin(np.radians(15.0)):
            raise ValueError(f"junction {junction.name}: {junction.roads[0]} and {junction.roads[1]} hardly cross")
        ahead_m, _ = crossing_m(a, b)
        x_m = float(a.x_m + ahead_m * np.cos(a.heading_rad))
        y_m = float(a.y_m + ahead_m * np.sin(a.heading_rad))
    return x_m, y_m


def setbacks_m(plan: Plan, junction: Junction) -> dict[str, float]:
    """Distance along the axis from the middle of the junction to each arm's stop line, by key of the arm."""
    middle = junction_middle(plan, junction)
    arms: dict[str, tuple[Road, int, float]] = {}
    for name in junction.roads:
        road = plan.road[name]
        station_m = road.axis.station_of(*middle)
        for sign, room_m in ((-1, station_m), (1, road.axis.length_m - station_m)):
            if room_m > STUB_M:
                arms[f"{name}{'-' if sign < 0 else '+'}"] = road, sign, station_m
    reach_m = dict.fromkeys(arms, SIGHT_M)
    for _ in range(_ROUNDS):
        reach_m = _fitted(plan, junction, arms, reach_m)
    return {**reach_m, **{key: given for key, given in junction.setbacks_m.items() if key in reach_m}}


def _fitted(
    plan: Plan, junction: Junction, arms: dict[str, tuple[Road, int, float]], reach_m: dict[str, float]
) -> dict[str, float]:
    """One round: setbacks that suit the directions which the arms have at the old ones."""
    rays = sorted(
        (
            _ray(plan, junction, key, road, sign, station_m, reach_m[key])
            for key, (road, sign, station_m) in arms.items()
        ),
        key=lambda ray: ray.pose.heading_rad,
    )
    fitted = dict.fromkeys(reach_m, SHORTEST_SETBACK_M)
    for ray, following in pairwise([*rays, rays[0]]):
        angle = float((following.pose.heading_rad - ray.pose.heading_rad) % (2.0 * np.pi))
        if angle > STRAIGHT_RAD:
            continue
        # The left kerb of this arm meets the right kerb of the next one, counter-clockwise.
        ahead = crossing_m(beside_pose(ray.pose, ray.left_m), beside_pose(following.pose, following.right_m))
        rounding_m = junction.corner_m / np.tan(angle / 2.0)
        for key, corner_m in zip((ray.key, following.key), ahead, strict=True):
            marked = junction.crosswalks is None or key in junction.crosswalks
            room_m = CROSSWALK_ROOM_M if marked else BARE_ROOM_M
            fitted[key] = max(fitted[key], float(reach_m[key] + corner_m + max(rounding_m, room_m)))
    return fitted


def _ray(plan: Plan, junction: Junction, key: str, road: Road, sign: int, station_m: float, reach_m: float) -> _Ray:
    side = 1.0 if plan.driving_side == "right" else -1.0
    sight_m = station_m + sign * reach_m
    arriving: Direction = "forward" if sign < 0 else "backward"
    leaving: Direction = "backward" if sign < 0 else "forward"
    edges: list[float] = []
    for direction, approach, across in ((arriving, junction.approaches.get(key), side), (leaving, None, -side)):
        way = way_at(road, direction, sight_m)
        for strip in strips(way, approach) if way is not None else ():
            edges += [across * strip.inner_m, across * strip.kerb_m]
    axis = road.axis.pose(sight_m)
    heading = float(wrap_angle(axis.heading_rad if sign > 0 else axis.heading_rad + np.pi))
    return _Ray(key, Pose(axis.x_m, axis.y_m, heading), max(edges), min(edges))
