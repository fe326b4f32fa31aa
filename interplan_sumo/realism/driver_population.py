"""A population of drivers as one distribution over everything that tells them apart, and drivers drawn from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtri

from interplan_sumo.errors import InputError
from interplan_sumo.realism.car_following import PARAMETERS
from interplan_sumo.realism.driver_fit import DriverFit
from interplan_sumo.realism.published import (
    CRITICAL_GAP_SIGMA,
    CRITICAL_LAG_GAP_S,
    CRITICAL_LEAD_GAP_S,
    LANE_CHANGE_S,
    REACTION_S,
    SMALLEST_CRITICAL_GAP_S,
)
from interplan_sumo.world.geometry import Floats

QUALITIES: Final = (*PARAMETERS, "reaction_s", "critical_gap_s", "lane_change_s")
"""Columns of drawn drivers: those of the fit, then what is drawn independently of them."""
CAUTION: Final = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 0.0, 1.0, 1.0])
"""Towards where a cautious driver lies: longer gaps, gentler pedals, slower, larger gaps to merge into."""
BOUNDS: Final = np.array(
    [(0.2, 4.0), (1.2, 12.0), (0.4, 4.0), (1.2, 3.0), (0.5, 1.6), (0.3, 1.6), (SMALLEST_CRITICAL_GAP_S, 4.0),
     (1.5, 12.0)]
)  # fmt: skip
"""Within which drawn drivers stay: people drive beyond them now and then, models do not drive well there."""
FEWEST, MOST_DRAWN = 8, 4096
LARGEST_SHIFT: Final = 0.45
SEED: Final = 24


@dataclass(frozen=True, slots=True, eq=False)
class DriverPopulation:
    """Logarithms of `QUALITIES`, jointly normal."""

    mean: Floats
    """(8,)"""
    covariance: Floats
    """(8, 8)"""

    @classmethod
    def of(cls, fit: DriverFit) -> DriverPopulation:
        """A fitted population of `PARAMETERS`, with what has been published about the rest."""
        # Both sides are accepted by one factor in SUMO: their geometric mean. Half of the variance is the driver's.
        critical_s = np.sqrt(CRITICAL_LEAD_GAP_S * CRITICAL_LAG_GAP_S)
        rest = (REACTION_S, (critical_s, CRITICAL_GAP_SIGMA / np.sqrt(2.0)), LANE_CHANGE_S)
        whole = np.diag([0.0] * len(PARAMETERS) + [sigma**2 for _, sigma in rest])
        whole[: len(PARAMETERS), : len(PARAMETERS)] = fit.covariance
        return cls(np.append(fit.mean, [np.log(median) for median, _ in rest]), whole)

    def drawn(self, count: int, shift: float = 0.0) -> Floats:
        """(count, 8) drivers, the same for the same population; spread evenly over it, by Sobol's sequence.

        With a `shift` every driver becomes more cautious (bolder below 0): the
        one in the middle is then as cautious as who was at quantile 0.5 + shift.
        """
        check_drawn(count, shift)
        from scipy.stats import qmc  # half a second that only those who draw drivers should wait

        sobol = qmc.Sobol(len(QUALITIES), scramble=True, rng=np.random.default_rng(SEED))
        shares = sobol.random_base2(int(np.ceil(np.log2(count))))[:count]
        scores = ndtri(shares.clip(1e-6, 1.0 - 1e-6))
        logs = self.mean + scores @ np.linalg.cholesky(self.covariance).T
        logs += ndtri(0.5 + shift) * CAUTION * np.sqrt(np.diag(self.covariance))
        return np.exp(logs).clip(*BOUNDS.T)


def check_drawn(count: int, shift: float) -> None:
    """InputError for a number of drivers, or a shift, with which none can be drawn."""
    if not FEWEST <= count <= MOST_DRAWN:
        raise InputError(f"{count} drivers are asked for, expected {FEWEST} to {MOST_DRAWN}")
    if not -LARGEST_SHIFT <= shift <= LARGEST_SHIFT:
        raise InputError(f"the shift is {shift:g}, expected {-LARGEST_SHIFT} to {LARGEST_SHIFT} quantiles")
