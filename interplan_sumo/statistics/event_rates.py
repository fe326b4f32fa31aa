"""Event rates: how far a rate of rare events may be from the truth, by a bootstrap over clusters of observations.

The logarithm of a rate is nearer to a normal distribution than the rate, and
its interval never reaches below 0:

    rate * exp(-+ t * se),   se the standard deviation of log(rate) over draws,

with t Student's quantile of G - 1 degrees of freedom for G clusters. Of G
clusters G - 1 are drawn with replacement, which gives the draws the right
variance (Rao and Wu, JASA 83, 1988). Clusters are drawn, not observations,
because what begins at one place is alike (Davison and Hinkley, Bootstrap
Methods and their Application, 1997, 3.8). `benchmarks/rate_coverage.py` says
how often such intervals hold the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import exp, inf, log
from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.statistics.intervals import CONFIDENCE, DRAWS, SEED, Range

Floats = NDArray[np.float64]
FEWEST_EFFECTIVE: Final = 30.0
"""Events, for an interval: of fewer their own variance is not known."""


@dataclass(frozen=True, slots=True)
class ClusterRate:
    """A rate, and how well it is known from clusters that are alike."""

    value: float
    log_error: float
    """Standard error of the logarithm of the rate; infinite where the rate is 0."""
    degrees_of_freedom: float

    def interval(self, confidence: float = CONFIDENCE) -> Range:
        """That holds the true rate with this confidence."""
        farther = exp(self.half_width_of_log(confidence))
        return self.value / farther, self.value * farther

    def half_width_of_log(self, confidence: float = CONFIDENCE) -> float:
        """By which factor, as a logarithm, the interval reaches to either side."""
        from scipy.special import stdtrit  # here, as most commands need no quantiles

        return float(stdtrit(self.degrees_of_freedom, 0.5 + confidence / 2.0)) * self.log_error

    def half_width(self, confidence: float = CONFIDENCE) -> float:
        """Half the interval over the rate."""
        return float(np.sinh(self.half_width_of_log(confidence)))


class ClusterSums:
    """What clusters add to each of some columns, and sums over clusters that are drawn again."""

    def __init__(self, rows: Floats, clusters: Sequence[object]) -> None:
        """`rows` (N, C) are observations, each of a cluster."""
        names, group = np.unique([str(each) for each in clusters], return_inverse=True)
        self.clusters = len(names)
        self._sums = np.zeros((self.clusters, rows.shape[1]))
        np.add.at(self._sums, group, rows)
        self.total: Floats = self._sums.sum(axis=0)

    @cached_property
    def drawn(self) -> Floats:
        """(2000, C), sums over drawn clusters."""
        return cluster_draws(self.clusters) @ self._sums * (self.clusters / (self.clusters - 1.0))

    def rate(self, of: Callable[[Floats], Floats]) -> ClusterRate | None:
        """A rate that is a function of sums (..., C); None with fewer than two clusters, or where it is 0."""
        value = float(of(self.total))
        if self.clusters < 2 or not value > 0.0:
            return None
        rates = of(self.drawn)
        logs = np.log(rates[np.isfinite(rates) & (rates > 0.0)])
        error = float(logs.std()) if len(logs) > DRAWS / 2 else inf
        return ClusterRate(value, error, self.clusters - 1.0)


@lru_cache(maxsize=8)
def cluster_draws(clusters: int) -> Floats:
    """(2000, clusters): how often each is drawn; the same for equal numbers of clusters."""
    chances = np.full(clusters, 1.0 / clusters)
    return np.random.default_rng(SEED).multinomial(clusters - 1, chances, DRAWS).astype(np.float64)


def effective_size(weights: Floats) -> float:
    """So many equal weights would say as much: the square of their sum over the sum of squares (Kish, 1965)."""
    squares = float(np.sum(weights**2))
    return float(np.sum(weights)) ** 2 / squares if squares > 0.0 else 0.0


def relative_to_log(half_width: float) -> float:
    """The half-width of the logarithm at which half the interval over the rate is this."""
    return log(half_width + (1.0 + half_width**2) ** 0.5)
