"""PDM-Open's planner: an MLP and what it is given."""

from __future__ import annotations

from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.driving import one_sample, plan_through
from interplan_learned.network import load_network
from interplan_sumo.features.schema import STEP_S
from interplan_sumo.features.view import Arrays, EgoView
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.trajectory import Trajectory

FIELDS: Final = ("ego_history", "route_centerline", "route_centerline_valid")
"""All it looks at: no other road users, no lights, no obstacles."""
EVERY: Final = 2
ROWS: Final = 11
"""It sees every second frame of the past: eleven, 0.2 s apart, as published."""


class PdmOpenPlanner:
    """Eleven poses, velocities and accelerations of the past 2 s and 120 m of centre line give sixteen poses."""

    paper: ClassVar[str] = "Dauner et al. 2023"

    def __init__(self, weights: str = "pdm_open") -> None:
        """`weights` names shipped ones, or is a path to a model card."""
        self._network = load_network("pdm_open", weights)
        self._history_s = float(self._network.card.options["history_s"])

    def start(self, mission: Mission) -> None:
        self._view = EgoView(mission)

    def plan(self, observation: Observation) -> Trajectory:
        arrays = one_sample(self._view.arrays(observation))
        outputs = self._network.run(inputs(arrays, self._history_s))
        return plan_through(outputs["poses"][0], self._view, observation)

    def report(self) -> dict[str, Any]:
        return self._network.about


def inputs(arrays: Arrays, history_s: float = 2.0) -> Arrays:
    """`ego` (B, 99) and `centerline` (B, 360), from arrays of the schema.

    `ego` holds eleven rows of pose (x, y, yaw in the ego frame), velocity (vx,
    vy of the body at that time, yaw rate) and acceleration (ax, ay of the body,
    yaw acceleration), oldest first; rows older than `history_s` are 0.
    `centerline` holds 120 poses at 1 m; beyond its end the last one again.
    """
    return {"ego": _ego(arrays["ego_history"], history_s), "centerline": centerline(arrays)}


def centerline(arrays: Arrays) -> NDArray[np.float32]:
    """(B, 360) `route_centerline`, with the last pose repeated beyond its end."""
    poses, valid = arrays["route_centerline"], arrays["route_centerline_valid"]
    last = np.maximum(valid.sum(axis=1, keepdims=True) - 1, 0)
    rows = np.minimum(np.arange(poses.shape[1]), last)
    return np.take_along_axis(poses, rows[..., None], axis=1).reshape(len(poses), -1).astype(np.float32)


def _ego(history: NDArray[Any], history_s: float) -> NDArray[np.float32]:
    seen = history[:, ::EVERY].astype(np.float32)
    yaw, yaw_rate = seen[..., 2], seen[..., 7]
    c, s = np.cos(yaw), np.sin(yaw)
    table = np.zeros((len(seen), ROWS, 9), dtype=np.float32)
    table[..., :3] = seen[..., :3]
    for first, at in ((3, 3), (6, 5)):  # velocity, acceleration: from the ego frame into the body's at each instant
        x, y = seen[..., at], seen[..., at + 1]
        table[..., first], table[..., first + 1] = c * x + s * y, c * y - s * x
    table[..., 5] = yaw_rate
    table[:, 1:, 8] = np.diff(yaw_rate, axis=1) / np.float32(EVERY * STEP_S)
    kept = round(history_s / (EVERY * STEP_S)) + 1
    table[:, : ROWS - kept] = 0.0
    if kept == 1:
        table[:, -1, 8] = 0.0  # a difference with the frame before
    return table.reshape(len(table), -1)
