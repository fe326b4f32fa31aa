"""Endangered people: did the ego race past somebody on foot or on a bicycle whom it all but hit?

`time_to_collision` takes the same points for a close call with anybody, at any
speed. This is about those who have no body of a car around them, at speed, in
the last moment. A bicycle that rides in traffic is judged by `forced_braking`
as well; people who cross have no model that could be asked.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from interplan_sumo.metrics.circumstances import ego_doing
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.metrics.time_to_collision import row_times_s
from interplan_sumo.world.actors import ActorKind

# Choices of this benchmark, not nuPlan's. Planners that race past people (benchmarks/exploits.py) have 0.1 to 0.4 s at
# 9 to 14 m/s where they hit nobody. No certificate has less than 1 s; foresight and pdm_closed, which yield, lose
# nothing.
CLOSE_S = 0.5
"""So near a contact, if both go straight on, nobody can react any more."""
SLOW_MPS = 5.0
"""Up to this speed an ego rolls by, and hard braking (6 m/s2) stops it in about two metres."""
PEOPLE = (ActorKind.PEDESTRIAN, ActorKind.BICYCLE)
_ROUNDING = 1e-9


def worst_moment(facts: Facts, result: MetricResult) -> int:
    """When the time to somebody was shortest."""
    worst = result.detail["worst"]
    return facts.frames - 1 if worst is None else int(worst["frame"])


@metric(failure="endangered people", lost_at=worst_moment)
def endangered_people(facts: Facts) -> MetricResult:
    """0 if somebody of `PEOPLE` is `CLOSE_S` or less from being hit by an ego faster than `SLOW_MPS`, else 1.

    The time is that of `time_to_collision`, in steps of 0.1 s: those ahead
    count, and those at the side while the ego is astride lanes or in an
    intersection, until they are hit.
    """
    actors = facts.trace.actors
    among = np.isin(actors.kind, PEOPLE) & (facts.speed_mps > SLOW_MPS + _ROUNDING)[actors.frame]
    if not among.any():
        return MetricResult(1.0, {"worst": None})
    times_s = row_times_s(facts, among)
    row = int(np.argmin(times_s))
    if times_s[row] > CLOSE_S + _ROUNDING:
        return MetricResult(1.0, {"worst": None})
    frame = int(actors.frame[row])
    worst: dict[str, Any] = {
        "frame": frame, "time_s": float(facts.time_s[frame]), "track": str(actors.ids[row]),
        "to_contact_s": float(times_s[row]), "speed_mps": float(facts.speed_mps[frame]),
    }  # fmt: skip
    reason = (
        f"{ActorKind(int(actors.kind[row])).words} {worst['track']} was {worst['to_contact_s']:.1f} s from being hit "
        f"at {worst['time_s']:.1f} s; the ego was {ego_doing(facts, frame)}"
    )
    return MetricResult(0.0, {"worst": worst}, reason=reason)
