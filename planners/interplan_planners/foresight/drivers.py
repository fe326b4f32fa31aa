"""Drivers: how hard those who come from behind brake for an ego that is new in their lane.

Nobody knows who drives there. So the answer is asked of a population: the Intelligent Driver Model with standstill
gaps and accelerations spread as those of measured drivers are. Each kind of driver is equally likely.
"""

from __future__ import annotations

from statistics import NormalDist
from typing import Final

import numpy as np

from interplan_sumo.world.geometry import Floats

REACTION_S: Final = 0.8
"""From the moment when the ego reaches into their lane until they brake; measured drivers take 0.5 to 1.6 s."""
MILD_MPS2, HARD_MPS2 = 3.0, 5.0
"""Nobody minds braking that is milder than the first; the second is hard, with 1 m/s2 to the benchmark's gate."""
MINDED_SHARE: Final = 0.25
"""How much of what hard braking costs braking does that is just not hard."""
_GAP_SHARES, _ACCELERATION_SHARES = (0.1, 0.3, 0.5, 0.7, 0.9), (1 / 6, 1 / 2, 5 / 6)


def _spread(median: float, p95: float, shares: tuple[float, ...]) -> Floats:
    """Quantiles of a lognormal distribution."""
    normal = NormalDist()
    sigma = np.log(p95 / median) / normal.inv_cdf(0.95)
    return median * np.exp(sigma * np.array([normal.inv_cdf(share) for share in shares]))


# median and 95th percentile of 251 drivers in six places (routes/measured_city.xml)
_GAPS, _ACCELERATIONS = np.meshgrid(_spread(3.93, 7.03, _GAP_SHARES), _spread(2.06, 4.0, _ACCELERATION_SHARES))
STANDSTILL_GAP_M: Final = _GAPS.ravel()
ACCELERATION_MPS2: Final = _ACCELERATIONS.ravel()
HEADWAY_S: Final = 0.44
COMFORT_MPS2: Final = 1.5


def answers_mps2(
    gap_m: Floats, speed_mps: Floats, ego_mps: Floats, faster_mps: Floats | float = 0.0, farther_m: Floats | float = 0.0
) -> Floats:
    """(..., T) how hard each kind of driver brakes, this far behind the ego; below 0 where it accelerates.

    `faster_mps` and `farther_m` are what each 1 m/s2 of its acceleration has gained a driver by then; gap and speed are
    those of one with 1 m/s2. Its headway is the one that it is left with, if that is shorter than its own: people relax
    after a cut-in.
    """
    more_mps2 = ACCELERATION_MPS2 - 1.0
    gap_m = np.maximum(gap_m[..., None] - np.asarray(farther_m)[..., None] * more_mps2, 0.3)
    speed_mps = np.maximum(speed_mps[..., None] + np.asarray(faster_mps)[..., None] * more_mps2, 0.0)
    headway_m = np.minimum(np.maximum(gap_m - STANDSTILL_GAP_M, 0.2 * speed_mps), HEADWAY_S * speed_mps)
    closing_m = speed_mps * (speed_mps - ego_mps[..., None]) / (2.0 * np.sqrt(ACCELERATION_MPS2 * COMFORT_MPS2))
    wanted_m = STANDSTILL_GAP_M + np.maximum(headway_m + closing_m, 0.0)
    return ACCELERATION_MPS2 * ((wanted_m / gap_m) ** 2 - 1.0)


def minded(braking_mps2: Floats) -> Floats:
    """(...) of answers (..., T): 0 if nobody would have to brake hard, 1 if everybody would."""
    mild = np.clip((braking_mps2 - MILD_MPS2) / (HARD_MPS2 - MILD_MPS2), 0.0, 1.0)
    return np.mean(np.where(braking_mps2 > HARD_MPS2, 1.0, MINDED_SHARE * mild), axis=-1)


def needed_gap_m(speed_mps: Floats, ego_mps: Floats) -> Floats:
    """(...) the gap from which on hardly anybody brakes harder than `MILD_MPS2`."""
    gap_m, root = STANDSTILL_GAP_M[-1], np.sqrt(ACCELERATION_MPS2[-1] * COMFORT_MPS2)
    closing_m = np.maximum(speed_mps * (speed_mps - ego_mps), 0.0) / (2.0 * root)
    return (gap_m + 0.2 * speed_mps + closing_m) / np.sqrt(1.0 + MILD_MPS2 / ACCELERATION_MPS2[-1])
