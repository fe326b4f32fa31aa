"""Row check: a drive made again, held against the row that it is to repeat."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, Self

from interplan_sumo.batch.records import DriveAnswer, Fault, MetricRecord, Row
from interplan_sumo.batch.trace_difference import TraceDifference
from interplan_sumo.batch.versions import scored_versions
from interplan_sumo.errors import InputError, clean_line
from interplan_sumo.planner_source import PlannerSource

SCORE_BAR = 1e-6
"""Scores, 0 to 1, this close are equal."""

Verdict = Literal["equal", "differs", "unverifiable"]


@dataclass(frozen=True, slots=True)
class Remade:
    """What matters of a drive made again."""

    trace_hash: str | None
    score: float | None
    metrics: Mapping[str, MetricRecord]
    fault: Fault | None

    @classmethod
    def of(cls, answer: DriveAnswer, fault: Fault | None) -> Self:
        sheet = answer.sheet
        score, metrics = (None, {}) if sheet is None else (sheet.score, sheet.metrics)
        return cls(answer.trace_hash, score, metrics, fault)


@dataclass(frozen=True, slots=True)
class RowCheck:
    """How one row fared."""

    row: Row
    verdict: Verdict
    reason: str
    """Why it differs or cannot be verified; a remark where it is equal; may be empty."""
    trace_hash: str | None = None
    """Of the drive made now, as `score`."""
    score: float | None = None
    difference: TraceDifference | None = None
    """None where the traces agree, or where one of them is missing."""
    of_planner: bool = False
    """Whether the planner itself drove, and not its stored plans."""

    @property
    def within_bars(self) -> bool:
        """Whether it differs by less than two machines may: 1 mm, and 1e-6 in the score."""
        then = self.row.score
        scored = self.score is not None and then is not None and abs(self.score - then) <= SCORE_BAR
        return self.verdict == "differs" and self.difference is not None and self.difference.within_bar and scored

    @property
    def changed_versions(self) -> dict[str, tuple[str, str]]:
        """What has another version now than when the row was driven: name -> (then, now); planners by their hash."""
        then, now = dict(self.row.versions), scored_versions()
        if self.of_planner and self.row.planner_hash is not None:
            then["planner"], now["planner"] = self.row.planner_hash[:12], _planner_hash(self.row.planner)[:12]
        return {
            name: (then.get(name, "none"), now.get(name, "none"))
            for name in {**then, **now}
            if then.get(name) != now.get(name)
        }


def compared(row: Row, now: Remade, *, with_planner: bool = False) -> RowCheck:
    """A row against a drive made again from its plans, or by its planner: fault, trace hash, score and every metric."""
    check = RowCheck(row, "equal", "", now.trace_hash, now.score, of_planner=with_planner)
    if row.fault and not with_planner and (now.fault is None or now.fault.kind == "planner"):
        # Only the planner could fail again. It has its zero; what is to be seen is that it drove until then.
        same = now.trace_hash == row.trace_hash
        reason = f"its drive until the {row.fault.kind} fault" if same else "another drive than until its fault"
        return replace(check, verdict="equal" if same else "differs", reason=reason)
    if row.fault or now.fault or now.score is None or row.score is None:
        reason = _fault_differs(row.fault, now.fault)
        same = f"the same {row.fault.kind} fault" if row.fault else ""
        return replace(check, verdict="differs" if reason else "equal", reason=reason or same)
    if now.trace_hash != row.trace_hash:
        return replace(check, verdict="differs", reason="another drive than that of its hash")
    if abs(now.score - row.score) > SCORE_BAR:
        return replace(check, verdict="differs", reason=f"the same drive, but its score was {row.score:.6f}")
    if (name := _other_metric(row.metrics, now.metrics)) is not None:
        said = f"the same drive and score, but its metric {clean_line(name, 80)} was another"
        return replace(check, verdict="differs", reason=said)
    return check


def _planner_hash(spec: str) -> str:
    try:
        return PlannerSource.of(spec).hash
    except InputError:
        return "none"


def _other_metric(then: Mapping[str, MetricRecord], now: Mapping[str, MetricRecord]) -> str | None:
    """A metric that the row has otherwise; None if there is none."""
    for name in {**then, **now}:
        if name not in then or name not in now:
            return name
        one, other = then[name].score, now[name].score
        if (one is None) != (other is None) or (one is not None and other is not None and abs(one - other) > SCORE_BAR):
            return name
    return None


def _fault_differs(then: Fault | None, now: Fault | None) -> str:
    """What is different about two endings of which at least one is a fault; empty if they are of one class."""
    if now is None:
        return f"it ended in a {then.kind} fault then and does not now: {then.message}" if then else ""
    if then is None:
        return f"now it ends in a {now.kind} fault: {now.message}"
    return "" if then.kind == now.kind else f"a {then.kind} fault then, a {now.kind} fault now: {now.message}"
