"""Repeated looks: intervals that hold together although somebody looks again and again, and stops when one is narrow.

Repeated confidence intervals (Jennison and Turnbull, JRSS B 51, 1989): the k-th
interval reaches z_k standard errors to either side, with z_k such that a
statistic that is looked at then, of a truth of 0, has left +-z_1 ... +-z_k with
probability a(t_k), which grows with the information t_k to 0.05 at t = 1 (Lan
and DeMets, Biometrika 70, 1983; their function after O'Brien and Fleming):

    a(t) = 4 - 4 Phi(z_0.9875 / sqrt(t)).

All intervals then hold with 95 %, whatever the rule that stops. Information is
the inverse of the variance, as a share of what the wanted half-width needs. The
recursion over looks is that of Armitage, McPherson and Rowe (JRSS A 132, 1969).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from interplan_sumo.statistics.event_rates import Floats
from interplan_sumo.statistics.intervals import CONFIDENCE

WIDEST: Final = 2.2414
"""Standard errors to either side that the last interval never exceeds: z_0.9875, which looking all the time needs."""
GRID: Final = 1201
"""Points of the densities."""
FURTHEST: Final = 9.0
"""Standard errors; a first look of little information needs more than this and gets this."""


def spent(information: float) -> float:
    """The probability of any error that may have been spent at this share of the information."""
    from scipy.special import ndtr, ndtri

    share = min(max(information, 1e-9), 1.0)
    return 4.0 * float(ndtr(-ndtri(0.75 + CONFIDENCE / 4.0) / np.sqrt(share)))


def boundaries(information: Sequence[float]) -> list[float]:
    """How many standard errors the interval of each look reaches to either side.

    `information` grows from look to look and ends at 1 at most.
    """
    found: list[float] = []
    points, density, before = np.zeros(1), np.ones(1), 0.0
    for share in information:
        if not before < share <= 1.0:
            raise ValueError(f"information goes from {before} to {share}")
        step, scale = np.sqrt(share - before), np.sqrt(share)
        z = _boundary(points, density, step, scale, spent(share) - (spent(before) if before else 0.0))
        found.append(z)
        grid = np.linspace(-z * scale, z * scale, GRID)
        apart = (grid[:, None] - points[None, :]) / step
        kernel = np.exp(-0.5 * apart**2) / (step * np.sqrt(2.0 * np.pi))
        width = np.full(GRID, grid[1] - grid[0])
        width[[0, -1]] /= 2.0
        points, density, before = grid, (kernel @ density) * width, share
    return found


def _boundary(points: Floats, density: Floats, step: float, scale: float, wanted: float) -> float:
    """Beyond which the statistic is with the wanted probability, from where it was among `points`."""
    from scipy.special import ndtr

    low, high = 0.0, FURTHEST
    while high - low > 1e-6:
        z = (low + high) / 2.0
        outside = ndtr((-z * scale - points) / step) + ndtr((points - z * scale) / step)
        low, high = (z, high) if float(density @ outside) > wanted else (low, z)
    return high
