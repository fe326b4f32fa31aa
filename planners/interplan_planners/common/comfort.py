"""nuPlan's comfort for many drives at once: six signals, smoothed, each within its bounds all the time."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from math import factorial

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.dynamics.batch import SimulatedDrives
from interplan_sumo.dynamics.lqr import GRID_S
from interplan_sumo.world.geometry import Floats

# nuPlan's bounds; a drive is comfortable strictly inside them.
MIN_ACCELERATION_MPS2, MAX_ACCELERATION_MPS2 = -4.05, 2.40
MAX_JERK_MPS3 = 8.37
MAX_LONGITUDINAL_JERK_MPS3 = 4.13
MAX_YAW_RATE_RADPS = 0.95
MAX_YAW_ACCELERATION_RADPS2 = 1.93


def comfortable(drives: SimulatedDrives, center_ahead_m: float = 0.0) -> NDArray[np.bool_]:
    """(N,) whether all six signals of a drive stay within nuPlan's bounds.

    PDM takes the longitudinal acceleration of the rear axle (0.0), the
    benchmark's metric one moved to a centre `center_ahead_m` ahead of it, in
    nuPlan's way. The kinematic bicycle has no lateral acceleration at the rear
    axle, so that the lateral bound (4.89 m/s2) never speaks, and the jerk's
    magnitude is that of the longitudinal acceleration's magnitude. A drive of
    fewer than four states is comfortable.
    """
    count = drives.x_m.shape[1]
    if count < 4:
        return np.ones(len(drives), dtype=np.bool_)
    smooth, jerk, rate, acceleration = (_filter(count, *what) for what in ((8, 2, 0), (15, 2, 1), (5, 2, 1), (5, 3, 2)))
    heading = drives.heading_rad
    if (np.abs(np.diff(heading, axis=1)) >= np.pi).any():
        heading = np.unwrap(heading, axis=1)
    leak = center_ahead_m * (drives.yaw_rate_radps**2 + drives.yaw_acceleration_radps2) if center_ahead_m else 0.0
    along = np.concatenate((drives.ax_mps2 + leak, np.abs(drives.ax_mps2)))
    lengthwise, magnitude = _through(smooth, along).reshape(2, len(drives), count)
    return np.asarray(
        ((lengthwise > MIN_ACCELERATION_MPS2) & (lengthwise < MAX_ACCELERATION_MPS2)).all(axis=1)
        & (np.abs(_through(jerk, magnitude)) < MAX_JERK_MPS3).all(axis=1)
        & (np.abs(_through(jerk, lengthwise)) < MAX_LONGITUDINAL_JERK_MPS3).all(axis=1)
        & (np.abs(_through(rate, heading)) < MAX_YAW_RATE_RADPS).all(axis=1)
        & (np.abs(_through(acceleration, heading)) < MAX_YAW_ACCELERATION_RADPS2).all(axis=1)
    )


def _through(kernel: Floats, signals: Floats) -> Floats:
    """Signals (N, T) through a linear filter (T, T); a sum in fixed order, not a BLAS product."""
    return np.einsum("nj,ij->ni", signals, kernel)


@lru_cache(maxsize=64)
def _filter(count: int, window: int, order: int, derivative: int) -> Floats:
    """(T, T) a Savitzky-Golay filter over `count` samples as a matrix, as scipy's with its default edges.

    Each sample becomes the value (or derivative) there of the polynomial that
    fits the window around it best; an even window is centred half a sample
    later, and near an end the outermost window serves. Windows shrink to the
    samples there are.
    """
    window = min(window, count)
    order = min(order, window - 1)
    kernel = np.zeros((count, count))
    half = window // 2
    for i in range(count):
        first = min(max(i - (window - 1) // 2, 0), count - window)
        inner = half <= i < count - half
        at = Fraction(window - 1, 2) if inner else Fraction(i - first)
        kernel[i, first : first + window] = _weights(window, order, derivative, at)
    return kernel / GRID_S**derivative


@lru_cache(maxsize=256)
def _weights(window: int, order: int, derivative: int, at: Fraction) -> list[float]:
    """What each of `window` samples, one apart, adds to the derivative at `at` of their best polynomial; exact sums."""
    powers = range(order + 1)
    moments = [[Fraction(sum(j ** (p + q) for j in range(window))) for q in powers] for p in powers]
    wanted = [Fraction(0)] * (order + 1)
    for p in range(derivative, order + 1):
        wanted[p] = Fraction(factorial(p), factorial(p - derivative)) * at ** (p - derivative)
    # Gauss's elimination without pivoting: moments of distinct points are positive definite
    for p in powers:
        for q in range(p + 1, order + 1):
            share = moments[q][p] / moments[p][p]
            moments[q] = [b - share * a for a, b in zip(moments[p], moments[q], strict=True)]
            wanted[q] -= share * wanted[p]
    for p in reversed(powers):
        wanted[p] = (wanted[p] - sum(moments[p][q] * wanted[q] for q in range(p + 1, order + 1))) / moments[p][p]
    return [float(sum(wanted[p] * j**p for p in powers)) for j in range(window)]
