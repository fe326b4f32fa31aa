"""Progress: how far along the route, compared with the expert."""

from __future__ import annotations

import numpy as np

from interplan_sumo.metrics.circumstances import how_it_went, longest_wait
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.world.geometry import Floats

FLOOR_M = 2.0
"""nuPlan's: both distances count at least this much; further back than this scores 0."""
LEAST_RATIO = 0.2
"""nuPlan's bound of making progress."""
NO_NEARER_M = 0.1
"""Who gains no more than this gains nothing."""


def stopped_advancing(facts: Facts, _: MetricResult) -> int:
    """The beginning of the longest wait; of who never waited, the first frame as far on the route as it ever came."""
    wait = longest_wait(facts)
    if wait is not None:
        return wait.start
    arc_m = facts.route_arc_m
    return int(np.argmax(arc_m >= arc_m.max() - NO_NEARER_M))


@metric(failure="little progress", lost_at=stopped_advancing)
def progress(facts: Facts) -> MetricResult:
    """Ratio of the ego's and the expert's forward motion along the route centre line, up to the goal.

    The lateral position does not matter: an ego in the oncoming lane advances
    as one in its own. What lies beyond the goal counts for neither.
    """
    ego = facts.route_arc_m
    expert = facts.expert_route_ends_m
    gained = np.diff(ego, prepend=ego[:1])
    ego_m = float(ego[-1] - ego[0]) if len(ego) else 0.0
    expert_m = float(expert[-1] - expert[0]) if len(expert) else 0.0
    return _result(facts, ego_m, expert_m, gained)


@metric(failure="little progress", lost_at=stopped_advancing)
def nuplan_progress(facts: Facts) -> MetricResult:
    """nuPlan's ratio, counted roadblock by roadblock along the expert's way; 1 where the expert was in no lane."""
    if not facts.expert_blocks:
        return MetricResult(1.0, {"ratio": 1.0, "ego_m": None, "expert_m": 0.0})
    ego, expert = facts.block_gains_m
    return _result(facts, float(ego.sum()), float(expert.sum()), ego)


@metric(failure="no progress", lost_at=stopped_advancing)
def making_progress(facts: Facts) -> MetricResult:
    """1 if the progress ratio is at least `LEAST_RATIO`, else 0."""
    return _making(progress(facts))


@metric(failure="no progress", lost_at=stopped_advancing)
def nuplan_making_progress(facts: Facts) -> MetricResult:
    """`making_progress` on nuPlan's ratio."""
    return _making(nuplan_progress(facts))


def progress_ratio(ego_m: float, expert_m: float) -> float:
    """0 for an ego more than `FLOOR_M` behind its start, else the ratio of the floored distances, at most 1."""
    if ego_m < -FLOOR_M:
        return 0.0
    return min(1.0, max(ego_m, FLOOR_M) / max(expert_m, FLOOR_M))


def _result(facts: Facts, ego_m: float, expert_m: float, gained: Floats) -> MetricResult:
    ratio = progress_ratio(ego_m, expert_m)
    reason = None
    if ratio < 1.0:
        reason = f"advanced {ego_m:.1f} m along the route, the expert {expert_m:.1f} m; {how_it_went(facts)}"
    return MetricResult(ratio, {"ratio": ratio, "ego_m": ego_m, "expert_m": expert_m}, {"gained_m": gained}, reason)


def _making(result: MetricResult) -> MetricResult:
    ratio = result.score
    assert ratio is not None
    score = 1.0 if ratio >= LEAST_RATIO else 0.0
    reason = None if score else f"less than {LEAST_RATIO:.0%} of the expert's way: {result.reason}"
    return MetricResult(score, {"ratio": ratio}, reason=reason)
