"""Programs of traffic lights in one neutral form, whatever file they come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

STATIC = "static"
LETTERS = frozenset("rRyYgGuoOs")
"""SUMO's letters for what a light shows: G green, g green but yield, y yellow, r red, u red and yellow,
o off and yield, O off with right of way, s stop, then turn."""
GREEN = frozenset("Gg")


@dataclass(frozen=True, slots=True)
class SignalPhase:
    """What the lights of one controller show for a time."""

    duration_s: float
    state: str
    """One of SUMO's letters for each link of the controller."""
    min_s: float | None = None
    """With max_s the bounds of a phase that traffic may shorten or prolong."""
    max_s: float | None = None
    next: tuple[int, ...] = ()
    """Phases, counted from 0, of which one follows; empty for the next in order."""
    name: str = ""
    more: Mapping[str, str] = field(default_factory=dict[str, str])
    """What else SUMO knows of phases, such as earliestEnd or vehext, in its own words."""


@dataclass(frozen=True, slots=True)
class SignalProgram:
    """One program of a controller."""

    id: str
    """Among the programs of the controller."""
    phases: tuple[SignalPhase, ...]
    offset_s: float = 0.0
    """The cycle begins so long after the start of the simulation."""
    kind: str = STATIC
    """SUMO's type: static, actuated, delay_based."""
    parameters: Mapping[str, str] = field(default_factory=dict[str, str])
    """Of actuated programs, such as max-gap, in SUMO's words."""

    @property
    def links(self) -> int:
        """How many letters its states have."""
        return len(self.phases[0].state) if self.phases else 0

    @property
    def cycle_s(self) -> float:
        return sum(phase.duration_s for phase in self.phases)
