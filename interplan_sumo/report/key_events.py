"""Key events: when a drive lost its points, what decided its score, and what else happened on the way."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal

from interplan_sumo.batch.records import Row
from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.lane_crossings import find_crossings
from interplan_sumo.metrics.metric import MetricResult, failure_words, lost_frame
from interplan_sumo.metrics.profile import Profile
from interplan_sumo.metrics.score import ScoreSheet, points_lost, score_facts
from interplan_sumo.report.failure_reasons import LEAST_LOSS, fault_sentence, with_points

FAULT: Final = "fault"
"""Stands for the metric where the planner's fault ended the drive."""
NOTHING: Final = "nothing"
"""Stands for the metric where nothing was lost: the moment is the end of the drive."""


@dataclass(frozen=True, slots=True)
class KeyEvent:
    """When a metric lost its points: what `Metric.lost_at` says."""

    time_s: float
    """Since the first frame."""
    frame: int
    metric: str
    """A metric's name, `FAULT` or `NOTHING`."""
    reason: str
    points: float = 0.0
    """What it cost, of 100."""


def key_events(drive: StoredDrive, profile: str | Profile | None = None) -> tuple[KeyEvent, ...]:
    """One for each judged metric that lost points, and one for the fault, in time order.

    The profile is the run's unless another is given; errors as from `find_profile`.
    """
    return loss_events(*_judged(drive, profile), drive.row)


def deciding_moment(drive: StoredDrive, profile: str | Profile | None = None) -> KeyEvent:
    """The fault, else the loss that cost most points, of equal ones the first, else the end."""
    facts, sheet = _judged(drive, profile)
    return deciding_event(loss_events(facts, sheet, drive.row), facts)


def loss_events(facts: Facts, sheet: ScoreSheet, row: Row) -> tuple[KeyEvent, ...]:
    """`key_events` of facts and score at hand."""
    found: list[KeyEvent] = []
    scores = {name: sheet.metrics[name].score or 0.0 for name in (*sheet.gates, *sheet.weights)}
    cost = points_lost(scores, sheet.gates, sheet.weights)
    for name in scores:
        result = sheet.metrics[name]
        if _loss(result) >= LEAST_LOSS:
            frame = lost_frame(name, facts, result)
            found.append(_event(facts, frame, name, result.reason or "points were lost", cost[name]))
    if row.fault:
        found.append(_event(facts, facts.frames - 1, FAULT, fault_sentence(row)))
    return tuple(sorted(found, key=lambda event: event.frame))


def deciding_event(lost: tuple[KeyEvent, ...], facts: Facts) -> KeyEvent:
    """The one of `loss_events` that `deciding_moment` names."""
    if not lost:
        return _event(facts, facts.frames - 1, NOTHING, "no points were lost")
    return max(lost, key=lambda event: (event.metric == FAULT, event.points))


def _judged(drive: StoredDrive, profile: str | Profile | None) -> tuple[Facts, ScoreSheet]:
    facts = Facts(drive.trace, drive.roads, drive.expert, drive.scenario)
    return facts, score_facts(facts, profile or drive.profile)


def _loss(result: MetricResult) -> float:
    return 0.0 if result.score is None else 1.0 - result.score


def _event(facts: Facts, frame: int, metric: str, reason: str, points: float = 0.0) -> KeyEvent:
    return KeyEvent(round(float(facts.time_s[frame]), 6), frame, metric, reason, points)


# --- all that happened -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ReplayEvent:
    """Something of note in a drive."""

    frame: int
    kind: Literal["gate", "weight", "fault", "contact", "trigger", "lane", "light", "goal"]
    text: str
    decides: bool = False


def replay_events(
    drive: StoredDrive, facts: Facts, sheet: ScoreSheet, lost: Iterable[KeyEvent], set_off: Iterable[int | None]
) -> list[ReplayEvent]:
    """Everything of note in time order: what was `lost`, contacts, changes of lane and light, and who was `set_off`."""
    lost = tuple(lost)
    decided = deciding_event(lost, facts)
    found = [_lost(event, sheet, decides=event is decided) for event in lost]
    found += _contacts(facts, sheet)
    found += [ReplayEvent(frame, "trigger", "a pedestrian sets off") for frame in set_off if frame is not None]
    found += [
        ReplayEvent(crossing.end, "lane", f"lane change done, begun {crossing.duration_s:.1f} s before")
        for crossing in find_crossings(facts.roads, facts.body_lanes, facts.trace.ego.time_us)
        if crossing.success
    ]
    for run in sheet.metrics["diagnostics"].detail["red_lights_run"]:
        frame = int(facts.time_s.searchsorted(run["time_s"] - 1e-6))
        found.append(ReplayEvent(frame, "light", "passes a red light"))
    if drive.row.reached_goal:
        found.append(ReplayEvent(facts.frames - 1, "goal", "passes the goal line"))
    return sorted(found, key=lambda event: (event.frame, not event.decides))


def _lost(event: KeyEvent, sheet: ScoreSheet, *, decides: bool) -> ReplayEvent:
    if event.metric == FAULT:
        return ReplayEvent(event.frame, "fault", event.reason, decides)
    kind = "gate" if event.metric in sheet.gates else "weight"
    words = with_points(failure_words(event.metric), event.points)
    return ReplayEvent(event.frame, kind, f"{words}: {event.reason}", decides)


def _contacts(facts: Facts, sheet: ScoreSheet) -> list[ReplayEvent]:
    """First contacts with each track, but for the one that the lost gate tells of already."""
    told = "no_collision" not in sheet.gates
    found: list[ReplayEvent] = []
    for contact in facts.collisions:
        if contact.at_fault and not told:
            told = True
            continue
        whose = "at-fault contact" if contact.at_fault else "contact, not at fault,"
        kind = contact.kind.words
        found.append(ReplayEvent(contact.frame, "contact", f"{whose} with {kind} {contact.track}"))
    return found
