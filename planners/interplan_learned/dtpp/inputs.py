"""DTPP's inputs: the scene, and the branches of the tree as the network sees them."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.card import Size
from interplan_learned.dtpp import paths
from interplan_learned.dtpp.sizes import SIZES
from interplan_learned.dtpp.tree import ACCELERATION, CURVATURE, SPEED, STEP_S, STEPS, Branches, TreeStart, first_stage
from interplan_learned.scene import FIELDS as SCENE_FIELDS
from interplan_learned.scene import scene_inputs, thinned
from interplan_sumo.features.schema import channel_index
from interplan_sumo.features.view import Arrays
from interplan_sumo.world.geometry import Floats

FIELDS: Final = tuple(dict.fromkeys((*SCENE_FIELDS, *paths.FIELDS, "speed_limit")))
"""Of the schema; training reads `agent_futures`, too."""
SCENE: Final = ("ego", "agents", "lanes", "crosswalks")
"""What the encoder sees."""
BRANCHES: Final = ("branches", "effort")
"""What the decoder sees beside it."""
BRANCH_CHANNELS: Final = ("x", "y", "yaw", "speed", "acceleration", "curvature", "there")
EFFORT: Final = ("speed", "acceleration", "jerk", "lateral")
"""Means over a branch, in shares of what is much (`MUCH`)."""
MUCH: Final = (15.0, 4.0, 6.0, 5.0)
"""m/s, m/s2, m/s3, m/s2: as published."""
_VX, _AX = channel_index("ego_history", "vx"), channel_index("ego_history", "ax")


def kept(arrays: Arrays, size: Size) -> Arrays:
    """What `inputs` needs of arrays of the schema: a small scene, `paths` and `paths_valid` (`reference_paths`)."""
    found, valid = paths.reference_paths(arrays)
    small = thinned(arrays, SIZES[size].scene)
    del small["static_objects"]
    return {**small, "paths": found, "paths_valid": valid}


def inputs(arrays: Arrays, size: Size) -> Arrays:
    """`scene_of` and the first stage of the tree as `shown`, from what is `kept`."""
    start = start_of(arrays)
    return {**scene_of(arrays, size), **shown(first_stage(start, SIZES[size].tree), start, size)}


def scene_of(arrays: Arrays, size: Size) -> Arrays:
    """The arrays of `scene.scene_inputs` that the encoder sees, from what is `kept`."""
    scene = scene_inputs(arrays, SIZES[size].scene)
    return {name: scene[name] for name in SCENE}


def start_of(arrays: Arrays) -> TreeStart:
    """Where the tree begins, from what is `kept`."""
    now = arrays["ego_history"][:, -1].astype(np.float64)
    return TreeStart(
        paths=arrays["paths"],
        paths_valid=arrays["paths_valid"],
        speed_mps=np.maximum(now[:, _VX], 0.0),
        acceleration_mps2=now[:, _AX],
        limit_mps=arrays["speed_limit"].astype(np.float64),
    )


def shown(branches: Branches, start: TreeStart, size: Size) -> dict[str, NDArray[Any]]:
    """`branches` (B, M, T, 7) of `BRANCH_CHANNELS` and `effort` (B, M, 4); what does not exist is 0.

    Steps are 8 s / T apart; those beyond the end of a stage are 0 as well.
    """
    steps = SIZES[size].scene.future_steps
    every = STEPS // steps
    thin = branches.motion[:, :, every - 1 :: every]
    table = np.zeros((*thin.shape[:2], steps, len(BRANCH_CHANNELS)), dtype=np.float32)
    table[:, :, : thin.shape[2], :-1] = thin
    table[:, :, : thin.shape[2], -1] = branches.valid[..., None]
    return {"branches": table, "effort": effort(branches, start)}


def effort(branches: Branches, start: TreeStart) -> NDArray[np.float32]:
    """(B, M, 4) mean speed, acceleration, jerk and lateral acceleration of each branch, see `EFFORT`."""
    speed, acceleration = branches.motion[..., SPEED], branches.motion[..., ACCELERATION]
    now = np.broadcast_to(start.acceleration_mps2[:, None, None], (*speed.shape[:2], 1))
    jerk = np.diff(acceleration, axis=-1, prepend=now) / STEP_S
    lateral = speed**2 * branches.motion[..., CURVATURE]
    means: Floats = np.stack([np.abs(each).mean(axis=-1) for each in (speed, acceleration, jerk, lateral)], axis=-1)
    return np.asarray(means / MUCH * branches.valid[..., None], dtype=np.float32)
