"""Task: did the ego do what the scene asks, how far did it come, and how long did it take?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from interplan_sumo.families import find_family
from interplan_sumo.metrics.circumstances import how_it_went
from interplan_sumo.metrics.expert_route import project_m
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.lane_changes import lane_changes
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.metrics.obstacle_passed import obstacle_passed
from interplan_sumo.metrics.progress import progress_ratio, stopped_advancing
from interplan_sumo.scenario.route import goal_arc_m

UNDONE = 0.25
"""What is left of the score of a drive that did not do its task."""
LEAST_SHARE = 0.2
"""Who gets less far than this share of the certificate's way has not begun."""
BEFORE_OBSTACLE_M = 15.0
"""Who comes this near to the first obstacle or crossing has got as far as one can without solving it."""
SHORT_OF_LINE_SHARE = 0.95
"""Where the certificate itself does not reach the goal line in the time, so much of its way is asked."""
SLACK = 1.25
"""Whoever takes this much longer than the certificate loses nothing."""


@dataclass(frozen=True, slots=True)
class TaskOutcome:
    """What became of the task."""

    ego_m: float
    """How far the ego came along the route, up to the goal line."""
    certificate_m: float
    reaches_line: bool
    """Whether the certificate passes the goal line."""
    undone: tuple[str, ...]
    """What was not done, one clause each."""

    @property
    def done(self) -> bool:
        return not self.undone


def outcome(facts: Facts) -> TaskOutcome:
    """What the ego did and did not do of what the scene asks."""
    goal_m = goal_arc_m(facts.roads, facts.staged)
    ego, expert = facts.route_arc_m, facts.expert_route_ends_m
    ego_m = float(ego[-1] - ego[0]) if len(ego) else 0.0
    certificate_m = float(expert[-1] - expert[0]) if len(expert) else 0.0
    reaches_line = bool(len(expert)) and float(expert[-1]) >= goal_m
    at_line = bool(len(ego)) and float(ego[-1]) >= goal_m
    undone: list[str] = []
    if reaches_line and not at_line:
        undone.append(f"the goal line was still {goal_m - float(ego[-1]) if len(ego) else goal_m:.1f} m ahead")
    elif not reaches_line and ego_m < SHORT_OF_LINE_SHARE * certificate_m:
        undone.append(f"it came {ego_m:.1f} m far, the reference drive {certificate_m:.1f} m")
    if (at_line or not reaches_line) and (missed := _lane_missed(facts, anywhere=not reaches_line)):
        undone.append(f"it passed the goal line but {missed}" if at_line else f"it {missed}")
    if facts.obstacle_corners and (short_m := -float(obstacle_passed(facts).detail["best_margin_m"])) >= 0.0:
        undone.append(f"{short_m:.1f} m were left to clear the last obstacle")
    return TaskOutcome(ego_m, certificate_m, reaches_line, tuple(undone))


def _lane_missed(facts: Facts, *, anywhere: bool) -> str | None:
    """How the ego missed the goal lane, where that is asked: in scenes that need lane changes, or `anywhere`."""
    found = lane_changes(facts)
    asked = anywhere or find_family(facts.staged.family).changes_lanes or found.detail["initial"] != 0
    return found.reason if asked and not found.detail["goal"] else None


@metric(title="task done", failure="task not done", lost_at=stopped_advancing)
def task_done(facts: Facts) -> MetricResult:
    """1 if the task is done, else `UNDONE`.

    Done is whoever passes the goal line in the time, in the goal lane where
    lane changes are needed, and has passed all that must be passed. Where the
    certificate does not reach the line: `SHORT_OF_LINE_SHARE` of its way, in the goal lane.
    """
    found = outcome(facts)
    reason = None if found.done else f"{' and '.join(found.undone)}; {how_it_went(facts)}"
    return MetricResult(1.0 if found.done else UNDONE, {"done": found.done}, reason=reason)


@metric(failure="no progress", lost_at=stopped_advancing)
def strict_making_progress(facts: Facts) -> MetricResult:
    """1 for whoever gets as far as one can without solving the scene, else 0.

    As far is `LEAST_SHARE` of the certificate's way, or to `BEFORE_OBSTACLE_M` before the first obstacle or crossing.
    """
    found = outcome(facts)
    least_m = LEAST_SHARE * found.certificate_m
    if facts.obstacle_corners and facts.frames:
        first_m = float(project_m(facts.route_line, np.concatenate(facts.obstacle_corners)).min())
        least_m = min(least_m, first_m - BEFORE_OBSTACLE_M - float(facts.route_arc_m[0]))
    score = 1.0 if found.ego_m >= least_m else 0.0
    reason = None
    if not score:
        reason = f"came {found.ego_m:.1f} m far, {least_m:.1f} m are asked at least; {how_it_went(facts)}"
    return MetricResult(score, {"ego_m": found.ego_m, "least_m": least_m}, reason=reason)


@metric(title="progress", failure="slow", lost_at=stopped_advancing)
def strict_progress(facts: Facts) -> MetricResult:
    """How quickly the task was done, against `SLACK` times what the certificate took; undone, the share of its way."""
    found = outcome(facts)
    ratio = progress_ratio(found.ego_m, found.certificate_m)
    if not found.done:
        reason = f"came {found.ego_m:.1f} m of the reference drive's {found.certificate_m:.1f} m; {how_it_went(facts)}"
        return MetricResult(ratio, {"ratio": ratio}, reason=reason if ratio < 1.0 else None)
    own_s = float(facts.time_s[-1]) if facts.frames else 0.0
    times = facts.expert.time_us
    certificate_s = float(times[-1] - times[0]) * 1e-6 if len(times) else 0.0
    score = min(1.0, SLACK * certificate_s / own_s) if found.reaches_line and own_s > 0.0 else 1.0
    reason = None
    if score < 1.0:
        reason = f"took {own_s:.1f} s, the reference drive {certificate_s:.1f} s; {how_it_went(facts)}"
    return MetricResult(score, {"own_s": own_s, "certificate_s": certificate_s}, reason=reason)
