"""Jaywalking: when a jaywalker sets off, and the way that it takes across the road."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, hypot

import shapely

from interplan_sumo.scenario.scenario import Jaywalker
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Roads

NEAREST_TRIGGER_M = 8.0
FARTHEST_TRIGGER_M = 50.0
TRIGGER_TIME_S = 4.0


def trigger_distance_m(ego_mps: float) -> float:
    """How near, along the route, the ego's front bumper must be to the crossing to begin to walk (decisions.md)."""
    return max(NEAREST_TRIGGER_M, min(FARTHEST_TRIGGER_M, TRIGGER_TIME_S * ego_mps))


@dataclass(frozen=True, slots=True)
class PedestrianWalk:
    """One jaywalker's way across, in the map frame."""

    start: tuple[float, float]
    end: tuple[float, float]
    speed_mps: float
    conflict_m: float
    """Where the way crosses the ego's route, arc length on the route's line."""

    @property
    def heading_rad(self) -> float:
        return atan2(self.end[1] - self.start[1], self.end[0] - self.start[0])

    @property
    def duration_s(self) -> float:
        return hypot(self.end[0] - self.start[0], self.end[1] - self.start[1]) / self.speed_mps


def walk(jaywalker: Jaywalker, roads: Roads, route: Polyline) -> PedestrianWalk:
    """The way of a jaywalker; where it does not cross the route's line, the nearest point stands for the crossing."""
    start, end = jaywalker.start.pose(roads), jaywalker.end.pose(roads)
    way = shapely.LineString([(start.x_m, start.y_m), (end.x_m, end.y_m)])
    crossing = shapely.intersection(way, route.linestring)
    point = shapely.get_coordinates(crossing)[:1] if not crossing.is_empty else shapely.get_coordinates(way.centroid)
    conflict_m = float(route.project(point)[0][0])
    return PedestrianWalk((start.x_m, start.y_m), (end.x_m, end.y_m), jaywalker.speed_mps, conflict_m)
