"""The Intelligent Driver Model as nuPlan solves it (Treiber, Hennecke and Helbing, 2000)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import Generic, TypeVar

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


Number = TypeVar("Number", float, Floats)


@dataclass(frozen=True, slots=True)
class IdmLaw(Generic[Number]):
    """The model, clipped to the driver's limits: for one car (floats), or for N with target speeds of their own.

    Both do the same sums in the same order. `many` keeps the driver's numbers
    as arrays, for numpy takes longer for an array and a number than for two
    short arrays; `one` does without numpy, which is faster still for one car.
    """

    min_gap_m: Number
    headway_s: Number
    softness_mps2: Number
    most_mps2: Number
    least_mps2: Number
    all: Number
    """1."""
    power: Callable[[Number], Number]
    """To the driver's exponent."""
    larger: Callable[[Number, Number], Number]
    smaller: Callable[[Number, Number], Number]

    @staticmethod
    def many(driver: IdmDriver, count: int) -> IdmLaw[Floats]:
        """For `count` cars; everything is (N,)."""
        gap_m, headway_s, softness, most, least, one = (np.full(count, number) for number in _numbers(driver))
        exponents = np.full(count, driver.exponent)
        return IdmLaw(
            gap_m,
            headway_s,
            softness,
            most,
            least,
            one,
            lambda ratios: np.power(ratios, exponents),
            np.maximum,
            np.minimum,
        )

    @staticmethod
    def one(driver: IdmDriver) -> IdmLaw[float]:
        """For one car."""
        ratios, exponents = np.empty(1), np.full(1, driver.exponent)

        def power(ratio: float) -> float:
            ratios[0] = ratio  # numpy's power, which is not always that of the C library to the last bit
            return float(np.power(ratios, exponents)[0])

        return IdmLaw(*_numbers(driver), power, max, min)

    def acceleration_mps2(self, speed_mps: Number, target_mps: Number, gap_m: Number, lead_mps: Number) -> Number:
        closing_mps = speed_mps - lead_mps
        wished_gap_m = self.min_gap_m + speed_mps * (self.headway_s + closing_mps / self.softness_mps2)
        ratio = wished_gap_m / self.larger(gap_m, self.min_gap_m)
        free = self.power(speed_mps / target_mps)
        acceleration = self.most_mps2 * (self.all - free - ratio * ratio)
        return self.smaller(self.larger(acceleration, self.least_mps2), self.most_mps2)


def _numbers(driver: IdmDriver) -> tuple[float, float, float, float, float, float]:
    most_mps2, least_mps2 = driver.max_acceleration_mps2, -driver.max_deceleration_mps2
    return driver.min_gap_m, driver.headway_s, driver.softness_mps2, most_mps2, least_mps2, 1.0
