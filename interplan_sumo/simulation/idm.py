"""SUMO's Intelligent Driver Model in closed form, for what we compute ourselves: start speeds and imposed reactions.

SUMO 1.28's IDM with 0.1 s steps was measured to equal this textbook form
(Treiber, Hennecke and Helbing, 2000) to the last printed digit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import sqrt

from interplan_sumo.simulation.vehicle_types import VehicleType

EXPONENT = 4.0
SMALLEST_GAP_M = 0.1
"""Gaps below this count as this."""


def acceleration_mps2(
    driver: VehicleType, speed_mps: float, limit_mps: float, gap_m: float, leader_mps: float
) -> float:
    """Acceleration behind a leader `gap_m` ahead (bumper to bumper) that drives at `leader_mps` (negative: oncoming).

    A gap below 0.1 m counts as 0.1 m. Not clipped.
    """
    desired_mps = min(limit_mps * driver.speed_factor, driver.max_speed_mps)
    comfort_mps2 = 2.0 * sqrt(driver.accel_mps2 * driver.decel_mps2)
    ratio = wished_gap_m(driver, speed_mps, leader_mps, comfort_mps2) / max(gap_m, SMALLEST_GAP_M)
    return driver.accel_mps2 * (1.0 - (speed_mps / desired_mps) ** EXPONENT - ratio * ratio)


def wished_gap_m(driver: VehicleType, speed_mps: float, leader_mps: float, comfort_mps2: float) -> float:
    """The gap that a vehicle wants behind a leader; `comfort_mps2` is 2 sqrt(a b) of its acceleration and braking."""
    closing = speed_mps * (speed_mps - leader_mps) / comfort_mps2
    return driver.min_gap_m + max(0.0, speed_mps * driver.tau_s + closing)


def largest_speed_mps(allowed: list[float], meets: Sequence[Callable[[float], bool]]) -> float:
    """The largest speed, up to the smallest of `allowed`, that meets every rule; 0 if none does.

    Rules must be monotone: what holds at a speed holds at every lower one.
    """
    low, high = 0.0, max(0.0, min(allowed))
    if all(rule(high) for rule in meets):
        return high
    for _ in range(40):
        middle = (low + high) / 2.0
        if all(rule(middle) for rule in meets):
            low = middle
        else:
            high = middle
    return low
