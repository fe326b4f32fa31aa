"""Jaywalking: when a jaywalker sets off, and the way that it takes across the road."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from interplan_sumo.scenario.scenario import Jaywalker, WalkStage
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import Roads

NEAREST_TRIGGER_M = 8.0
FARTHEST_TRIGGER_M = 50.0
TRIGGER_TIME_S = 4.0


def trigger_distance_m(ego_mps: float) -> float:
    """How near, along the route, the ego's front bumper must be to the crossing to begin to walk (decisions.md)."""
    return max(NEAREST_TRIGGER_M, min(FARTHEST_TRIGGER_M, TRIGGER_TIME_S * ego_mps))


@dataclass(frozen=True, slots=True, eq=False)
class PedestrianWalk:
    """One jaywalker's way across, in the map frame: straight from point to point, standing in between."""

    points: Floats
    """(K, 2)"""
    leaves_s: Floats
    """(K - 1,) when it leaves each point but the last, since it set off."""
    arrives_s: Floats
    """(K - 1,) when it comes to each point but the first."""
    size_m: tuple[float, float]
    """Length, along the way, and width."""
    conflict_m: float
    """Where the way first crosses the ego's route, arc length on the route's line."""

    @property
    def start(self) -> tuple[float, float]:
        return float(self.points[0, 0]), float(self.points[0, 1])

    @property
    def duration_s(self) -> float:
        return float(self.arrives_s[-1])

    def poses(self, walked_s: Floats) -> Floats:
        """(N, 3) poses so long after setting off; negative times wait. Who stands looks where it goes next."""
        leg = np.minimum(np.searchsorted(self.arrives_s, walked_s, side="right"), len(self.arrives_s) - 1)
        way = self.points[leg + 1] - self.points[leg]
        length_m = np.hypot(way[:, 0], way[:, 1])
        takes_s = np.maximum(self.arrives_s[leg] - self.leaves_s[leg], 1e-9)
        share = np.clip((walked_s - self.leaves_s[leg]) / takes_s, 0.0, 1.0)
        x_m, y_m = (self.points[leg] + share[:, None] * way).T
        there = np.where(length_m > 0.0, np.arctan2(way[:, 1], way[:, 0]), np.nan)
        return np.stack((x_m, y_m, np.where(np.isnan(there), self._first_heading_rad, there)), axis=1)

    @property
    def _first_heading_rad(self) -> float:
        way = next(b - a for a, b in pairwise(self.points) if np.hypot(*(b - a)) > 0.0)
        return float(np.arctan2(way[1], way[0]))

    def speed_mps(self, walked_s: float) -> float:
        """How fast it goes so long after setting off."""
        leg = int(np.searchsorted(self.arrives_s, walked_s, side="right"))
        if leg == len(self.arrives_s) or walked_s < self.leaves_s[leg]:
            return 0.0
        takes_s = float(self.arrives_s[leg] - self.leaves_s[leg])
        return float(np.hypot(*(self.points[leg + 1] - self.points[leg]))) / takes_s


def walk(jaywalker: Jaywalker, roads: Roads, route: Polyline) -> PedestrianWalk:
    """The way of a jaywalker; where it does not cross the route's line, the nearest point stands for the crossing."""
    poses = [place.pose(roads) for place in jaywalker.places]
    points = np.array([(pose.x_m, pose.y_m) for pose in poses])
    stages = (*jaywalker.via, WalkStage(jaywalker.end, jaywalker.speed_mps))
    leaves_s: list[float] = []
    arrives_s: list[float] = []
    now_s = 0.0
    for (a, b), stage in zip(pairwise(points), stages, strict=True):
        leaves_s.append(now_s)
        arrives_s.append(now_s + float(np.hypot(*(b - a))) / stage.speed_mps)
        now_s = arrives_s[-1] + stage.wait_s
    way = shapely.LineString(points)
    crossing = shapely.intersection(way, route.linestring)
    met = shapely.get_coordinates(crossing) if not crossing.is_empty else shapely.get_coordinates(way.centroid)
    along_m = shapely.line_locate_point(way, shapely.points(met))
    conflict_m = float(route.project(met[[int(np.argmin(along_m))]])[0][0])
    return PedestrianWalk(points, np.array(leaves_s), np.array(arrives_s), jaywalker.size_m, conflict_m)
