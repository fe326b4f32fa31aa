"""Scenes on the plainest map, for tests that drive often, without traffic or with much of it; and a watch for runs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from interplan_sumo.batch.briefs import Brief
from interplan_sumo.batch.records import JobKey, Row
from interplan_sumo.scenario.scenario import LanePosition, Scenario, TrafficDemand

PLAIN = Scenario(
    id="mine/0",
    family="mine",
    map="strip",
    start=LanePosition("402032", 20.0),
    start_speed_mps=12.0,
    goal=LanePosition("402032", 80.0),
    route=("40203",),
)
"""Nobody else on the road, and the usual duration."""
BUSY = replace(PLAIN, traffic=TrafficDemand("high", "mixed"), duration_s=1.5)


class Log:
    """A watch that remembers."""

    def __init__(self) -> None:
        self.jobs = 0
        self.done: list[tuple[JobKey, Brief]] = []
        self.rows: list[Row] = []

    def begin(self, jobs: int, done: Iterable[tuple[JobKey, Brief]]) -> None:
        self.jobs, self.done = jobs, list(done)

    def finished(self, row: Row) -> None:
        self.rows.append(row)
