"""Tasks: the nouns of the engine: what is to be done, within which limits, in which phase it is, and how it ended."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, Protocol

from interplan_sumo.batch.records import Fault

TRAFFIC_RETRIES = 1
"""How often a task is done again after SUMO gave up."""


@dataclass(frozen=True, slots=True)
class Task:
    """One thing to do: `payload` is handed to the function that its group opened."""

    key: Hashable
    group: str
    payload: Any


@dataclass(frozen=True, slots=True)
class Limits:
    """What a task may use. Wall clock, generous: noise must not change a result, and a pause counts for nothing."""

    plan_s: float = 10.0
    """One call of a planner."""
    task_s: float = 3600.0
    load_s: float = 600.0
    """Building a planner: importing libraries, loading weights."""
    memory_bytes: int | None = 8 << 30
    """Private memory of a worker, and of its planner; None for no cap. Linux only."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a task ended."""

    task: Task
    value: dict[str, Any]
    """Plain JSON data that the task gave; empty if it never answered."""
    fault: Fault | None
    wall_s: float
    traceback: str = ""
    """Of a fault of ours."""
    printed: str = ""
    """The end of what its process printed."""
    tries: int = 1
    """How often it was begun, if a process was killed and nobody knows by whom."""


Publish = Callable[[str], None]
"""Told the name of each phase as it begins."""
Answer = tuple[dict[str, Any], Fault | None]
"""What a task gives: plain JSON data, and the fault that it ended with."""
Work = Callable[[Any], Answer]
OpenGroup = Callable[[str, Publish], Work]
"""Builds what the tasks of one group share (a planner) and returns the function that does one task."""


class KilledFromOutsideError(Exception):
    """Somebody else ended what a task needs: an operator, or the system for want of memory. It may be done again."""


# --- phases ------------------------------------------------------------------------------------

PHASES = ("idle", "load", "setup", "start", "plan", "simulate", "record", "score", "store")
"""`load` builds the planner; `setup` to `record` are the episode's; `idle` is between jobs."""
PLANNER_PHASES = frozenset({"load", "start", "plan"})
"""A planner is asked here, or runs: what goes wrong in them is its fault."""


class Shared(Protocol):
    """A number that two processes see: the phase."""

    def __getitem__(self, index: int, /) -> int: ...
    def __setitem__(self, index: int, value: int, /) -> None: ...


class SharedPhase:
    """The one place a worker writes its phase and the parent reads it; no lock, so a killed writer blocks nobody."""

    def __init__(self, shared: Shared) -> None:
        self._shared = shared

    def publish(self, phase: str) -> None:
        """Say which phase begins; an unknown name counts as `simulate`."""
        self._shared[0] = PHASES.index(phase) if phase in PHASES else PHASES.index("simulate")

    @property
    def phase(self) -> str:
        return PHASES[self._shared[0]]
