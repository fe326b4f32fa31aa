"""FlowDrive's planner: noise carried to a plan, and what the network is given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.driving import POSES, STEP_S, one_sample, plan_through
from interplan_learned.network import load_network
from interplan_learned.scene import SceneSize, scene_inputs
from interplan_sumo.errors import InputError
from interplan_sumo.features.view import Arrays, EgoView
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory

CHANNELS: Final = ("x", "y", "cos", "sin")
"""What a plan's poses are told by."""
AHEAD_S: Final[Floats] = STEP_S * np.arange(1, POSES + 1, dtype=np.float64)
_SAME: Final[Floats] = np.ones(POSES)
CENTRE: Final[Floats] = np.column_stack((6.0 * AHEAD_S, 0.0 * _SAME, _SAME, 0.0 * _SAME))
"""(POSES, 4) a plan straight on at 6 m/s."""
SPREAD: Final[Floats] = np.column_stack((0.5 + 4.0 * AHEAD_S, 0.3 + 0.12 * AHEAD_S**2, 0.5 * _SAME, 0.5 * _SAME))
"""(POSES, 4) about how far experts are from that, in metres, cosines and sines: what the network sees is about 1."""
SCENE: Final = SceneSize(
    radius_m=60.0, frames=11, agents=12, lanes=30, lane_points=10, crosswalks=5, crosswalk_points=10, route_lanes=10,
    future_steps=16,
)  # fmt: skip

Ends = Callable[[NDArray[np.float32], NDArray[np.float32]], NDArray[Any]]
"""Where the flow through plans (B, K, POSES, 4) ends that are on their way since times (B, K, 1), as `told`."""


class FlowDrivePlanner:
    """Noise, the same in all steps of a drive, carried to a plan; other road users only tell where to."""

    paper: ClassVar[str] = "Wang et al. 2025"

    def __init__(self, weights: str = "flow_drive", steps: int = 4, temperature: float = 0.5, seed: int = 0) -> None:
        """`weights` names shipped ones, or is a path to a model card; `steps` is how often the network is asked.

        Noise is `temperature` times as wide as in training, drawn with `seed`.
        """
        if not 1 <= steps <= 100:
            raise InputError(f"flow_drive: steps is {steps}, expected 1 to 100")
        if not 0.0 <= temperature <= 2.0:
            raise InputError(f"flow_drive: temperature is {temperature:g}, expected 0 to 2")
        self._network = load_network("flow_drive", weights)
        self._steps = steps
        self._noise = temperature * np.random.default_rng(seed).standard_normal((1, 1, POSES, len(CHANNELS)))

    def start(self, mission: Mission) -> None:
        self._view = EgoView(mission)

    def plan(self, observation: Observation) -> Trajectory:
        scene = inputs(one_sample(self._view.arrays(observation)))
        encoded = self._network.run(scene, "encoder")

        def ends(plans: NDArray[np.float32], time: NDArray[np.float32]) -> NDArray[Any]:
            return self._network.run({**encoded, "plans": plans, "time": time}, "decoder")["ends"]

        return plan_through(poses(carried(self._noise, ends, self._steps))[0, 0], self._view, observation)

    def report(self) -> dict[str, Any]:
        return self._network.about


def inputs(arrays: Arrays) -> Arrays:
    """What `scene.scene_inputs` gives, of FlowDrive's size."""
    return scene_inputs(arrays, SCENE)


def carried(noise: Floats, ends: Ends, steps: int) -> Floats:
    """Plans (B, K, POSES, 4) as `told`, from noise of the same shape, in Euler steps of equal times from 0 to 1."""
    plans = noise
    for step in range(steps):
        time = np.full((*plans.shape[:2], 1), step / steps, dtype=np.float32)
        plans = plans + (ends(plans.astype(np.float32), time) - plans) / (steps - step)
    return plans


def told(wanted: NDArray[Any]) -> NDArray[np.float32]:
    """(..., POSES, 4) `CHANNELS` of poses (..., POSES, 3), by how many `SPREAD` they are off `CENTRE`."""
    yaw = wanted[..., 2]
    channels = np.stack((wanted[..., 0], wanted[..., 1], np.cos(yaw), np.sin(yaw)), axis=-1)
    return ((channels - CENTRE) / SPREAD).astype(np.float32)


def poses(plans: NDArray[Any]) -> Floats:
    """(..., POSES, 3) poses of plans (..., POSES, 4): what `told` makes undone."""
    channels = CENTRE + SPREAD * np.asarray(plans, dtype=np.float64)
    return np.concatenate((channels[..., :2], np.arctan2(channels[..., 3:], channels[..., 2:3])), axis=-1)
