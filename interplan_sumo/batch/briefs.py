"""Briefs: what tables need of the rows of a run, read in a fraction of the time, kept in a fraction of the memory."""

from __future__ import annotations

import sys
from typing import NamedTuple, Self

import msgspec
from msgspec import Struct

from interplan_sumo.batch.records import FaultClass, JobKey, ModelUse, Row, Score, Seconds, Seed, decoded


class Brief(NamedTuple):
    """What tables need of a row, small enough to keep for every drive of a long run."""

    family: str
    site: str
    score: float | None
    """0 to 1."""
    fault: FaultClass | None
    official: bool
    no_collision: float | None
    """Score of the metric, 0 to 1, as `drivable_area`; None where it was not judged."""
    drivable_area: float | None
    goal_lane: bool | None
    """Whether the drive ended in the goal lane."""
    done: bool | None
    """Whether the task was done, as the profile has it, and whether a gate of safety took points; None as in rows."""
    unsafe: bool | None
    beside: tuple[tuple[str, float], ...]
    """Scores by other profiles, 0 to 1."""
    total_s: float | None
    """Wall clock of the whole job."""
    questions: int | None
    """How often the planner asked a language model; None where it says nothing about that."""
    unanswered: int | None
    """How often in vain."""
    tries: int
    """As in rows."""

    @classmethod
    def of(cls, row: Row) -> Self:
        return cls(*_brief(msgspec.convert(row, _BriefRow, from_attributes=True)))


class _BriefMetric(Struct, gc=False):
    score: Score | None = None


class _LaneDetail(Struct, gc=False):
    goal: bool | None = None


class _LaneChanges(Struct):
    detail: _LaneDetail


class _BriefMetrics(Struct):
    no_collision: _BriefMetric | None = None
    drivable_area: _BriefMetric | None = None
    lane_changes: _LaneChanges | None = None


class _BriefFault(Struct, gc=False):
    kind: FaultClass = msgspec.field(name="class")


class _BriefTimes(Struct, gc=False):
    total: Seconds | None = None


class _BriefRow(Struct, kw_only=True):
    """The part of a row that makes its brief: what is not named here is passed over as it is read."""

    scenario_id: str
    planner: str
    seed: Seed
    family: str
    site: str
    score: Score | None
    fault: _BriefFault | None
    official: bool
    metrics: _BriefMetrics
    times_s: _BriefTimes
    done: bool | None = None
    unsafe: bool | None = None
    beside: dict[str, Score] = {}
    planner_report: ModelUse | None = None
    tries: int = 1


def _brief(row: _BriefRow) -> Brief:
    metrics, report = row.metrics, row.planner_report
    asked = report if report is not None and report.queries is not None else None
    return Brief(
        row.family,
        row.site,
        row.score,
        None if row.fault is None else row.fault.kind,
        row.official,
        None if metrics.no_collision is None else metrics.no_collision.score,
        None if metrics.drivable_area is None else metrics.drivable_area.score,
        None if metrics.lane_changes is None else metrics.lane_changes.detail.goal,
        row.done,
        row.unsafe,
        tuple((sys.intern(name), score) for name, score in row.beside.items()),
        row.times_s.total,
        None if asked is None else asked.queries,
        None if asked is None else sum(asked.fallbacks.values()),
        row.tries,
    )


_brief_rows = msgspec.json.Decoder(_BriefRow)


def brief_of(line: bytes) -> tuple[JobKey, Brief]:
    """Job and brief of a line of results.jsonl, in a fraction of the time; RecordError for what it looks at."""
    row = decoded(_brief_rows, line)
    return (row.scenario_id, row.planner, row.seed), _brief(row)
