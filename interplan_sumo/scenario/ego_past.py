"""EgoPast: how the ego came to its start, where a recording tells, as frozen data."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Final

from interplan_sumo.errors import ScenarioError

PAST_STEPS: Final = 20
"""2 s: with the present 21 samples."""
COLUMNS: Final = ("x_m", "y_m", "heading_rad", "speed_mps")


@dataclass(frozen=True, slots=True)
class EgoPast:
    """The ego at the 20 instants before the start, 0.1 s apart, oldest first. ScenarioError names what cannot be."""

    x_m: tuple[float, ...]
    """Of the box centre in the map frame, as y_m."""
    y_m: tuple[float, ...]
    heading_rad: tuple[float, ...]
    speed_mps: tuple[float, ...]
    """Along the heading."""

    def __post_init__(self) -> None:
        for name in COLUMNS:
            column: tuple[float, ...] = getattr(self, name)
            if len(column) != PAST_STEPS:
                raise ScenarioError(f"past: {name} has {len(column)} numbers, expected {PAST_STEPS}, 0.1 s apart")
            if not all(map(isfinite, column)):
                raise ScenarioError(f"past: {name} holds a number that is not finite")
