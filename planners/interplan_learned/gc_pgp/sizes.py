"""Sizes: the numbers of the network and of what it is given, compact and as published."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from interplan_learned.card import Size

EDGES: Final = 12
"""Most edges out of a node that count: all successors, then the nearest proximal ones. Ours have at most 11."""
PATH_NODES: Final = 16
"""A traversal has at most so many nodes."""
PAST: Final = slice(10, None, 2)
"""Five past frames over 1 s and the present, of the 21 frames of a history."""
PAST_STEP_S: Final = 0.2
LATENTS: Final = 5
"""Numbers of noise per traversal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Dimensions:
    """What differs between the sizes."""

    nodes: int
    """Nodes around the ego, those that can be reached first."""
    points: int
    """Poses per node, equally spaced over its length."""
    agents: int
    train_traversals: int
    drive_traversals: int
    attention: int
    """Width of the decoder's attention."""
    heads: int
    clusters: int


SIZES: Final[dict[Size, Dimensions]] = {
    "compact": Dimensions(
        nodes=64, points=10, agents=16, train_traversals=100, drive_traversals=200, attention=64, heads=8, clusters=6
    ),
    "published": Dimensions(
        nodes=256, points=20, agents=30, train_traversals=1000, drive_traversals=1000, attention=128, heads=32,
        clusters=10,
    ),
}  # fmt: skip
