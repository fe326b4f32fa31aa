"""Courtesy: how those who come towards the ego will take it that it enters their lane.

A cautious driver brakes as soon as the ego's box touches its lane; those
behind it have to wait as well. A plan that counts on it is a guess: the
simulator has the last word.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from interplan_sumo.simulation.episode import DT_S
from interplan_sumo.simulation.idm import acceleration_mps2
from interplan_sumo.simulation.vehicle_types import ENTRY, VehicleType, read_vehicle_types, vehicle_type_file
from interplan_sumo.verification.corridor import GRID_M, FrenetCorridor
from interplan_sumo.verification.drivable_paths import HALF_LENGTH_M, DrivablePath
from interplan_sumo.verification.observed_traffic import ObservedTraffic
from interplan_sumo.verification.planning_problem import (
    STEP_FRAMES,
    Margins,
    Pace,
    PlanningProblem,
    ProfileStart,
    SpeedProfile,
    TimeGate,
)
from interplan_sumo.verification.speed_lattice import cheapest_profile
from interplan_sumo.world.geometry import Floats

CAUTIOUS_OVERLAP = 0.2
"""Whoever reacts from this share of the ego's box in its lane on, or from less, is cautious."""
COMING_MPS = -1.0
"""Whoever drives along the line more slowly than this comes towards the ego."""
QUEUE_GAP_M = 1.0
FAR_M = 150.0
"""Farther away nobody brakes for the ego yet."""
RAMP_M = 8.0
"""So near to the ends of a swerve the ego may still, or again, get out of the way."""
GUESSES = 3
"""How often the drivers' answer to the ego and the ego's answer to it are worked out in turn."""
LAST_STEPS = 6
"""Later than so many steps before the end nobody need begin to pass."""


