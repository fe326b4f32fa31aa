"""Moments: when a drive lost its points, and which of these moments decided it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from interplan_sumo.batch.run_folder import Row
from interplan_sumo.batch.stored_drive import StoredDrive
from interplan_sumo.metrics.association import runs
from interplan_sumo.metrics.comfort import BOUNDS
from interplan_sumo.metrics.drivable_area import TOLERANCE_M
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.result import MetricResult
from interplan_sumo.metrics.score import DEFAULT_PROFILE, ScoreSheet, score_facts
from interplan_sumo.report.failure_reasons import LEAST_LOSS, fault_sentence
from interplan_sumo.world.geometry import Floats

FAULT: Final = "fault"
"""Stands for the metric where the planner's fault ended the drive."""
NOTHING: Final = "nothing"
"""Stands for the metric where nothing was lost: the moment is the end of the drive."""
CREEPING_MPS: Final = 0.5
"""Below this an ego that should advance waits."""
SHORTEST_WAIT_S: Final = 1.0
NO_NEARER_M: Final = 0.1
"""Who gains no more than this gains nothing."""


@dataclass(frozen=True, slots=True)
class KeyEvent:
    """When a metric lost its points: the time that its reason names, else what `_LOST_AT` says."""

    time_s: float
    """Since the first frame."""
    frame: int
    metric: str
    """A metric's name, `FAULT` or `NOTHING`."""
    reason: str


def moments(drive: StoredDrive, profile: str = DEFAULT_PROFILE) -> tuple[KeyEvent, ...]:
    """One moment for each judged metric that lost points, and one for the fault, in time order.

    UnknownNameError for a profile that does not exist.
    """
    return lost_moments(*_judged(drive, profile), drive.row)


def deciding_moment(drive: StoredDrive, profile: str = DEFAULT_PROFILE) -> KeyEvent:
    """The fault, else the first gate that was lost, else the loss of the metric that cost most, else the end."""
    facts, sheet = _judged(drive, profile)
    return deciding(lost_moments(facts, sheet, drive.row), facts, sheet)


def lost_moments(facts: Facts, sheet: ScoreSheet, row: Row) -> tuple[KeyEvent, ...]:
    """`moments` of facts and score at hand."""
    found: list[KeyEvent] = []
    for name in (*sheet.gates, *sheet.weights):
        result = sheet.metrics[name]
        if _loss(result) >= LEAST_LOSS:
            frame = _LOST_AT.get(name, _at_the_end)(facts, result)
            found.append(_moment(facts, frame, name, result.reason or "points were lost"))
    if row["fault"]:
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


def _judged(drive: StoredDrive, profile: str) -> tuple[Facts, ScoreSheet]:
    facts = Facts(drive.trace, drive.roads, drive.expert, drive.scenario)
    return facts, score_facts(facts, profile)


def _loss(result: MetricResult) -> float:
    return 0.0 if result.score is None else 1.0 - result.score


def _moment(facts: Facts, frame: int, metric: str, reason: str) -> KeyEvent:
    return KeyEvent(round(float(facts.time_s[frame]), 6), frame, metric, reason)


# --- where each metric lost its points -----------------------------------------------------------


def _first_contact_at_fault(_: Facts, result: MetricResult) -> int:
    return next(int(contact["frame"]) for contact in result.detail["contacts"] if contact["at_fault"])


def _off_the_road(_: Facts, result: MetricResult) -> int:
    return int(np.argmax(result.series["outside_m"] >= TOLERANCE_M))


def _farthest_back(_: Facts, result: MetricResult) -> int:
    return int(np.argmin(result.series["progress_in_window_m"]))


def _nearest_contact(_: Facts, result: MetricResult) -> int:
    return int(np.argmin(result.series["time_to_collision_s"]))


def _fastest(_: Facts, result: MetricResult) -> int:
    return int(np.argmax(result.series["overspeed_mps"]))


def _roughest(_: Facts, result: MetricResult) -> int:
    """The frame of the signal that is farthest beyond its bounds, in widths of them."""
    beyond: list[Floats] = []
    for name, values in result.series.items():
        low, high = BOUNDS[name]
        beyond.append(np.maximum(low - values, values - high) / (high - low))
    return int(np.argmax(np.max(beyond, axis=0)))


def _stopped_advancing(facts: Facts, _: MetricResult) -> int:
    """The beginning of the longest wait; of who never waited, the first frame as far on the route as it ever came."""
    waiting = facts.speed_mps < CREEPING_MPS
    waits = [(end - first, first) for first, end in runs(waiting.tolist()) if waiting[first]]
    frames, first = max(waits, key=lambda wait: wait[0], default=(0, 0))
    if frames * facts.step_us * 1e-6 >= SHORTEST_WAIT_S:
        return first
    arc_m = facts.route_arc_m
    return int(np.argmax(arc_m >= arc_m.max() - NO_NEARER_M))


def _at_the_end(facts: Facts, _: MetricResult) -> int:
    return facts.frames - 1


_LOST_AT: Final[Mapping[str, Callable[[Facts, MetricResult], int]]] = {
    "no_collision": _first_contact_at_fault,
    "drivable_area": _off_the_road,
    "driving_direction": _farthest_back,
    "obstacle_passed": _stopped_advancing,
    "making_progress": _stopped_advancing,
    "progress": _stopped_advancing,
    "time_to_collision": _nearest_contact,
    "speed_limit": _fastest,
    "comfort": _roughest,
}
"""The others are decided in the last frame."""
