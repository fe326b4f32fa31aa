"""How fast a vehicle may start: safe against its leader, and mild before what it must slow down or stop for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import sqrt

from interplan_sumo.simulation.idm import acceleration_mps2, largest_speed_mps
from interplan_sumo.simulation.vehicle_types import VehicleType

HOLD_S = 3.0
"""No vehicle may hit another within this time if all hold their speed (benchmark.md)."""
HARDEST_FIRST_BRAKING_MPS2 = 2.4
"""Milder than the 3 m/s2 that the benchmark allows in the first two seconds: braking grows as one comes nearer."""
ERRING_MODEL, ERRING_MPS2 = "EIDM", 1.5
"""Its drivers err, and foresee what others do, which SUMO's answer leaves out: they brake up to 1.7 times as hard."""
TURNS_MPS = {"t": 4.0, "l": 8.0, "r": 6.0, "L": 12.0, "R": 12.0}
"""Drivers that err turn no faster, whatever the limit: EIDM's own numbers, times their speed factors (SUMO 1.28)."""
STOPPING_MPS2 = 1.5
"""Comfortable braking towards a light, a junction that may not be open, or a lane with a lower limit."""
LEAST_GAP_M = 0.5
"""As much is left after that time."""
LINE_M = 1.0
"""SUMO's cars stop this far before the end of their lane."""


@dataclass(frozen=True, slots=True)
class StartAhead:
    """What lies ahead of a place where a vehicle may start; distances are from its front bumper."""

    limit_mps: float
    line_m: float | None = None
    """The next junction that may not be open."""
    slower: Sequence[tuple[float, float]] = ()
    """Lanes ahead, connectors among them: where each begins, and its limit."""
    turns: Sequence[tuple[float, str]] = ()
    """Junctions ahead: where each begins, and in which direction the way leads there, as SUMO calls it."""
    leader: tuple[float, float] | None = None
    """Gap to, and speed of, the next one ahead."""
    leaders: Sequence[tuple[float, float]] = ()
    """The same of the next ones ahead on all ways on, whichever it takes."""


def safe(speed_mps: float, gap_m: float, leader_mps: float) -> bool:
    """Whether a follower does not hit its leader within the hold time."""
    return gap_m > LEAST_GAP_M and (speed_mps - leader_mps) * HOLD_S <= gap_m - LEAST_GAP_M


def hardest_mps2(driver: VehicleType, others_mps2: float = HARDEST_FIRST_BRAKING_MPS2) -> float:
    """The hardest braking that its start may lead to: `others_mps2`, and less where drivers err."""
    return ERRING_MPS2 if driver.car_following_model == ERRING_MODEL else others_mps2


def start_speed_mps(
    driver: VehicleType, ahead: StartAhead, *, most_mps: float | None = None, settled: bool = True
) -> float | None:
    """The highest safe start speed; None where even standing is not safe.

    Up to `most_mps`, where it is given, even beyond the limit. `settled` demands
    that its leader's gap is not too short for the speed in the long run.
    """
    limit_mps = ahead.limit_mps
    allowed = [min(limit_mps * driver.speed_factor, driver.max_speed_mps) if most_mps is None else most_mps]
    free = replace(driver, min_gap_m=0.0)  # SUMO's IDM keeps no gap to a line or a limit (measured)
    meets: list[Callable[[float], bool]] = []
    if ahead.line_m is not None:
        room_m = max(0.0, ahead.line_m - LINE_M)
        allowed.append(sqrt(2.0 * STOPPING_MPS2 * room_m))
        meets.append(partial(_stops_mildly, free, limit_mps, room_m))
    for room_m, lower_mps in speeds_ahead_mps(driver, ahead.slower, ahead.turns):
        if lower_mps < limit_mps * driver.speed_factor:
            allowed.append(sqrt(lower_mps**2 + 2.0 * STOPPING_MPS2 * max(0.0, room_m)))
            meets.append(partial(_slows_mildly, free, limit_mps, max(0.0, room_m), lower_mps))
    allowed += [leader_mps + max(0.0, gap_m - LEAST_GAP_M) / HOLD_S for gap_m, leader_mps in ahead.leaders]
    if ahead.leader is None:
        return largest_speed_mps(allowed, meets)
    gap_m, leader_mps = ahead.leader
    if gap_m <= driver.min_gap_m:
        return None

    def in_equilibrium(speed_mps: float) -> bool:
        return acceleration_mps2(driver, speed_mps, limit_mps, gap_m, speed_mps) >= 0.0

    def brakes_mildly(speed_mps: float) -> bool:
        return acceleration_mps2(driver, speed_mps, limit_mps, gap_m, leader_mps) >= -hardest_mps2(driver)

    def holds(speed_mps: float) -> bool:
        return safe(speed_mps, gap_m, leader_mps)

    return largest_speed_mps(allowed, [*meets, *([in_equilibrium] if settled else []), brakes_mildly, holds])


def speeds_ahead_mps(
    driver: VehicleType, limits: Sequence[tuple[float, float]], turns: Sequence[tuple[float, str]]
) -> list[tuple[float, float]]:
    """How fast a driver drives at most on lanes with such limits and, if it errs, in turns, and from where on."""
    errs = driver.car_following_model == ERRING_MODEL
    in_turns = [(room_m, TURNS_MPS[way]) for room_m, way in turns if way in TURNS_MPS] if errs else []
    return [(room_m, mps * driver.speed_factor) for room_m, mps in (*limits, *in_turns)]


def _stops_mildly(free: VehicleType, limit_mps: float, room_m: float, speed_mps: float) -> bool:
    """Whether a car stops at a line `room_m` ahead with a mild first step."""
    return speed_mps == 0.0 or acceleration_mps2(free, speed_mps, limit_mps, room_m, 0.0) >= -hardest_mps2(free)


def _slows_mildly(free: VehicleType, limit_mps: float, room_m: float, lower_mps: float, speed_mps: float) -> bool:
    """Whether a car may come at this speed to a lane `room_m` ahead with a lower limit.

    As SUMO's IDM slows down: as if to stop there, or at the gap that it would
    keep behind a car as fast as the lower limit, if that is longer.
    """
    if speed_mps <= lower_mps:
        return True
    comfort_mps2 = 2.0 * sqrt(free.accel_mps2 * free.decel_mps2)
    secure_m = speed_mps * free.tau_s + speed_mps * (speed_mps - lower_mps) / comfort_mps2
    return acceleration_mps2(free, speed_mps, limit_mps, max(room_m, secure_m), 0.0) >= -hardest_mps2(free)
