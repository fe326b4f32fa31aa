"""Poisson regression: how a rate depends on what the driving was like, with errors that allow for clusters.

    E[count] = exposure * exp(x b)

by Newton's method on the likelihood (McCullagh and Nelder, Generalized Linear
Models, 1989, 6.2). Only the mean has to be right: with H the information
X' diag(mu) X and s_g the score X' (y - mu) of cluster g, the covariance of b is

    G / (G - 1) * H^-1 (sum over g of s_g s_g') H^-1

(Liang and Zeger, Biometrika 73, 1986), whatever the counts' own variance is, and
also where they are no whole numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.errors import InputError
from interplan_sumo.statistics.intervals import CONFIDENCE, Range

Floats = NDArray[np.float64]
MOST_STEPS: Final = 100


@dataclass(frozen=True)
class PoissonFit:
    """Coefficients (K,) and their covariances (K, K)."""

    coefficients: Floats
    covariance: Floats
    """With errors that allow for clusters."""
    model_covariance: Floats
    """If counts were Poisson and independent."""
    clusters: int

    def rate(self, x: Floats) -> tuple[float, Range]:
        """The rate at the covariates x (K,), or the ratio of two rates at their difference; with its 95 % interval."""
        from scipy.special import stdtrit

        error = float(np.sqrt(max(x @ self.covariance @ x, 0.0)))
        centre, reach = float(x @ self.coefficients), float(stdtrit(self.clusters - 1, 0.5 + CONFIDENCE / 2.0)) * error
        return float(np.exp(centre)), (float(np.exp(centre - reach)), float(np.exp(centre + reach)))


def poisson_regression(x: Floats, counts: Floats, exposure: Floats, clusters: Sequence[object]) -> PoissonFit:
    """Fit rows with covariates x (N, K), counts (N,) and exposures (N,); `clusters` names that of each row.

    The first column is 1. Rows without exposure say only how counts vary.
    InputError where the rates cannot be told: no counts, a covariate that says
    what others say already, or one with no counts at one of its values.
    """
    names, group = np.unique([str(each) for each in clusters], return_inverse=True)
    if len(names) < 2:
        raise InputError("a regression needs segments from two starts at least")
    if not counts.sum() > 0.0 or not exposure.sum() > 0.0:
        raise InputError("a regression needs events")
    if np.linalg.matrix_rank(x[exposure > 0.0]) < x.shape[1]:
        raise InputError("a regression cannot tell apart what it is given: covariates go together")
    endless = InputError("a regression has no finite answer: something has no events at all")
    b = np.zeros(x.shape[1])
    b[0] = np.log(counts.sum() / exposure.sum())
    likelihood = -np.inf
    for _ in range(MOST_STEPS):
        mean = exposure * np.exp(x @ b)
        information = x.T @ (x * mean[:, None])
        if np.linalg.cond(information) > 1e12:
            raise endless
        step = np.linalg.solve(information, x.T @ (counts - mean))
        while True:
            tried = float(counts @ (x @ (b + step)) - np.sum(exposure * np.exp(np.minimum(x @ (b + step), 500.0))))
            if tried >= likelihood - 1e-9 * abs(likelihood) or np.abs(step).max() < 1e-9:
                break
            step = step / 2.0
        b, likelihood = b + step, tried
        if np.abs(step).max() < 1e-9:
            break
    else:
        raise endless
    mean = exposure * np.exp(x @ b)
    inverse: Floats = np.asarray(np.linalg.inv(x.T @ (x * mean[:, None])), dtype=np.float64)
    scores = np.zeros((len(names), x.shape[1]))
    np.add.at(scores, group, x * (counts - mean)[:, None])
    middle = scores.T @ scores * (len(names) / (len(names) - 1.0))
    return PoissonFit(np.asarray(b, dtype=np.float64), inverse @ middle @ inverse, inverse, len(names))
