"""GameFormer's inputs: the scene around the ego, compact or as large as published."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from interplan_learned.card import Size
from interplan_learned.scene import SceneSize, scene_inputs
from interplan_sumo.features.view import Arrays

PLAN_STEPS: Final = 80
PLAN_STEP_S: Final = 0.1
"""The plan covers 8 s at 10 Hz, as published."""
MODES: Final = 6
"""Futures per road user."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GameFormerSize:
    """How much the network sees and predicts."""

    scene: SceneSize
    predicted: int
    """So many of the agents it sees have their futures predicted."""


SIZES: Final[Mapping[Size, GameFormerSize]] = {
    "compact": GameFormerSize(
        scene=SceneSize(
            radius_m=60.0, frames=11, agents=8, lanes=30, lane_points=10, crosswalks=5, crosswalk_points=10,
            route_lanes=10, future_steps=16,
        ),
        predicted=8,
    ),
    "published": GameFormerSize(
        scene=SceneSize(
            radius_m=60.0, frames=21, agents=20, lanes=40, lane_points=50, crosswalks=5, crosswalk_points=20,
            route_lanes=10, future_steps=80,
        ),
        predicted=10,
    ),
}  # fmt: skip
"""Compact: past at 5 Hz and futures at 2 Hz, fewer agents and lanes, a token for 50 m of lane instead of for 10 m.
Published but for crosswalks, of which the schema has 20 points, not 30."""


def inputs(arrays: Arrays, size: Size) -> Arrays:
    """What `scene.scene_inputs` gives, of GameFormer's size."""
    return scene_inputs(arrays, SIZES[size].scene)
