"""Detection: which rows of a table differ by more than chance, and how large a difference it would find."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import numpy as np

from interplan_sumo.statistics.intervals import (
    DIFFERENCES,
    POINTS,
    MeanEstimate,
    mean_estimate,
    unpaired_difference,
)
from interplan_sumo.statistics.scene_values import DriveValues, differences

SIGNIFICANCE: Final = 0.05
POWER: Final = 0.8


@dataclass(frozen=True, slots=True)
class RowPair:
    """The difference between two rows, by their numbers: b less a."""

    a: int
    b: int
    estimate: MeanEstimate
    paired: bool
    """Whether it is taken scene by scene and seed by seed; else the rows have no drive in common."""


@dataclass(frozen=True, slots=True)
class Contrast:
    """A pair of rows among all pairs of a table."""

    pair: RowPair
    adjusted_p: float
    """After Holm."""

    @property
    def told_apart(self) -> bool:
        return self.adjusted_p < SIGNIFICANCE


def row_pairs(rows: Sequence[DriveValues]) -> list[RowPair]:
    """All pairs of rows of points that can be compared, those that share a drive on the drives that they share."""
    alone = [mean_estimate(row, POINTS) for row in rows]
    pairs: list[RowPair] = []
    for a, b in combinations(range(len(rows)), 2):
        shared = differences(rows[a], rows[b])
        found = mean_estimate(shared, DIFFERENCES) if shared else _unpaired(alone[a], alone[b])
        if found is not None:
            pairs.append(RowPair(a, b, found, bool(shared)))
    return pairs


def _unpaired(a: MeanEstimate | None, b: MeanEstimate | None) -> MeanEstimate | None:
    return unpaired_difference(a, b) if a and b else None


def contrasts(pairs: Sequence[RowPair]) -> list[Contrast]:
    """The pairs with p values after Holm.

    Over all pairs and not only over those with the best row, because which row
    is the best is seen only in the results.
    """
    adjusted = holm([pair.estimate.p_value for pair in pairs])
    return [Contrast(pair, p) for pair, p in zip(pairs, adjusted, strict=True)]


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjusted p values: those below 0.05 hold together with at most 5 % risk of any wrong one (Holm, 1979).

    The k-th smallest of m, k from 0, times m - k; never smaller than the one before, at most 1.
    """
    order = np.argsort(p_values, kind="stable")
    factors = len(p_values) - np.arange(len(p_values))
    adjusted = np.minimum(np.maximum.accumulate(np.array(p_values, dtype=np.float64)[order] * factors), 1.0)
    found = np.empty(len(p_values))
    found[order] = adjusted
    return found.tolist()


def least_detectable_difference(estimate: MeanEstimate) -> float | None:
    """The true difference that shows with p < 0.05 in 80 of 100 such comparisons; in the unit of the figure.

    (t_0.975 + t_0.8) * standard error of the difference, quantiles of Student's
    distribution with its degrees of freedom (Bloom, Evaluation Review 19, 1995);
    about 2.8 standard errors. None where nothing varies: there is nothing to
    tell from.
    """
    from scipy.special import stdtrit

    if estimate.standard_error == 0.0:
        return None
    freedom = estimate.degrees_of_freedom
    quantiles = float(stdtrit(freedom, 1.0 - SIGNIFICANCE / 2.0)) + float(stdtrit(freedom, POWER))
    return quantiles * estimate.standard_error
