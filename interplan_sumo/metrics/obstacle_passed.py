"""Obstacle passed: did the ego get past what blocked its way?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from interplan_sumo.metrics.circumstances import how_it_went
from interplan_sumo.metrics.expert_route import project_m
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.metrics.progress import stopped_advancing
from interplan_sumo.world.geometry import Floats, Polyline

REAR_CORNERS = (1, 2)


@metric(failure="obstacle not passed", lost_at=stopped_advancing)
def obstacle_passed(facts: Facts) -> MetricResult:
    """1 if in some frame the whole rear bumper lies beyond every obstacle along the route, else 0."""
    margin = clear_by_m(facts.route_line, facts.corners, facts.obstacle_corners)
    best = float(margin.max(initial=-np.inf))
    passed = best > 0.0
    first = float(facts.time_s[int(np.argmax(margin > 0.0))]) if passed else None
    reason = None if passed else f"stayed {-best:.1f} m short of clearing the last obstacle; {how_it_went(facts)}"
    return MetricResult(
        1.0 if passed else 0.0, {"passed_at_s": first, "best_margin_m": best}, {"margin_m": margin}, reason
    )


def clear_by_m(line: Polyline, ego_corners: Floats, obstacles: Sequence[Floats]) -> Floats:
    """(N,) how far the rear bumper of the ego's box (N, 4, 2) is past the farthest obstacle corner along a line.

    Negative where it is not past; infinite without obstacles.
    """
    rear = project_m(line, ego_corners[:, REAR_CORNERS].reshape(-1, 2)).reshape(-1, len(REAR_CORNERS)).min(axis=1)
    if not obstacles:
        return np.full(len(rear), np.inf)
    return rear - float(project_m(line, np.concatenate(list(obstacles))).max())
