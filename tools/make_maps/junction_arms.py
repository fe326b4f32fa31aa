"""The arms of roads at junctions: how far back each arm stops, and how it widens for its pockets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from interplan_sumo.world.geometry import Pose, wrap_angle
from tools.make_maps.geometry import beside_pose, crossing_m
from tools.make_maps.plan import (
    Direction,
    Plan,
    PlannedApproach,
    PlannedJunction,
    Road,
    carriageway_at,
    missing_median_m,
    strips,
)

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
class PlannedArm:
    """One arm of a junction, before its lanes are drawn."""

    key: str
    road: Road
    sign: int
    """+1 where the road leads on to higher stations, -1 to lower ones."""
    station_m: float
    """Of the middle of the junction."""
    setback_m: float
    """From the middle to the stop line, along the axis."""
    approach: PlannedApproach
    pushed_m: float
    """How far either direction moves outward, so that pockets fit between them."""

    @property
    def arriving(self) -> Direction:
        return "forward" if self.sign < 0 else "backward"

    @property
    def leaving(self) -> Direction:
        return "backward" if self.sign < 0 else "forward"

    @property
    def cut_m(self) -> float:
        return self.station_m + self.sign * self.setback_m


def junction_middle(plan: Plan, junction: PlannedJunction) -> tuple[float, float]:
    """Where the axes of the first two roads cross, prolonged if one of them stops short."""
    assert junction.at is not None, "places are written out"
    x_m, y_m = junction.at
    first, second = (plan.road[name].axis for name in junction.crossing)
    for _ in range(12):
        a, b = first.pose(first.station_of(x_m, y_m)), second.pose(second.station_of(x_m, y_m))
        if abs(np.sin(b.heading_rad - a.heading_rad)) < np.sin(np.radians(15.0)):
            raise ValueError(f"junction {junction.name}: {junction.roads[0]} and {junction.roads[1]} hardly cross")
        ahead_m, _ = crossing_m(a, b)
        x_m = float(a.x_m + ahead_m * np.cos(a.heading_rad))
        y_m = float(a.y_m + ahead_m * np.sin(a.heading_rad))
    return x_m, y_m


def planned_arms(plan: Plan, junction: PlannedJunction) -> Mapping[str, PlannedArm]:
    """The arms of a junction by key, in the order in which the plan names the roads, minus before plus."""
    middle = junction_middle(plan, junction)
    found: dict[str, PlannedArm] = {}
    for name in junction.roads:
        road = plan.road[name]
        station_m = road.axis.station_of(*middle)
        own: list[PlannedArm] = []
        for sign, room_m in ((-1, station_m), (1, road.axis.length_m - station_m)):
            if room_m > min(STUB_M, 0.5 * road.axis.length_m):
                key = f"{name}{'-' if sign < 0 else '+'}"
                approach = (junction.approaches or {}).get(key, PlannedApproach())
                arm = PlannedArm(key, road, sign, station_m, SIGHT_M, approach, 0.0)
                carriageway = carriageway_at(road, arm.arriving, arm.cut_m)
                missing_m = missing_median_m(carriageway, approach) if carriageway is not None else 0.0
                own.append(replace(arm, pushed_m=missing_m / 2.0))
        if not own:
            raise ValueError(f"junction {junction.name}: road {name} does not reach it")
        found |= {arm.key: arm for arm in own}
    unknown = [key for key in junction.approaches or () if key not in found]
    if unknown:
        raise ValueError(f"junction {junction.name} has no arm {unknown[0]}, only {', '.join(found)}")
    for _ in range(_ROUNDS):
        found = _fitted(plan, junction, found)
    return found


@dataclass(frozen=True, slots=True)
class _Ray:
    """An arm seen from the middle: where it goes and how far its kerbs lie to its left and right."""

    key: str
    pose: Pose
    """On the axis, heading away from the junction."""
    left_m: float
    right_m: float


def _fitted(plan: Plan, junction: PlannedJunction, planned_arms: Mapping[str, PlannedArm]) -> dict[str, PlannedArm]:
    """One round: setbacks that suit the directions which the arms have at the old ones.

    Kerbs round the corner with the wanted radius, and a crosswalk finds room.
    """
    rays = sorted((_ray(plan, junction, arm) for arm in planned_arms.values()), key=lambda ray: ray.pose.heading_rad)
    fitted = dict.fromkeys(planned_arms, SHORTEST_SETBACK_M)
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
            fitted[key] = max(fitted[key], float(planned_arms[key].setback_m + corner_m + max(rounding_m, room_m)))
    return {key: replace(arm, setback_m=fitted[key]) for key, arm in planned_arms.items()}


def _ray(plan: Plan, junction: PlannedJunction, arm: PlannedArm) -> _Ray:
    side = 1.0 if plan.driving_side == "right" else -1.0
    edges: list[float] = []
    both: tuple[tuple[Direction, PlannedApproach | None, float], ...] = (
        (arm.arriving, arm.approach, side),
        (arm.leaving, None, -side),
    )
    for direction, approach, across in both:
        if not junction.takes(arm.road.name, direction):
            continue
        carriageway = carriageway_at(arm.road, direction, arm.cut_m)
        for strip in strips(carriageway, approach, arm.pushed_m) if carriageway is not None else ():
            edges += [across * strip.inner_m, across * strip.kerb_m]
    axis = arm.road.axis.pose(arm.cut_m)
    heading = float(wrap_angle(axis.heading_rad if arm.sign > 0 else axis.heading_rad + np.pi))
    return _Ray(arm.key, Pose(axis.x_m, axis.y_m, heading), max(edges), min(edges))
