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


def one_sample(arrays: Arrays) -> Arrays:
    """The arrays of one step as a batch of one."""
    return {name: values[None] for name, values in arrays.items()}


def plan_through(poses: NDArray[Any], view: EgoView, seen: Observation, step_s: float = STEP_S) -> Trajectory:
    """From the ego's pose through poses (N, 3) of the rear axle in the ego frame, `step_s` apart."""
    path: Floats = np.concatenate((np.zeros((1, 3)), np.asarray(poses, dtype=np.float64)))
    time_s: Floats = seen.time_s + step_s * np.arange(len(path), dtype=np.float64)
    return view.frame(seen).plan(path, time_s, view.mission.shape)
