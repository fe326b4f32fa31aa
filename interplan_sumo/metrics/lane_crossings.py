"""Lane crossings: when the ego's body left its lane and where it arrived; nuPlan's lane-change statistics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.world.geometry import Ints
from interplan_sumo.world.roads import Roads

HIGHEST_FAILED_SHARE = 0.3
"""nuPlan's bound."""

BodyLanes = frozenset[str] | None


@dataclass(frozen=True, slots=True)
class Crossing:
    """The frames from the first in which the body is astride to the first in which it no longer is."""

    start: int
    end: int
    duration_s: float
    success: bool
    """It arrived in a lane that neither is nor continues the one it came from."""


@metric(informative=True)
def lane_crossings(facts: Facts) -> MetricResult:
    """Count, duration and share of failures; informs only."""
    crossings = find_crossings(facts.roads, facts.body_lanes, facts.trace.ego.time_us)
    durations = [c.duration_s for c in crossings]
    failed = sum(not c.success for c in crossings) / len(crossings) if crossings else 0.0
    detail = {
        "count": len(crossings),
        "longest_s": max(durations, default=None),
        "mean_s": sum(durations) / len(durations) if durations else None,
        "failed_share": failed,
        "failed_share_within": failed <= HIGHEST_FAILED_SHARE,
    }
    return MetricResult(None, detail)


def find_crossings(roads: Roads, body: Sequence[BodyLanes], time_us: Ints) -> tuple[Crossing, ...]:
    """Crossings in the lanes that hold the body per frame (see `shared_lanes`).

    One that is open at the end, or ends off all lanes, has failed. A drive that
    begins astride has no crossing there.
    """
    found: list[Crossing] = []
    start: int | None = None
    for frame in range(1, len(body)):
        if start is None:
            if body[frame] is None and body[frame - 1]:
                start = frame
        elif body[frame] is not None:
            found.append(_closed(roads, body, time_us, start, frame))
            start = None
    if start is not None:
        found.append(_closed(roads, body, time_us, start, len(body) - 1))
    return tuple(found)


def _closed(roads: Roads, body: Sequence[BodyLanes], time_us: Ints, start: int, end: int) -> Crossing:
    before, after = body[start - 1] or frozenset(), body[end] or frozenset()
    same = before.union(*(roads.outgoing(lane) for lane in before))
    return Crossing(start, end, float(time_us[end] - time_us[start]) * 1e-6, bool(after) and not same & after)
