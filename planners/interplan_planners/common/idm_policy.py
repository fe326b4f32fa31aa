"""The Intelligent Driver Model as nuPlan solves it (Treiber, Hennecke and Helbing, 2000)."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from interplan_sumo.world.geometry import Floats


@dataclass(frozen=True, slots=True)
class IdmDriver:
    """How one drives behind another. Defaults are those of nuPlan's IDM planner but for the target speed."""

    target_speed_mps: float
    min_gap_m: float = 1.0
    headway_s: float = 1.5
    max_acceleration_mps2: float = 1.0
    max_deceleration_mps2: float = 3.0
    """Comfortable deceleration and hard limit at once; positive."""
    exponent: float = 4.0

    @property
    def softness_mps2(self) -> float:
        """How gently a driver closes up: twice the geometric mean of the two limits."""
        return 2.0 * sqrt(self.max_acceleration_mps2 * self.max_deceleration_mps2)


def idm_acceleration_mps2(driver: IdmDriver, speed_mps: float, gap_m: float, lead_speed_mps: float) -> float:
    """The model's acceleration, not clipped.

    `gap_m` runs from bumper to bumper and is floored at the driver's minimum
    gap. An oncoming lead has a negative speed.
    """
    closing_mps = speed_mps - lead_speed_mps
    wished_gap_m = driver.min_gap_m + speed_mps * driver.headway_s + speed_mps * closing_mps / driver.softness_mps2
    free = (speed_mps / driver.target_speed_mps) ** driver.exponent
    return driver.max_acceleration_mps2 * (1.0 - free - (wished_gap_m / max(gap_m, driver.min_gap_m)) ** 2)


def idm_step(
    driver: IdmDriver, speed_mps: float, gap_m: float, lead_speed_mps: float, dt_s: float
) -> tuple[float, float]:
    """Distance travelled and new speed after one explicit Euler step.

    The distance is covered at the old speed; the acceleration is clipped to
    the driver's limits; the new speed is not negative.
    """
    acceleration = idm_acceleration_mps2(driver, speed_mps, gap_m, lead_speed_mps)
    acceleration = max(-driver.max_deceleration_mps2, min(driver.max_acceleration_mps2, acceleration))
    return speed_mps * dt_s, max(0.0, speed_mps + acceleration * dt_s)


def idm_accelerations_mps2(
    driver: IdmDriver, speed_mps: Floats, target_speed_mps: Floats, gap_m: Floats, lead_speed_mps: Floats
) -> Floats:
    """(N,) the model's accelerations, clipped to the driver's limits, for target speeds of their own."""
    closing_mps = speed_mps - lead_speed_mps
    wished_gap_m = driver.min_gap_m + speed_mps * (driver.headway_s + closing_mps / driver.softness_mps2)
    ratio = wished_gap_m / np.maximum(gap_m, driver.min_gap_m)
    free = (speed_mps / target_speed_mps) ** driver.exponent
    acceleration = driver.max_acceleration_mps2 * (1.0 - free - ratio * ratio)
    return np.minimum(np.maximum(acceleration, -driver.max_deceleration_mps2), driver.max_acceleration_mps2)
