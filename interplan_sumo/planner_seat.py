"""Planner seat: how the loop reaches a planner, wherever it runs, and whose fault it is when that goes wrong."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from interplan_sumo.errors import PlannerError, clean_line, text_of, told
from interplan_sumo.planner import Mission, Observation, Planner
from interplan_sumo.world.trajectory import Trajectory

_T = TypeVar("_T")


@dataclass(frozen=True, slots=True, eq=False)
class TimedPlan:
    """A plan, not yet checked against the ego, and what it took."""

    plan: Trajectory
    wall_s: float
    """Wall-clock seconds inside `plan()`, as measured where the planner runs."""


class PlannerSeat(ABC):
    """A planner that can be driven with. PlannerError from all methods for whatever is the planner's fault."""

    @abstractmethod
    def start(self, mission: Mission) -> None:
        """As `Planner.start`."""

    @abstractmethod
    def plan(self, observation: Observation) -> TimedPlan:
        """As `Planner.plan`."""

    def plan_while(self, observation: Observation, meanwhile: Callable[[], object]) -> TimedPlan:
        """As `plan`; `meanwhile` is done while it thinks, where that is in another process, and else afterwards."""
        timed = self.plan(observation)
        meanwhile()
        return timed

    @abstractmethod
    def report(self) -> dict[str, Any] | None:
        """What the planner says of the last drive, plain data; None if it says nothing.

        Of a `report()` that raises it is `{"error": ...}`: the drive itself was not at fault.
        """


class InProcess(PlannerSeat):
    """A planner in this process: for debugging, for environments and for our own planners in our own tools.

    Nothing bounds what it does, nor how long that takes.
    """

    def __init__(self, planner: Planner) -> None:
        self._planner = planner

    def start(self, mission: Mission) -> None:
        guarded(lambda: self._planner.start(mission), "start()")

    def plan(self, observation: Observation) -> TimedPlan:
        began_s = time.perf_counter()
        plan = guarded(lambda: self._planner.plan(observation), "plan()")
        return TimedPlan(plan, time.perf_counter() - began_s)

    def report(self) -> dict[str, Any] | None:
        return own_report(self._planner)


def seated(planner: Planner | PlannerSeat) -> PlannerSeat:
    """The seat of a planner: this process, for one that has none yet."""
    return planner if isinstance(planner, PlannerSeat) else InProcess(planner)


def guarded(call: Callable[[], _T], what: str) -> _T:
    """The planner's own exceptions, sys.exit included, as PlannerError with the place where they were raised."""
    try:
        return call()
    except (KeyboardInterrupt, PlannerError):
        raise
    except BaseException as error:
        raise PlannerError(blame(error, what)) from error


def blame(error: BaseException, what: str) -> str:
    """What a call raised and where; what a PlannerError says is said already."""
    return text_of(error) if isinstance(error, PlannerError) else f"{what} raised {told(error)}"


def own_report(planner: Planner) -> dict[str, Any] | None:
    """What a planner's `report()` returns, if it has one."""
    report = getattr(planner, "report", None)
    if not callable(report):
        return None
    try:
        said: Any = report()
    except BaseException as error:
        return {"error": clean_line(blame(error, "report()"))}
    return said if isinstance(said, dict) or said is None else {"error": f"report() gave a {type(said).__name__}"}
