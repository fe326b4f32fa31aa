"""The Savitzky-Golay filter: values and derivatives of the polynomial through a moving window of samples.

As scipy's `savgol_filter` has it, to the bit, without the half second that importing `scipy.signal` takes: sums are
made in the order of its `convolve1d`, which adds what lies at equal distances to either side first.
"""

from __future__ import annotations

from math import factorial

import numpy as np

from interplan_sumo.world.geometry import Floats


def savitzky_golay(values: Floats, window: int, order: int, derivative: int = 0, step: float = 1.0) -> Floats:
    """(N,) of N >= `window` values, `step` apart.

    Half a window at either end is of the polynomial through the outermost
    window. The middle of an even window lies between two samples: the value
    there is given to the one before it.
    """
    half = window // 2
    found = np.empty(len(values))
    found[half : len(values) - half] = _inner(values, weights(window, order, derivative, (window - 1) / 2.0, step))
    for edge, places in ((values[:window], slice(0, half)), (values[-window:], slice(window - half, window))):
        fitted = np.polyder(np.polyfit(np.arange(window, dtype=np.float64), edge, order), derivative)
        at = np.polyval(fitted, np.arange(window, dtype=np.float64)[places]) / step**derivative
        found[places if places.start == 0 else slice(len(values) - half, None)] = at
    return found


def weights(window: int, order: int, derivative: int, place: float, step: float = 1.0) -> Floats:
    """(window,) what each sample weighs in the derivative of the polynomial at `place`, in samples from the first."""
    powers = (np.arange(window - 1.0, -1.0, -1.0) - place) ** np.arange(order + 1.0)[:, None]
    wanted = np.zeros(order + 1)
    wanted[derivative] = factorial(derivative) / step**derivative
    return np.asarray(np.linalg.lstsq(powers, wanted)[0][::-1], dtype=np.float64)


def _inner(values: Floats, by: Floats) -> Floats:
    """Sums over all windows but, of even ones, the first."""
    window = len(by)
    half, skipped = window // 2, 1 - window % 2
    count = len(values) - window + 1 - skipped
    parts = [values[skipped + place : skipped + place + count] for place in range(window)]
    if not skipped:
        for sign in (1.0, -1.0):
            if np.abs(by - sign * by[::-1]).max() <= np.finfo(np.float64).eps:
                found = by[half] * parts[half]
                for place in range(half):
                    found = found + by[place] * (parts[place] + sign * parts[-1 - place])
                return found
    found = by[-1] * parts[-1]
    for place in range(window - 1):
        found = found + by[place] * parts[place]
    return found
