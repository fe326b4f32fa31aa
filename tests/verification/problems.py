"""Outlooks for the tests of planning: the little roads of `stages`, and others that are where one says."""

from __future__ import annotations

import numpy as np
from stages import ONE_LANE, staged

from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.verification.corridor import FrenetCorridor, frenet_corridor
from interplan_sumo.verification.drivable_paths import DrivablePath, Swerve, drivable_path
from interplan_sumo.verification.observed_traffic import ObservedTraffic
from interplan_sumo.verification.planning_problem import PlanningProblem, ProfileStart
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads

FRAMES = 300
LENGTH_M, WIDTH_M = 4.6, 1.85


def laid_out(
    scenario: Scenario | None = None, roads: Roads = ONE_LANE, swerve: Swerve | None = None
) -> PlanningProblem:
    """A scenario, nobody else there."""
    unrolled = frenet_corridor(staged() if scenario is None else scenario, roads)
    return PlanningProblem(unrolled, ways_of(unrolled, swerve), nobody(), {}, FRAMES)


def ways_of(unrolled: FrenetCorridor, swerve: Swerve | None = None) -> tuple[DrivablePath, ...]:
    return tuple(drivable_path(unrolled, lane_path, swerve or Swerve()) for lane_path in unrolled.lane_paths)


def start_of(unrolled: FrenetCorridor) -> ProfileStart:
    return ProfileStart(0, unrolled.start_m, unrolled.scenario.start_speed_mps, unrolled.start_path)


def nobody() -> ObservedTraffic:
    return _recording(np.zeros((0, FRAMES)), np.zeros((0, FRAMES)), np.zeros((0, FRAMES)), np.zeros(0), walks=False)


def driving(arc_m: Floats, left_m: Floats | float = 0.0, speed_mps: Floats | float = 0.0) -> ObservedTraffic:
    """One car whose centre is at arcs (F,), on the corridor."""
    speeds = np.broadcast_to(speed_mps, (1, FRAMES)).astype(np.float64)
    centres = np.broadcast_to(left_m, (1, FRAMES)).astype(np.float64)
    return _recording(arc_m[None], centres, speeds, np.zeros(1), walks=False)


def steady(from_m: float, speed_mps: float, left_m: float = 0.0) -> ObservedTraffic:
    """One car at constant speed; a negative one comes towards the ego."""
    return driving((from_m + speed_mps * 0.1 * np.arange(FRAMES)).astype(np.float64), left_m, speed_mps)


def crossing(arc_m: float, from_left_m: float, across_mps: float) -> ObservedTraffic:
    """One pedestrian who walks across at constant speed."""
    left = (from_left_m + across_mps * 0.1 * np.arange(FRAMES)).astype(np.float64)
    still = np.zeros((1, FRAMES))
    return _recording(np.full((1, FRAMES), arc_m), left[None], still, np.array([across_mps]), walks=True)


def _recording(arc_m: Floats, left_m: Floats, along_mps: Floats, across_mps: Floats, *, walks: bool) -> ObservedTraffic:
    length_m, width_m = (0.8, 0.9) if walks else (LENGTH_M, WIDTH_M)
    many = len(arc_m)
    return ObservedTraffic(
        near_m=arc_m - length_m / 2.0,
        far_m=arc_m + length_m / 2.0,
        right_m=left_m - width_m / 2.0,
        left_m=left_m + width_m / 2.0,
        along_mps=along_mps,
        across_mps=np.broadcast_to(across_mps[:, None], (many, FRAMES)).astype(np.float64),
        follows=np.broadcast_to(not walks, (many, FRAMES)) & (along_mps >= 0.0),
        walks=np.full(many, walks),
        behaviour=np.full(many, "test", dtype=object),
    )
