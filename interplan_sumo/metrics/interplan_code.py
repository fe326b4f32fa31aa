"""interPlan's terms as the published code computes them, for profile `interplan-code`.

They are kept for comparison; `lane_changes` and `obstacle_passed` are what we
stand for. The published expert is not a drive but the chain of lanes to the
goal, so that chain takes its place here.
"""

from __future__ import annotations

import numpy as np

from interplan_sumo.metrics.expert_route import project_m
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.metrics.progress import nuplan_progress, stopped_advancing
from interplan_sumo.scenario.route import route_lanes
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Roads

UNKNOWN_START_SCORE = 0.2607
"""What the published code gives if the first lanes of ego and expert share no roadblock."""
NOTHING_NEEDED_SCORE = 0.5
"""What it gives for ending elsewhere when no lane change was needed."""


@metric(failure="goal lane missed")
def published_lane_changes(facts: Facts) -> MetricResult:
    """1 less the share of lane changes left, both counted as differences of lane index inside one roadblock.

    Where the published code crashes and loses the scenario the score is 0 and the reason says so.
    """
    chain = route_lanes(facts.roads, facts.staged)
    chain_by_block = {facts.roads[lane].roadblock_id: lane for lane in chain}
    driven = [place[0] for place in facts.places if place]
    start = facts.staged.start.lane
    beside = chain_by_block.get(facts.roads[start].roadblock_id)
    initial = None if beside is None else index_distance(facts.roads, start, beside)
    final = None
    for lane in reversed(driven):
        expected = chain_by_block.get(facts.roads[lane].roadblock_id)
        if expected is not None:
            final = index_distance(facts.roads, lane, expected)
            break
    detail = {"initial": initial, "final": final, "goal": final == 0}
    if final is None:
        return MetricResult(0.0, detail, reason="never on the route; the published code loses such a run")
    if initial is None:
        return MetricResult(UNKNOWN_START_SCORE, detail, reason="the start lane shares no roadblock with the route")
    if final == 0:
        return MetricResult(1.0, detail)
    score = max(0.0, 1.0 - final / initial) if initial else NOTHING_NEEDED_SCORE
    return MetricResult(score, detail, reason=f"ended {final} lane{'s' if final > 1 else ''} beside the goal lane")


def index_distance(roads: Roads, lane: str, other: str) -> int:
    """Difference of the places of two lanes of one roadblock."""
    siblings = roads.roadblocks[roads[lane].roadblock_id].lane_ids
    return abs(siblings.index(lane) - siblings.index(other))


@metric(failure="obstacle not passed", lost_at=stopped_advancing)
def published_obstacle_passed(facts: Facts) -> MetricResult:
    """1 if the progress ratio reaches the share of the expert's way at which the last obstacle centre lies."""
    ratio = nuplan_progress(facts).score or 0.0
    travelled = facts.expert_centre
    moved = len(travelled) > 1 and bool(np.ptp(travelled, axis=0).any())
    if not moved:
        return MetricResult(0.0, {"required_ratio": None, "ratio": ratio}, reason="the expert did not move")
    line = Polyline(travelled)
    # of a pedestrian's way across its end counts, of an obstacle its middle
    centres = np.array([c[-1] if len(c) == 2 else c.mean(axis=0) for c in facts.obstacle_corners])
    required = float(project_m(line, centres).max() / line.length_m)
    passed = ratio >= required
    reason = None if passed else f"made {ratio:.0%} of the expert's progress, {required:.0%} lead past the obstacle"
    return MetricResult(1.0 if passed else 0.0, {"required_ratio": required, "ratio": ratio}, reason=reason)
