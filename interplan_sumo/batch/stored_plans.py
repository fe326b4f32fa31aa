"""Stored plans: a drive made again from what its planner had planned, so that verifying needs no planner."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Self

from interplan_sumo.errors import PlannerError
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.planner_seat import PlannerSeat, TimedPlan
from interplan_sumo.world.trace import read_plans
from interplan_sumo.world.trajectory import Trajectory


class StoredPlans(PlannerSeat):
    """The plans of a trace, one after the other; PlannerError where they end, as where a planner fails."""

    def __init__(self, plans: Sequence[Trajectory]) -> None:
        self._plans = plans
        self._next = 0

    @classmethod
    def of(cls, trace: Path) -> Self:
        """Those of a trace's folder; InputError if it cannot be read."""
        return cls(read_plans(trace))

    def start(self, mission: Mission) -> None:  # noqa: ARG002 (the seat's)
        self._next = 0

    def plan(self, observation: Observation) -> TimedPlan:  # noqa: ARG002 (the seat's)
        if self._next == len(self._plans):
            raise PlannerError("no more plans are stored")
        self._next += 1
        return TimedPlan(self._plans[self._next - 1], 0.0)

    def report(self) -> None:
        return None
