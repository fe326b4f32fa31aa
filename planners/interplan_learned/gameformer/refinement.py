"""Refinement: the speeds of the next 8 s, by Gauss-Newton on weighted squares of what is wrong with them.

Weights, step and iterations are those of the published planner. There are 80
unknowns, so that the normal equations are solved whole in a fraction of a
millisecond.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.gameformer.inputs import PLAN_STEP_S, PLAN_STEPS
from interplan_sumo.world.geometry import Floats, Ints

SPEED_WEIGHT: Final = 0.3
ACCELERATION_WEIGHT: Final = 0.1
JERK_WEIGHT: Final = 1.0
END_WEIGHT: Final = 3.0
BOUND_WEIGHT: Final = 10.0
HARD_WEIGHT: Final = 100.0
LEAST_MPS2, MOST_MPS2 = -4.0, 2.4
"""Accelerations beyond these cost `BOUND_WEIGHT`."""
END_SLACK_M: Final = 3.0
"""The end may be so far from that of the network's plan."""
ITERATIONS: Final = 20
STEP: Final = 0.3
CHECKED: Final[Ints] = np.array((1, 3, 6, 9, 14, 19, 24, 29))
"""Steps at which the way must be free: 0.2, 0.4, 0.7, 1, 1.5, 2, 2.5 and 3 s ahead."""

_SUMMED: Final[Floats] = np.tril(np.full((PLAN_STEPS, PLAN_STEPS), PLAN_STEP_S))
"""Arc lengths from speeds."""
_RATE: Final[Floats] = (np.eye(PLAN_STEPS) - np.eye(PLAN_STEPS, k=-1)) / PLAN_STEP_S
"""Accelerations from speeds, and jerks from accelerations, but for what was before the first."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpeedTask:
    """What the speeds are to be for: 80 steps of 0.1 s along a path, arc lengths of the rear axle from 0 now."""

    planned_m: Floats
    """(80,) arc lengths of the network's plan."""
    cap_mps: Floats
    """(80,) speed to aim at."""
    taken: NDArray[np.bool_]
    """(80, M) whether metre m of the path, from m to m + 1, is taken at each step."""
    speed_mps: float
    """Now."""
    acceleration_mps2: float
    """Now."""
    front_m: float
    """Rear axle to front bumper."""


def refined_speeds(task: SpeedTask) -> Floats:
    """(80,) speeds, none negative: the best of all iterations.

    Metres that the network's plan has passed with its rear axle by then do not
    count as taken: whoever is there comes after the ego. The network decides
    who goes first, and the refinement sees to it.
    """
    ahead = task.taken[CHECKED] & (np.arange(task.taken.shape[1]) > task.planned_m[CHECKED, None])
    speeds: Floats = np.maximum(np.diff(task.planned_m, prepend=0.0) / PLAN_STEP_S, 0.0)
    best, least = speeds, np.inf
    for _ in range(ITERATIONS + 1):
        residuals, jacobian = _linearised(speeds, task, ahead)
        cost = float(residuals @ residuals)
        if cost < least:
            best, least = speeds, cost
        speeds = speeds - STEP * np.linalg.solve(jacobian.T @ jacobian, jacobian.T @ residuals)
    return np.maximum(best, 0.0)


def _linearised(speeds: Floats, task: SpeedTask, ahead: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Weighted residuals (R,) and their derivatives (R, 80)."""
    acceleration = _RATE @ speeds
    acceleration[0] -= task.speed_mps / PLAN_STEP_S
    jerk = _RATE @ acceleration
    jerk[0] -= task.acceleration_mps2 / PLAN_STEP_S
    arc_m = _SUMMED @ speeds
    beyond = (acceleration < LEAST_MPS2) | (acceleration > MOST_MPS2)
    backwards = speeds < 0.0
    missed_m = arc_m[-1] - task.planned_m[-1]
    has_missed = abs(missed_m) > END_SLACK_M
    front_m = arc_m[CHECKED] + task.front_m
    into_m = np.maximum(front_m[:, None] - np.arange(task.taken.shape[1]), 0.0) * ahead
    terms = (
        (SPEED_WEIGHT, speeds - task.cap_mps, np.eye(PLAN_STEPS)),
        (ACCELERATION_WEIGHT, acceleration, _RATE),
        (JERK_WEIGHT, jerk, _RATE @ _RATE),
        (BOUND_WEIGHT, acceleration[beyond], _RATE[beyond]),
        (HARD_WEIGHT, speeds[backwards], np.eye(PLAN_STEPS)[backwards]),
        (END_WEIGHT, np.array([missed_m])[[has_missed]], _SUMMED[-1:][[has_missed]]),
        (HARD_WEIGHT, into_m.sum(axis=1), np.count_nonzero(into_m, axis=1)[:, None] * _SUMMED[CHECKED]),
    )
    return (
        np.concatenate([weight * residual for weight, residual, _ in terms]),
        np.concatenate([weight * slope for weight, _, slope in terms]),
    )
