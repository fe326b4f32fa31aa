"""Populations of drivers that others have published: what a fit falls back on where recordings tell nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from interplan_sumo.world.geometry import Floats

Road = Literal["city", "motorway"]

CORRELATIONS: Final = {(0, 4): -0.25, (0, 2): -0.26, (1, 4): 0.13}
"""Between the desired speed and T, T and a, the desired speed and s0: I-24 MOTION at a merge, 2,935 fits."""


@dataclass(frozen=True, slots=True, eq=False)
class DriverPrior:
    """What is believed of a population before its recordings are seen; of logarithms, in the order T, s0, a, b, factor.

    The covariance counts as much as `COUNTS` drivers.
    """

    mean: Floats
    """(5,)"""
    covariance: Floats
    """(5, 5)"""
    mean_sigma: float
    """How uncertain the mean is."""
    source: str

    def updated(self, drivers: Floats, uncertainty: Floats, weights: Floats) -> tuple[Floats, Floats]:
        """Mean and covariance of the population, given values (D, 5) of its drivers and how uncertain each is.

        Drivers of weight 1 are as usual, those that lie far off have less.
        """
        count, told = float(weights.sum()), len(drivers)
        middle = weights @ drivers / count
        apart = drivers - middle
        spread = np.einsum("d,dp,dq->pq", weights, apart, apart) + np.einsum("d,dpq->pq", weights, uncertainty)
        covariance = (COUNTS * self.covariance + spread) / (COUNTS + told)
        belief = np.eye(len(self.mean)) / self.mean_sigma**2
        known = count * np.linalg.inv(covariance)
        mean = np.linalg.solve(known + belief, known @ middle + belief @ self.mean)
        return mean, covariance


COUNTS: Final = 40.0


def _prior(means: tuple[float, ...], variations: tuple[float, ...], mean_sigma: float, source: str) -> DriverPrior:
    """Of means and coefficients of variation of lognormal numbers."""
    sigma = np.sqrt(np.log1p(np.square(variations)))
    correlation = np.eye(len(means))
    for (row, column), value in CORRELATIONS.items():
        correlation[row, column] = correlation[column, row] = value
    return DriverPrior(np.log(means) - sigma**2 / 2.0, correlation * np.outer(sigma, sigma), mean_sigma, source)


PRIORS: Final[Mapping[Road, DriverPrior]] = {
    "city": _prior(
        (1.17, 3.28, 1.84, 1.29, 1.0),
        (0.35, 0.37, 0.38, 0.52, 0.17),
        0.5,  # means of published populations lie 0.12 (b) to 0.22 (a) apart; recordings of a place soon outweigh them
        "means of TeraSim's urban drivers (Ann Arbor and Waymo), spreads of I-24 MOTION and NGSIM US-101",
    ),
    "motorway": _prior(
        (1.40, 2.28, 1.09, 1.70, 1.1),
        (0.35, 0.37, 0.38, 0.52, 0.17),
        0.02,  # means of twenty thousand episodes: cuts of some seconds from a jam do not change them
        "I-24 MOTION (17,652 episodes) and NGSIM US-101 (2,452 episodes), mean of both",
    ),
}
SIGMA_M: Final = 0.4
"""Of the spacing error to begin with."""
RELAXATION_S: Final = 7.5
"""In which who was cut in on comes back to its own gap: NGSIM US-101, 5.2 to 15.9 s."""
CRITICAL_LEAD_GAP_S: Final = 0.42
CRITICAL_LAG_GAP_S: Final = 0.59
"""Smallest gaps to the new leader and follower that the median driver accepts: I-24 MOTION, 3,213 lane changes."""
CRITICAL_GAP_SIGMA: Final = 1.42
"""Of the logarithm of either, between drivers and situations."""
SMALLEST_CRITICAL_GAP_S: Final = 0.5
"""One accepted gap in twenty is smaller: 0.44 s to the leader, and by the ratio of the tenth percentiles (0.61 and
0.75 s) 0.54 s to the follower, in the same lane changes.
Estimates of critical gaps spread further, but hardly anybody drives so."""
WAVER_MPS2: Final[Mapping[Road, float]] = {"city": 0.4, "motorway": 0.1}
"""Root mean square acceleration of a driver who keeps its speed: ours in three cities; on a free road 0.01 g (Herman,
Montroll, Potts and Rothery, 1959)."""
LANE_CHANGE_S: Final = (4.0, 0.4)
"""How long a lane change takes: median, and sigma of the logarithm (Thiemann, Treiber and Kesting, 2008, NGSIM: mean
4.0 s; Toledo and Zohar, 2007: mean 4.6 s, standard deviation 2.3 s)."""
REACTION_S: Final = (0.9, 0.35)
"""Of drivers behind a leader: median, and sigma of the logarithm (Green, 2000: about 0.75 s when braking is expected,
1.25 s when it is not)."""
