"""External: programs as planners, the planner scheme `exec`, for those who want a planner in this process."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from interplan_sumo.planner import EXEC, Mission, Observation, Planner
from interplan_sumo.planner_process.command import command_of
from interplan_sumo.planner_process.process import PlannerProcess
from interplan_sumo.world.trajectory import Trajectory


def find(target: str) -> None:
    """Check that the program is there; PlannerLoadError otherwise."""
    command_of(f"{EXEC}:{target}")


def factory(target: str) -> Callable[..., Planner]:
    """What makes the planner of a command."""
    return lambda: ExternalPlanner(f"{EXEC}:{target}")


class ExternalPlanner:
    """A program as a planner for those who want one in this process; PlannerError for all that it does wrong."""

    def __init__(self, spec: str) -> None:
        self._spec = spec
        self._process = PlannerProcess.of(spec)

    def start(self, mission: Mission) -> None:
        if self._process.has_ended:
            self._process = PlannerProcess.of(self._spec)
        self._process.start(mission)

    def plan(self, observation: Observation) -> Trajectory:
        return self._process.plan(observation).plan

    def report(self) -> dict[str, Any] | None:
        """What it says of the drive."""
        return self._process.report()
