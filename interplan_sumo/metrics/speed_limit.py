"""Speed limit: how much, and for how long, was the ego too fast?"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from interplan_sumo.metrics.association import Place
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads

OVERSPEED_SCALE_MPS = 2.23
"""nuPlan's: driving this much too fast all the time scores 0."""


def fastest_frame(_: Facts, result: MetricResult) -> int:
    """Where the overspeed is largest."""
    return int(np.argmax(result.series["overspeed_mps"]))


@metric(failure="too fast", lost_at=fastest_frame)
def speed_limit(facts: Facts) -> MetricResult:
    """1 less the mean overspeed divided by `OVERSPEED_SCALE_MPS`, at least 0."""
    over = np.maximum(0.0, facts.speed_mps - limits_mps(facts))
    duration_s = float(facts.time_s[-1]) if facts.frames else 0.0
    score = 1.0
    if over.any() and duration_s > 0.0:
        score = max(0.0, 1.0 - float(over.sum()) * facts.step_us * 1e-6 / (OVERSPEED_SCALE_MPS * duration_s))
    reason = None
    if score < 1.0:
        worst = int(np.argmax(over))
        seconds = float((over > 0.0).sum()) * facts.step_us * 1e-6
        reason = (
            f"above the speed limit for {seconds:.1f} s, by up to {over[worst]:.1f} m/s at {facts.time_s[worst]:.1f} s"
        )
    return MetricResult(score, episodes(over, facts.time_s), {"overspeed_mps": over}, reason)


def limits_mps(facts: Facts) -> Floats:
    """(N,) limit in each frame, infinite where there is none."""
    known = {place: place_limit_mps(facts.roads, place) for place in set(facts.places)}
    return np.array([known[place] for place in facts.places], dtype=np.float64)


def place_limit_mps(roads: Roads, place: Place) -> float:
    """The limit of a lane; on connectors the highest of all lanes they join, never their own (nuPlan's rule).

    Infinite off the lanes, or if any limit asked for is missing or zero.
    """
    if not place:
        return float("inf")
    if place[0] in roads.lanes:
        limits = [roads[place[0]].speed_limit_mps]
    else:
        limits = [roads[e].speed_limit_mps for c in place for e in (*roads.incoming(c), *roads.outgoing(c))]
    known = [limit for limit in limits if limit]
    return max(known) if known and len(known) == len(limits) else float("inf")


def episodes(over: Floats, time_s: Floats) -> dict[str, Any]:
    """Count and size of the uninterrupted stretches above the limit.

    `max_mps` and `min_mps` are the largest and the smallest of the stretches'
    maxima, `mean_mps` the mean of their means weighted by duration. A stretch
    lasts until the first frame after it, or until the last frame; if none lasts
    (only the last frame is too fast) there is no weighted mean, as in nuPlan.
    """
    above = np.concatenate(([False], over > 0.0, [False]))
    edges = np.flatnonzero(np.diff(above)).tolist()
    stretches = list(pairwise(edges))[::2]
    if not stretches:
        return {"violations": 0}
    peaks = [float(over[a:b].max()) for a, b in stretches]
    means = np.array([float(over[a:b].mean()) for a, b in stretches])
    lasts = np.array([time_s[min(b, len(time_s) - 1)] - time_s[a] for a, b in stretches])
    return {
        "violations": len(stretches),
        "max_mps": max(peaks),
        "min_mps": min(peaks),
        "mean_mps": float(np.average(means, weights=lasts)) if lasts.any() else None,
    }
