"""Reference path: the cheapest of the candidates, smoothed, with a speed to aim at on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_learned.gameformer.candidates import REACH_M, Candidate, CandidatePaths
from interplan_planners.common.paths import DrivingPath
from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, Polyline, Pose
from interplan_sumo.world.roads import Roads

OBSTACLE_COST: Final = 10.0
BOUNDARY_COST: Final = 2.0
BESIDE_COST: Final = 1.0
CURVATURE_COST: Final = 0.1
LONGEST_COST: Final = -5.0
STAY_FACTOR: Final = 5.0
"""Leaving the lane costs so much more near traffic lights, and in slow traffic on wide roads."""
WIDE_LANES, SLOW_MPS = 4, 3.0
LIGHTS_M: Final = 60.0
"""What is near: as far as the network sees."""
LOOKED_AT_M: Final = 25.0
"""So much of a path is looked at for obstacles, boundaries and curvature; half of it for moving vehicles."""
ROOM_M: Final = 5.0
"""A path is not preferred for its length with a moving vehicle so near to it."""
AS_LONG_M: Final = 5.0
"""A path that ends so much earlier is as good as the longest."""
SIGHT_M: Final = 30.0
STANDING_MPS: Final = 0.01
"""Vehicles as slow are obstacles."""
USUAL_MPS: Final = 13.0
SLOWEST_MPS, FASTEST_MPS = 3.0, 15.0
BEND_PER_M: Final = 0.1
"""From where a path bends more sharply, the slowest speed is aimed at."""
_KNOT_M: Final = 2.5
_FINE_M: Final = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class ReferencePath:
    """Where the rear axle shall go: a path from the ego on, ego frame."""

    path: DrivingPath
    """Vertices about 0.5 m apart, at most `REACH_M` of it."""
    cap_mps: Floats
    """(N,) speed to aim at, per vertex."""

    def cap_at(self, arc_m: Floats) -> Floats:
        """Speeds to aim at, where one is at arc lengths (K,)."""
        rows = np.searchsorted(self.path.line.arc_m, arc_m, side="right") - 1
        return self.cap_mps[np.clip(rows, 0, len(self.cap_mps) - 1)]


class ReferencePaths:
    """Finds the reference path at each step of one mission."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._candidates = CandidatePaths(mission)
        lights = [each.centerline.linestring for each in mission.roads.connectors.values() if each.has_traffic_light]
        self._lights = np.array(lights, dtype=object)

    def at(self, observation: Observation) -> ReferencePath | None:
        """The path to follow now; None off the route or at its end."""
        here = observation.ego.rear_axle(self._mission.shape)
        found = self._candidates.block_under(here)
        if found is None:
            return None
        index, distances_m = found
        candidates = self._candidates.of(here, index, distances_m)
        if not candidates:
            return None
        slow = self._candidates.lanes_beside(index) >= WIDE_LANES and observation.ego.speed_mps <= SLOW_MPS
        costs = self._costs(candidates, observation, stay=slow or self._near_lights(here))
        limit_mps = self._limit_mps(index)
        return reference_path(
            candidates[int(costs.argmin())].points, EgoFrame.of(observation.ego, self._mission.shape), limit_mps
        )

    def _costs(self, candidates: Sequence[Candidate], observation: Observation, stay: bool) -> Floats:
        """(K,)"""
        half_width_m = self._mission.shape.width_m / 2.0
        begun = [Polyline(each.points).between(0.0, LOOKED_AT_M) for each in candidates]
        starts = np.array([line.linestring for line in begun], dtype=object)
        firsts = np.array([line.between(0.0, LOOKED_AT_M / 2.0).linestring for line in begun], dtype=object)
        obstacles, vehicles = around(observation, self._mission)
        hit = _any_within(starts, obstacles, half_width_m)
        out = np.array([
            bool(_any_within(starts[k : k + 1], outer_boundaries(self._mission.roads, each.lanes), half_width_m)[0])
            for k, each in enumerate(candidates)
        ])  # fmt: skip
        length_m = np.array([each.length_m for each in candidates])
        free = ~_any_within(firsts, vehicles, half_width_m + ROOM_M) & (length_m >= length_m.max() - AS_LONG_M)
        beside_m = np.array([each.beside_m for each in candidates])
        bend = np.array([largest_curvature(line) for line in begun])
        return (
            OBSTACLE_COST * hit
            + BOUNDARY_COST * out
            + BESIDE_COST * (STAY_FACTOR if stay else 1.0) * beside_m
            + CURVATURE_COST * bend
            + LONGEST_COST * free
        )

    def _near_lights(self, here: Pose) -> bool:
        return bool(shapely.dwithin(self._lights, shapely.Point(here.x_m, here.y_m), LIGHTS_M).any())

    def _limit_mps(self, index: int) -> float:
        """What the first lane of a roadblock of the route allows, within bounds."""
        roads = self._mission.roads
        first = roads.roadblocks[self._mission.route[index]].lane_ids[0]
        return min(max(roads[first].speed_limit_mps or USUAL_MPS, SLOWEST_MPS), FASTEST_MPS)


