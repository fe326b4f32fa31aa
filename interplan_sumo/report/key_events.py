"""Moments: when a drive lost its points, and which of these moments decided it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from interplan_sumo.batch.records import Row
from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, lost_frame
from interplan_sumo.metrics.profile import Profile
from interplan_sumo.metrics.score import ScoreSheet, score_facts
from interplan_sumo.report.failure_reasons import LEAST_LOSS, fault_sentence

FAULT: Final = "fault"
"""Stands for the metric where the planner's fault ended the drive."""
NOTHING: Final = "nothing"
"""Stands for the metric where nothing was lost: the moment is the end of the drive."""


@dataclass(frozen=True, slots=True)
class KeyEvent:
    """When a metric lost its points: the time that its reason names, else what `Metric.lost_at` says."""

    time_s: float
    """Since the first frame."""
    frame: int
    metric: str
    """A metric's name, `FAULT` or `NOTHING`."""
    reason: str


def moments(drive: StoredDrive, profile: str | Profile | None = None) -> tuple[KeyEvent, ...]:
    """One moment for each judged metric that lost points, and one for the fault, in time order.

    The profile is the run's unless another is given; errors as from `find_profile`.
    """
    return lost_moments(*_judged(drive, profile), drive.row)


def deciding_moment(drive: StoredDrive, profile: str | Profile | None = None) -> KeyEvent:
    """The fault, else the first gate that was lost, else the loss of the metric that cost most, else the end."""
    facts, sheet = _judged(drive, profile)
    return deciding(lost_moments(facts, sheet, drive.row), facts, sheet)


def lost_moments(facts: Facts, sheet: ScoreSheet, row: Row) -> tuple[KeyEvent, ...]:
    """`moments` of facts and score at hand."""
    found: list[KeyEvent] = []
    for name in (*sheet.gates, *sheet.weights):
        result = sheet.metrics[name]
        if _loss(result) >= LEAST_LOSS:
            frame = lost_frame(name, facts, result)
            found.append(_moment(facts, frame, name, result.reason or "points were lost"))
    if row.fault:
        found.append(_moment(facts, facts.frames - 1, FAULT, fault_sentence(row)))
    return tuple(sorted(found, key=lambda moment: moment.frame))


def deciding(lost: tuple[KeyEvent, ...], facts: Facts, sheet: ScoreSheet) -> KeyEvent:
    """`deciding_moment` among the moments of `lost_moments`."""
    for wanted in ((FAULT,), sheet.gates):
        first = next((moment for moment in lost if moment.metric in wanted), None)
        if first is not None:
            return first
    if not lost:
        return _moment(facts, facts.frames - 1, NOTHING, "no points were lost")
    return max(lost, key=lambda moment: sheet.weights[moment.metric] * _loss(sheet.metrics[moment.metric]))


def _judged(drive: StoredDrive, profile: str | Profile | None) -> tuple[Facts, ScoreSheet]:
    facts = Facts(drive.trace, drive.roads, drive.expert, drive.scenario)
    return facts, score_facts(facts, profile or drive.profile)


def _loss(result: MetricResult) -> float:
    return 0.0 if result.score is None else 1.0 - result.score


def _moment(facts: Facts, frame: int, metric: str, reason: str) -> KeyEvent:
    return KeyEvent(round(float(facts.time_s[frame]), 6), frame, metric, reason)
