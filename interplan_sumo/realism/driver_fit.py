"""Parameters of every driver and of the population they come from, fitted together by spacing error.

A driver's record lasts some seconds and tells of some parameters only: one that
never stood tells nothing of the standstill gap. So drivers are fitted as a
hierarchy: logarithms of the parameters are normal in the population, and each
driver's are where its own episodes and the population together put them. The
population is found by expectation maximisation with a Gaussian approximation
for each driver (Laplace), so that what a driver does not tell stays at the
population's mean and adds no false certainty.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.realism.car_following import PARAMETERS, EpisodeBatch, simulated_gaps
from interplan_sumo.realism.published import SIGMA_M, DriverPrior
from interplan_sumo.world.geometry import Floats

CORRELATED_S: Final = 1.5
"""Errors of one spacing this far apart tell something new; those between do not."""
TAILS: Final = 4.0
"""Degrees of freedom of the errors of whole episodes: one that no model explains counts little."""
ODD: Final = 4.0
"""Degrees of freedom of the population: one driver who turned off while fitted as a follower does not widen it."""
LOWEST: Final = np.log([0.1, 0.3, 0.2, 0.3, 0.2])
HIGHEST: Final = np.log([6.0, 20.0, 9.0, 12.0, 3.0])
"""Of the parameters; beyond lies nothing that drives."""
NUDGE: Final = 1e-3
"""Of a logarithm, for differences."""
DIRECT: Final = 20
"""Drivers who show a parameter directly."""
ROUNDS: Final = 40
STEPS: Final = 6
"""Of the fit of drivers in each round of the population."""


@dataclass(frozen=True, slots=True, eq=False)
class DriverFit:
    """What was fitted; everything is of logarithms, in the order of `PARAMETERS`."""

    mean: Floats
    """(5,) of the population."""
    covariance: Floats
    """(5, 5)"""
    drivers: Floats
    """(D, 5) most likely values of each driver."""
    uncertainty: Floats
    """(D, 5, 5) covariance of each driver's values, given its record."""
    sigma_m: float
    """Of the spacing error."""

    @property
    def identified(self) -> Floats:
        """(D, 5) the share of the population's variance that a driver's record takes away: 0 tells nothing, 1 all."""
        left = np.diagonal(self.uncertainty, axis1=1, axis2=2) / np.diagonal(self.covariance)
        return np.clip(1.0 - left, 0.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class DriverEvidence:
    """What is known of drivers besides their episodes."""

    values: Floats
    """(D, 5) logarithms of parameters that were seen without a fit; NaN where they were not."""
    trembles: NDArray[np.bool_]
    """(D,) Whose positions tremble so that their accelerations cannot be believed: neither a nor b is told by them."""

    @classmethod
    def of(cls, standstill_gap_m: Floats, speed_factor: Floats, trembles: NDArray[np.bool_]) -> DriverEvidence:
        """From standstill gaps in queues, and cruising speeds over allowed ones; NaN where there is none."""
        values = np.full((len(speed_factor), len(PARAMETERS)), np.nan)
        values[:, 1], values[:, 4] = np.log(standstill_gap_m), np.log(speed_factor)
        return cls(values, trembles)


SEEN_SIGMA: Final = np.array([1.0, 0.15, 1.0, 1.0, 0.03])
"""Of the logarithms of what was seen directly, with the same tails: who cruises before a light,
or far behind a slow one, does not show what it wants."""


def fit_drivers(
    batch: EpisodeBatch, known: DriverEvidence, prior: DriverPrior, population: DriverFit | None = None
) -> DriverFit:
    """Fit all drivers of some episodes and the population; with a `population` only the drivers, as members of it."""
    count = len(known.values)
    mean, covariance = (population.mean, population.covariance) if population else (prior.mean, prior.covariance)
    sigma_m = population.sigma_m if population else SIGMA_M
    drivers = np.tile(mean, (count, 1))
    uncertainty = np.tile(covariance, (count, 1, 1))
    weights = np.ones(count)
    for _ in range(3 if population else ROUNDS):
        precision = np.linalg.inv(covariance)
        each = weights[:, None, None] * precision
        drivers, uncertainty, errors_m2 = _fit_each(batch, known, drivers, mean, each, sigma_m)
        apart = drivers - mean
        far = np.einsum("dp,pq,dq->d", apart, precision, apart) + np.einsum("pq,dqp->d", precision, uncertainty)
        weights = (ODD + len(mean)) / (ODD + far)
        if population is None:
            before, told = mean, batch.rows * batch.step_s / CORRELATED_S
            mean, covariance = _as_seen(*prior.updated(drivers, uncertainty, weights), drivers, known)
            weighted_m2 = (TAILS + told) / (TAILS + told * errors_m2 / sigma_m**2) * told * errors_m2
            fitted = float((1.0 - np.einsum("dpp,p->dp", uncertainty, 1.0 / np.diag(covariance))).clip(0.0).sum())
            sigma_m = float(np.sqrt(weighted_m2.sum() / max(told.sum() - fitted, 1.0)).clip(0.05, 2.0))
            if np.abs(mean - before).max() < 1e-3:
                break
    return DriverFit(mean, covariance, drivers, uncertainty, sigma_m)


def _as_seen(mean: Floats, covariance: Floats, drivers: Floats, known: DriverEvidence) -> tuple[Floats, Floats]:
    """A population with the mean and spread of those who show a parameter directly, where they are enough.

    Queues and cruising drivers tell standstill gaps and desired speeds better
    than the spacing of all followers does. Correlations stay.
    """
    mean, scale = mean.copy(), np.ones(len(mean))
    for column, told in enumerate(np.isfinite(known.values).T):
        if told.sum() >= DIRECT:
            mean[column] = drivers[told, column].mean()
            scale[column] = drivers[told, column].std(ddof=1) / np.sqrt(covariance[column, column])
    return mean, covariance * np.outer(scale, scale)


def _fit_each(
    batch: EpisodeBatch, known: DriverEvidence, start: Floats, mean: Floats, precision: Floats, sigma_m: float
) -> tuple[Floats, Floats, Floats]:
    """Most likely values of each driver, their covariance, and the mean square error of each episode.

    Levenberg and Marquardt's method for all drivers at once.
    """
    drivers, damping = start.copy(), np.full(len(start), 1e-2)
    cost, slope, curvature, errors_m2 = _local(batch, known, drivers, mean, precision, sigma_m)
    eye = np.eye(len(PARAMETERS))
    for _ in range(STEPS):
        scaled = curvature + damping[:, None, None] * eye * np.diagonal(curvature, axis1=1, axis2=2)[:, None, :]
        step = -np.linalg.solve(scaled, slope[..., None])[..., 0]
        tried = np.clip(drivers + np.clip(step, -0.7, 0.7), LOWEST, HIGHEST)
        found = _local(batch, known, tried, mean, precision, sigma_m)
        better = found[0] < cost
        damping = np.where(better, damping / 5.0, damping * 10.0).clip(1e-6, 1e8)
        drivers[better] = tried[better]
        for ours, new in zip((cost, slope, curvature), found[:3], strict=True):
            ours[better] = new[better]
        better_e = better[batch.driver]
        errors_m2[better_e] = found[3][better_e]
    return drivers, np.asarray(np.linalg.inv(curvature), np.float64), errors_m2


def _local(
    batch: EpisodeBatch, known: DriverEvidence, drivers: Floats, mean: Floats, precision: Floats, sigma_m: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Cost of each driver, its gradient and approximate curvature, and the mean square error of each episode."""
    width = len(PARAMETERS)
    shifted = drivers[batch.driver][None] + NUDGE * np.concatenate((np.zeros((1, width)), np.eye(width)))[:, None, :]
    gaps_m = simulated_gaps(batch, np.exp(shifted))
    error_m = (gaps_m[:, 0] - batch.gap_m) * batch.seen
    change = (gaps_m[:, 1:] - gaps_m[:, :1]) / NUDGE * batch.seen[:, None]
    change[:, 2:4] *= ~known.trembles[batch.driver]
    told = batch.rows * batch.step_s / CORRELATED_S
    mean_m2 = (error_m**2).sum(axis=0) / batch.rows
    weight = (TAILS + told) / (TAILS + told * mean_m2 / sigma_m**2) * batch.step_s / CORRELATED_S / sigma_m**2
    slope_e = np.einsum("ke,kpe->ep", error_m, change) * weight[:, None]
    curvature_e = np.einsum("kpe,kqe->epq", change, change) * weight[:, None, None]
    cost_e = (TAILS + told) / 2.0 * np.log1p(told * mean_m2 / sigma_m**2 / TAILS)
    apart = drivers - mean
    cost = np.einsum("dp,dpq,dq->d", apart, precision, apart) / 2.0
    slope, curvature = np.einsum("dpq,dq->dp", precision, apart), precision.copy()
    np.add.at(cost, batch.driver, cost_e)
    np.add.at(slope, batch.driver, slope_e)
    np.add.at(curvature, batch.driver, curvature_e)
    told_directly = np.isfinite(known.values)
    off = np.where(told_directly, drivers - np.where(told_directly, known.values, 0.0), 0.0) / SEEN_SIGMA
    direct = (TAILS + 1.0) / (TAILS + off**2) * told_directly
    cost += (TAILS + 1.0) / 2.0 * np.log1p(off**2 / TAILS).sum(axis=1)
    slope += direct * off / SEEN_SIGMA
    curvature[:, np.arange(width), np.arange(width)] += direct / SEEN_SIGMA**2
    return cost, slope, curvature, mean_m2