def yielding_profiles(
    problem: PlanningProblem, path: DrivablePath, start: ProfileStart, margins: Margins, pace: Pace
) -> list[tuple[SpeedProfile, TimeGate]]:
    """Timings that enter the oncoming lane when a cautious driver lets the ego pass, the cheapest first.

    The problem's recording is one in which the ego stays on its side. `path` is
    the one on which it starts. Each speed profile comes with the gate that holds it to
    the moment in which it enters.
    """
    entry_m, exit_m = _swerve(problem.corridor, path)
    base, alone = problem.others, _without_coming(problem.others)
    drivers = _drivers(problem.corridor)

    def planned(others: ObservedTraffic, gate: TimeGate) -> SpeedProfile | None:
        return cheapest_profile(replace(problem, others=others), start, margins, pace, gate)

    found: list[tuple[SpeedProfile, TimeGate]] = []
    for step in range((problem.frames - start.frame) // STEP_FRAMES - LAST_STEPS):
        gate = TimeGate(entry_m, step)
        profile = planned(alone, gate)
        for turn in range(GUESSES):
            guess = None if profile is None else _yielded(base, drivers, profile, entry_m, exit_m)
            if profile is None or guess is None or (turn == 0 and _meets(guess, profile, entry_m, exit_m)):
                profile = None
                break
            profile = planned(guess, gate)
        if profile is not None and profile.to_goal:
            found.append((profile, gate))
    return sorted(found, key=lambda each: each[0].cost)


def entry_arc_m(corridor: FrenetCorridor, path: DrivablePath) -> float | None:
    """Arc of the ego's centre where its path first leaves the lane; None if it never does."""
    return _swerve(corridor, path)[0] if path.swerving.any() else None


def _without_coming(others: ObservedTraffic) -> ObservedTraffic:
    """A recording without those who ever come towards the ego."""
    stay = ~(np.nan_to_num(others.along_mps) < COMING_MPS).any(axis=1)
    return ObservedTraffic(*(getattr(others, f.name)[stay] for f in fields(others)))


def _swerve(corridor: FrenetCorridor, path: DrivablePath) -> tuple[float, float]:
    """Arcs of the ego's centre where its path first leaves the lane, and where it is back."""
    rows = np.flatnonzero(path.swerving)
    return float(corridor.arc_m[rows[0]]) - GRID_M, float(corridor.arc_m[rows[-1]]) + GRID_M


def _drivers(corridor: FrenetCorridor) -> dict[str, VehicleType]:
    """Vehicle types of a scenario by the names of their behaviour."""
    path = vehicle_type_file(corridor.scenario.traffic.behaviour)
    types = read_vehicle_types(path)
    return {path.stem if each.id == ENTRY else each.id: each for each in (*types.members, *types.others)}


def _yielded(
    others: ObservedTraffic, drivers: dict[str, VehicleType], profile: SpeedProfile, entry_m: float, exit_m: float
) -> ObservedTraffic | None:
    """A recording as it might be with an ego that drives as timed in the oncoming lane; None if nobody gives way.

    The nearest cautious driver who comes towards it follows IDM from the
    moment it enters until it is back; those farther away queue behind.
    """
    ego_m, ego_mps = _ego(profile, others.frames)
    inside = np.flatnonzero((ego_m > entry_m) & (ego_m < exit_m))
    if not len(inside):
        return None
    frame = int(inside[0])
    near, along = others.near_m[:, frame], others.along_mps[:, frame]
    front_m = ego_m[frame] + HALF_LENGTH_M
    coming = np.isfinite(near) & (along < COMING_MPS) & (near > front_m) & (near < front_m + FAR_M)
    order = np.argsort(np.where(coming, near, np.inf), kind="stable")[: int(coming.sum())].tolist()
    cautious = [k for k, row in enumerate(order) if _is_cautious(drivers.get(str(others.behaviour[row])))]
    if not cautious:
        return None
    near_m, far_m, along_mps = others.near_m.copy(), others.far_m.copy(), others.along_mps.copy()
    barrier: Floats = np.full(others.frames - frame, -np.inf)
    for k, row in enumerate(order[cautious[0] :]):
        length_m = float(others.far_m[row, frame] - others.near_m[row, frame])
        driver = drivers.get(str(others.behaviour[row]))
        if k == 0 and driver is not None:
            until = int(inside[-1]) + 1
            place = _braking(driver, float(near[row]), -float(along[row]), ego_m, ego_mps, frame, until)
        else:
            place = near_m[row, frame:]
        place = np.fmax(place, barrier)
        near_m[row, frame:], far_m[row, frame:] = place, place + length_m
        along_mps[row, frame:] = np.gradient(place, DT_S) if len(place) > 1 else 0.0
        barrier = place + length_m + QUEUE_GAP_M
    return replace(others, near_m=near_m, far_m=far_m, along_mps=along_mps)


def _meets(others: ObservedTraffic, profile: SpeedProfile, entry_m: float, exit_m: float) -> bool:
    """Whether somebody who comes towards the ego is upon it while it is in the oncoming lane: then nothing helps."""
    ego_m, _ = _ego(profile, others.frames)
    inside = (ego_m > entry_m + RAMP_M) & (ego_m < exit_m - RAMP_M)
    with np.errstate(invalid="ignore"):
        coming = others.along_mps < COMING_MPS
        upon = (others.near_m < ego_m + HALF_LENGTH_M) & (others.far_m > ego_m - HALF_LENGTH_M)
    return bool((coming & upon & inside).any())


def _is_cautious(driver: VehicleType | None) -> bool:
    return driver is not None and driver.react_overlap <= CAUTIOUS_OVERLAP


def _ego(profile: SpeedProfile, frames: int) -> tuple[Floats, Floats]:
    """Arc and speed (F,) of the ego as timed; before the speed profile and after it as at its ends."""
    at_s = DT_S * (np.arange(frames) - profile.frame)
    knots_s = np.arange(len(profile.arc_m), dtype=np.float64) * DT_S * STEP_FRAMES
    beyond_s = np.maximum(at_s - knots_s[-1], 0.0)
    arc = np.interp(at_s, knots_s, profile.arc_m) + profile.speed_mps[-1] * beyond_s
    return arc, np.interp(at_s, knots_s, profile.speed_mps)


def _braking(
    driver: VehicleType, place_m: float, speed_mps: float, ego_m: Floats, ego_mps: Floats, frame: int, until: int
) -> Floats:
    """Where the front of a driver is in each frame from `frame` on who meets the ego until frame `until`."""
    places = np.empty(len(ego_m) - frame)
    limit_mps = max(speed_mps, 1.0)
    for i, k in enumerate(range(frame, len(ego_m))):
        places[i] = place_m
        gap_m = place_m - float(ego_m[k]) - HALF_LENGTH_M if k < until else 1e3
        leader_mps = -float(ego_mps[k]) if k < until else speed_mps
        push = acceleration_mps2(driver, speed_mps, limit_mps, gap_m, leader_mps)
        push = max(-driver.emergency_decel_mps2, push)
        moved_mps = max(0.0, speed_mps + push * DT_S)
        place_m, speed_mps = place_m - moved_mps * DT_S, moved_mps
    return places