def around(observation: Observation, mission: Mission) -> tuple[NDArray[np.object_], NDArray[np.object_]]:
    """Boxes near the ego: of what stands in the way (things and standing vehicles), and of moving vehicles."""
    actors = observation.actors
    vehicle, standing = actors.kind == ActorKind.VEHICLE, actors.speed_mps < STANDING_MPS
    thing = actors.kind > ActorKind.BICYCLE
    near = shapely.distance(actors.polygons, observation.ego.polygon(mission.shape)) <= SIGHT_M
    return actors.polygons[near & (thing | (vehicle & standing))], actors.polygons[near & vehicle & ~standing]


def outer_boundaries(roads: Roads, lanes: Sequence[str]) -> NDArray[np.object_]:
    """Boundaries of lanes and connectors on sides where there is no neighbour."""
    lines = [roads[lane].left_boundary.linestring for lane in lanes if roads.left_of(lane) is None]
    lines += [roads[lane].right_boundary.linestring for lane in lanes if roads.right_of(lane) is None]
    return np.array(lines, dtype=object)


def largest_curvature(line: Polyline) -> float:
    """1/m, from headings a metre apart."""
    headings = line.poses_at(np.arange(0.5, line.length_m, 1.0))[:, 2]
    return float(np.abs(np.diff(headings)).max(initial=0.0))


def reference_path(points: Floats, frame: EgoFrame, limit_mps: float) -> ReferencePath:
    """A path (N, 2), map frame, as a cubic spline in the ego frame with its speed."""
    from scipy.interpolate import CubicSpline  # a third of a second that only those who drive should wait

    line = Polyline(frame.points(points))
    length_m = min(line.length_m, REACH_M)
    knots_m = np.linspace(0.0, length_m, max(round(length_m / _KNOT_M), 2) + 1)
    spline = CubicSpline(knots_m, line.poses_at(knots_m)[:, :2], bc_type="natural")
    at_m = np.linspace(0.0, length_m, max(round(length_m / _FINE_M), 2) + 1)
    (dx, dy), (ddx, ddy) = spline(at_m, 1).T, spline(at_m, 2).T
    curvature = np.abs(dx * ddy - dy * ddx) / np.maximum(np.hypot(dx, dy), 1e-6) ** 3
    sharp = np.flatnonzero(curvature > BEND_PER_M)
    cap_mps = np.full(len(at_m), limit_mps)
    if sharp.size:
        cap_mps[sharp[0] :] = SLOWEST_MPS
    return ReferencePath(DrivingPath(Polyline(spline(at_m))), cap_mps)


def _any_within(lines: NDArray[np.object_], shapes: NDArray[np.object_], distance_m: float) -> NDArray[np.bool_]:
    """(K,) whether any of the shapes comes so near to each of the lines."""
    near = shapely.dwithin(lines[:, None], shapes[None, :], distance_m)
    return np.asarray(near.any(axis=1))
