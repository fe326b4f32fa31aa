"""Kerbside: what stands beside the ego's way and may concern it: parked cars with their doors, crosswalks."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, pi, sin
from typing import Final

import numpy as np
import shapely

from interplan_sumo.endurance.trip_way import TripWay
from interplan_sumo.scenario.jaywalking import PedestrianWalk
from interplan_sumo.scenario.kinds import OBSTACLES
from interplan_sumo.scenario.scenario import LanePosition
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, Pose, box_corners
from interplan_sumo.world.roads import Roads

DOOR_M: Final = 0.9
"""An open door reaches so far beyond its car."""
DOOR_RAD: Final = 1.15
"""How far it is open."""
HINGE_SHARE: Final = 0.18
"""Of the car's length, from its middle forwards, to the driver's door's hinge."""
FROM_EDGE_M: Final = 0.1
"""Parked cars stand so far beside the road."""
DOOR_EDGE_M: Final = (1.4, 2.0)
"""From the middle of the ego's lane to the edge of the road: nearer there is no room for the ego, farther the door
does not concern it."""
WALKS_MPS: Final = 1.4
WALKER_SIZE_M: Final = (0.9, 0.79)
BEYOND_M: Final = 0.7
"""People wait so far beyond the ends of a crosswalk."""
LONGEST_CROSSWALK_M: Final = 30.0
LEAST_ACROSS_RAD: Final = 1.0
"""What is less across the ego's way than this is no crosswalk over it."""
LIGHT_M: Final = 20.0
"""Crosswalks so near to a connector with a light have a light of their own, and nobody crosses there against it."""


@dataclass(slots=True, eq=False)
class Thing:
    """What stands still, in the map's frame."""

    id: str
    kind: ActorKind
    pose: Pose
    size_m: tuple[float, float]
    """Length and width."""

    def corners(self, origin_m: tuple[float, float]) -> Floats:
        """(4, 2) in SUMO's frame."""
        return _corners(self.pose, self.size_m) - np.array(origin_m)


@dataclass(frozen=True, slots=True)
class ParkedCar:
    """A car that stands at the kerb beside the ego's lane, and its door to that side when it is open."""

    car: Pose
    door: Pose
    door_m: float
    """The door's length."""
    conflict_m: float
    """Where the door is, along the ego's way."""

    def things(self, car: str, door: str) -> tuple[Thing, Thing]:
        """The car and the open door, with these ids."""
        size, thin_m = OBSTACLES["car"], OBSTACLES["door"][2]
        return (
            Thing(car, ActorKind.VEHICLE, self.car, (size[1], size[2])),
            Thing(door, ActorKind.GENERIC_OBJECT, self.door, (self.door_m, thin_m)),
        )


def parked_car(way: TripWay, at: LanePosition, along_m: float, edges_m: tuple[float, float]) -> ParkedCar | None:
    """The car that may stand there on the side of the ego's lane that is the road's edge; None where none fits.

    `at` is on the ego's lane, `along_m` the same place along its way, `edges_m` from there to the left and to the
    right edge of the road.
    """
    edge_m = min(edges_m)
    if not DOOR_EDGE_M[0] <= edge_m <= DOOR_EDGE_M[1]:
        return None
    side = 1.0 if edges_m[0] < edges_m[1] else -1.0
    line = way.roads[at.lane].centerline
    length_m, width_m = OBSTACLES["car"][1:]
    side_m = edge_m + FROM_EDGE_M
    middle = line.pose_at(at.arc_m, side * (side_m + width_m / 2.0))
    if bool(way.roads.drivable(_corners(middle, (length_m + 1.0, width_m))).any()):
        return None
    long_m = DOOR_M / sin(DOOR_RAD)
    ahead_m = HINGE_SHARE * length_m - long_m / 2.0 * cos(DOOR_RAD)
    there = line.pose_at(at.arc_m, side * (side_m - DOOR_M / 2.0))
    door = Pose(
        there.x_m + ahead_m * cos(middle.heading_rad),
        there.y_m + ahead_m * sin(middle.heading_rad),
        middle.heading_rad - side * (pi - DOOR_RAD),
    )
    return ParkedCar(middle, door, long_m, along_m + ahead_m)


@dataclass(frozen=True, slots=True, eq=False)
class Crosswalk:
    """A marked crossing over the ego's way without a light, and the way that people take on it."""

    name: str
    conflict_m: float
    """Along the ego's way."""
    walk: PedestrianWalk


def crosswalks_on(way: TripWay) -> list[Crosswalk]:
    """In the order in which the ego comes to them."""
    roads, line = way.roads, way.line.linestring
    found: list[Crosswalk] = []
    for area in roads.crosswalks:
        part = shapely.intersection(area.polygon, line)
        if part.is_empty:
            continue
        along_m = shapely.line_locate_point(line, shapely.points(shapely.get_coordinates(part)))
        arc_m = float((along_m.min() + along_m.max()) / 2.0)
        if float(along_m.max() - along_m.min()) > LONGEST_CROSSWALK_M or _is_lit(way, arc_m):
            continue
        walk = _walk_on(area.polygon, way, arc_m)
        if walk is not None:
            found.append(Crosswalk(area.id, arc_m, walk))
    return sorted(found, key=lambda each: (each.conflict_m, each.name))


def _walk_on(polygon: shapely.Polygon, way: TripWay, arc_m: float) -> PedestrianWalk | None:
    """Straight across, from the end that is nearer to the ego's way; None where it does not lead from kerb to kerb."""
    x_m, y_m, heading_rad = way.line.poses_at(arc_m)[0].tolist()
    corners = shapely.get_coordinates(polygon.minimum_rotated_rectangle)[:4]
    if len(corners) < 4:
        return None
    middles = [(corners[row] + corners[(row + 1) % 4]) / 2.0 for row in range(4)]
    ends = max(((middles[0], middles[2]), (middles[1], middles[3])), key=lambda two: _across(two, heading_rad))
    a, b = ends
    long_m = hypot(*(b - a))
    if not 2.0 < long_m <= LONGEST_CROSSWALK_M or _across(ends, heading_rad) < sin(LEAST_ACROSS_RAD):
        return None
    beyond = (b - a) / long_m * BEYOND_M
    here, there = a - beyond, b + beyond
    if hypot(*(there - (x_m, y_m))) < hypot(*(here - (x_m, y_m))):
        here, there = there, here
    if bool(way.roads.drivable(np.array([here, there])).any()):
        return None
    takes_s = (long_m + 2.0 * BEYOND_M) / WALKS_MPS
    return PedestrianWalk(np.array([here, there]), np.array([0.0]), np.array([takes_s]), WALKER_SIZE_M, arc_m)


def _across(ends: tuple[Floats, Floats], heading_rad: float) -> float:
    """The sine of the angle between two points and a heading."""
    dx, dy = ends[1] - ends[0]
    return float(abs(dx * sin(heading_rad) - dy * cos(heading_rad)) / max(hypot(dx, dy), 1e-9))


def _is_lit(way: TripWay, arc_m: float) -> bool:
    """Whether a connector with a light is near there on the way."""
    return any(is_lit(way.roads, lane) for lane in way.near(arc_m - LIGHT_M, arc_m + LIGHT_M))


def is_lit(roads: Roads, lane: str) -> bool:
    """Whether it is a connector with a light."""
    return lane in roads.connectors and roads.connectors[lane].has_traffic_light


def _corners(pose: Pose, size_m: tuple[float, float]) -> Floats:
    return box_corners(pose.x_m, pose.y_m, pose.heading_rad, *size_m).reshape(4, 2)
