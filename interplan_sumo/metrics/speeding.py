"""Speeding: did the ego race? Unlike `speed_limit`, which weighs every overspeed, it is about what nobody would do."""

from __future__ import annotations

from math import inf

import numpy as np

from interplan_sumo.metrics.expert_route import project_m
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.metrics.speed_limit import place_limit_mps
from interplan_sumo.scenario.route import route_lanes
from interplan_sumo.world.geometry import Floats, Ints

NEVER = 1.5
"""No frame may be faster than this share of the limit."""
BRIEFLY = 1.25
BRIEFLY_S = 1.0
"""In all at most so long faster than that."""
BRAKING_MPS2 = 2.5
SLOWING_S = 3.0
"""So long after a drop the limit is what this braking allows from the old one."""
_ROUNDING = 1e-6


def fastest_frame(_: Facts, result: MetricResult) -> int:
    """Where the speed is the largest share of the limit."""
    return int(np.argmax(result.series["share_of_limit"]))


@metric(failure="far too fast", lost_at=fastest_frame)
def speeding(facts: Facts) -> MetricResult:
    """0 if a frame is above `NEVER` times the limit, or more than `BRIEFLY_S` in all above `BRIEFLY` times, else 1."""
    limit = slowing_limits_mps(lane_limits_mps(facts), facts.step_us * 1e-6)
    share = facts.speed_mps / limit
    fastest = float(share.max(initial=0.0))
    beyond_s = float((share > BRIEFLY + _ROUNDING).sum()) * facts.step_us * 1e-6
    raced = fastest > NEVER + _ROUNDING or beyond_s > BRIEFLY_S + _ROUNDING
    reason = None
    if raced:
        worst = int(np.argmax(share))
        reason = (
            f"{facts.speed_mps[worst]:.1f} m/s where {limit[worst]:.1f} are allowed at {facts.time_s[worst]:.1f} s, "
            f"{beyond_s:.1f} s in all above {BRIEFLY:g} times the limit"
        )
    detail = {"largest_share": fastest, "beyond_s": beyond_s}
    return MetricResult(0.0 if raced else 1.0, detail, {"share_of_limit": share}, reason)


def lane_limits_mps(facts: Facts) -> Floats:
    """(N,) limit of the ego's lane in each frame; where that has none, or it is in none, of the nearest route lane.

    Infinite where no lane of the route says any.
    """
    known = {place: place_limit_mps(facts.roads, place) for place in set(facts.places)}
    limits = np.array([known[place] for place in facts.places], dtype=np.float64)
    unknown = np.flatnonzero(~np.isfinite(limits))
    if len(unknown) and facts.scenario is not None:
        limits[unknown] = _route_limits_mps(facts, unknown)
    return limits


def _route_limits_mps(facts: Facts, frames: Ints) -> Floats:
    """(K,) limit of the lane of the route's chain that is nearest in each of some frames, one with a limit."""
    roads, xy = facts.roads, facts.centre[frames]
    least, found = np.full(len(frames), inf), np.full(len(frames), inf)
    for lane_id in route_lanes(roads, facts.staged):
        limit = place_limit_mps(roads, (lane_id,))
        line = roads[lane_id].centerline
        if not np.isfinite(limit):
            continue
        nearest = line.poses_at(project_m(line, xy))[:, :2]
        away = np.hypot(*(xy - nearest).T)
        nearer = away < least
        least[nearer], found[nearer] = away[nearer], limit
    return found


def slowing_limits_mps(limit_mps: Floats, step_s: float) -> Floats:
    """(N,) the limits as a driver meets them who brakes with `BRAKING_MPS2` from where they drop."""
    met = limit_mps.copy()
    old, since = inf, inf
    for frame in range(1, len(met)):
        since += step_s
        if limit_mps[frame] < limit_mps[frame - 1]:
            old, since = float(met[frame - 1]), step_s
        if since <= SLOWING_S + _ROUNDING and np.isfinite(old):
            met[frame] = max(limit_mps[frame], old - BRAKING_MPS2 * since)
    return met
