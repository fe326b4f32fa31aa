"""Driving: what every learned planner does around its network."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.features.view import Arrays, EgoView
from interplan_sumo.planner import Observation
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory

STEP_S: Final = 0.5
POSES: Final = 16
"""A plan: so many poses so far apart, 8 s, the present not included."""
MOST_MPS: Final = 45.0
"""No plan goes faster."""


def one_sample(arrays: Arrays) -> Arrays:
    """The arrays of one step as a batch of one."""
    return {name: values[None] for name, values in arrays.items()}


def plan_through(poses: NDArray[Any], view: EgoView, observation: Observation, step_s: float = STEP_S) -> Trajectory:
    """From the ego's pose through poses (N, 3) of the rear axle in the ego frame, `step_s` apart, `without_leaps`."""
    path = without_leaps(np.concatenate((np.zeros((1, 3)), np.asarray(poses, dtype=np.float64))), step_s)
    time_s: Floats = observation.time_s + step_s * np.arange(len(path), dtype=np.float64)
    return view.frame(observation).plan(path, time_s, view.mission.shape)


def without_leaps(path: Floats, step_s: float) -> Floats:
    """A path (N, 3) with steps of at most 45 m/s: what is beyond a leap moves along with it.

    Far from all that it has learned a network may say anything; what it says
    there is still a way, and no reason to end a run.
    """
    steps = np.diff(path[:, :2], axis=0)
    lengths_m = np.hypot(steps[:, 0], steps[:, 1])
    most_m = MOST_MPS * step_s
    if not (lengths_m > most_m).any():
        return path
    steps *= (most_m / np.maximum(lengths_m, most_m))[:, None]
    return np.column_stack((path[0, :2] + np.pad(np.cumsum(steps, axis=0), ((1, 0), (0, 0))), path[:, 2]))
