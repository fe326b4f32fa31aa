"""Shared phase: which part of a job a worker is in, published so that a death can be told from outside."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

PHASES = ("idle", "load", "setup", "plan", "simulate", "record", "score", "store")
"""`load` builds the planner; `setup`, `plan`, `simulate` and `record` are the episode's; `idle` is between jobs."""
PLANNER_PHASES = frozenset({"load", "plan"})
"""Foreign code runs here: what goes wrong in them is the planner's fault."""

Publish = Callable[[str], None]
"""Told the name of each phase as it begins."""


class Shared(Protocol):
    """Two integers that two processes see: the phase and how often it has changed."""

    def __getitem__(self, index: int, /) -> int: ...
    def __setitem__(self, index: int, value: int, /) -> None: ...


class SharedPhase:
    """The one place a worker writes its phase and the parent reads it; no lock, so a killed writer blocks nobody."""

    def __init__(self, shared: Shared) -> None:
        self._shared = shared

    def publish(self, phase: str) -> None:
        """Say which phase begins; an unknown name counts as `simulate`."""
        self._shared[0] = PHASES.index(phase) if phase in PHASES else PHASES.index("simulate")
        self._shared[1] += 1

    @property
    def phase(self) -> str:
        return PHASES[self._shared[0]]

    @property
    def changes(self) -> int:
        """Grows with every phase that begins: unchanged means still the same call."""
        return self._shared[1]
