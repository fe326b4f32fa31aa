"""Sizes: the numbers of the tree and of what the network is given, compact and as published."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from interplan_learned.card import Size
from interplan_learned.scene import SceneSize


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeSize:
    """How much of a tree is looked at."""

    branches: int
    """At most so many leaves per stage."""
    first_speeds: int
    """Speeds aimed at on each path."""
    second_speeds: int
    """Speeds aimed at from each parent."""
    parents: int
    """Leaves of the first stage that have children."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DtppSize:
    """The tree and the scene; branches and futures have `scene.future_steps` steps over 8 s."""

    tree: TreeSize
    scene: SceneSize


SIZES: Final[Mapping[Size, DtppSize]] = {
    "compact": DtppSize(
        tree=TreeSize(branches=15, first_speeds=10, second_speeds=5, parents=3),
        scene=SceneSize(
            radius_m=80.0, frames=11, agents=8, lanes=30, lane_points=10, crosswalks=5, crosswalk_points=10,
            route_lanes=1, future_steps=16,
        ),
    ),
    "published": DtppSize(
        tree=TreeSize(branches=30, first_speeds=10, second_speeds=5, parents=5),
        scene=SceneSize(
            radius_m=80.0, frames=21, agents=10, lanes=50, lane_points=50, crosswalks=5, crosswalk_points=20,
            route_lanes=1, future_steps=80,
        ),
    ),
}  # fmt: skip
"""Compact: half the branches and so three parents instead of five, 2 Hz instead of 10 Hz, fewer agents and lanes.
The route is in the branches; its lanes are not shown."""
