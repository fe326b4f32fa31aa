"""Lane changes: how many of the lane changes to the goal lane did the ego make?"""

from __future__ import annotations

import numpy as np
import shapely

from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.scenario.route import goal_arc_m
from interplan_sumo.world.lane_changes import lane_changes_needed


@metric(failure="goal lane missed")
def lane_changes(facts: Facts) -> MetricResult:
    """1 less the share of the needed lane changes that is left at the end, at least 0.

    The end is the last frame: the lane of the route that holds the centre
    then, or held it last if the centre is between lanes. Off the roadblocks of
    the route at the end the score is 0. Where none is needed, 1 or 0.
    """
    scenario = facts.staged
    need = lane_changes_needed(facts.roads, scenario.route, scenario.goal.lane)
    initial = need.get(scenario.start.lane)
    last = last_route_lane(facts, need) if on_route_at_end(facts) else None
    final = None if last is None else need[last]
    if final is None:
        score, reason = 0.0, "ended off the route"
    elif final == 0:
        score, reason = 1.0, None
    else:
        score = max(0.0, 1.0 - final / initial) if initial else 0.0
        reason = f"ended {final} lane{'s' if final > 1 else ''} beside the goal lane, on lane {last}"
    detail = {"initial": initial, "final": final, "goal": final == 0, "last_lane": last}
    return MetricResult(score, detail, reason=reason)


def on_route_at_end(facts: Facts) -> bool:
    """Whether the centre is inside a roadblock of the route in the last frame.

    The frame that passes the goal line may already lie beyond the last
    roadblock; the one before it counts as well then.
    """
    passed = facts.frames > 1 and facts.route_arc_m[-1] >= goal_arc_m(facts.roads, facts.staged)
    polygons = [facts.roads.roadblocks[block].polygon for block in facts.staged.route]
    return any(bool(np.any(shapely.contains_xy(polygons, x, y))) for x, y in facts.centre[-2 if passed else -1 :])


def last_route_lane(facts: Facts, need: dict[str, int]) -> str | None:
    """The lane or connector in `need` that held the centre last; of several the one with the least need."""
    inside = facts.containment
    for frame in range(facts.frames - 1, -1, -1):
        held = [lane for lane in (*inside.lanes[frame], *inside.connectors[frame]) if lane in need]
        if held:
            return min(held, key=lambda lane: (need[lane], lane))
    return None
