"""Driving direction: did the ego move against the traffic?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from interplan_sumo.metrics.association import Place
from interplan_sumo.metrics.circumstances import ego_doing
from interplan_sumo.metrics.expert_route import project_m
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads

# nuPlan's limits.
TOLERATED_M = 2.0
"""Less backward motion than this within the window costs nothing."""
FORBIDDEN_M = 6.0
"""From here on the score is 0; between the two it is 0.5."""
WINDOW_S = 1.0


def farthest_back(_: Facts, result: MetricResult) -> int:
    """The end of the window with the largest backward motion."""
    return int(np.argmin(result.series["progress_in_window_m"]))


@metric(failure="wrong direction", lost_at=farthest_back)
def driving_direction(facts: Facts) -> MetricResult:
    """1, 0.5 or 0 by the largest backward motion along the lanes within a window of one second."""
    windowed = window_sums(along_lanes_m(facts.roads, facts.places, facts.centre), window_steps(facts.step_us))
    lowest = float(windowed.min(initial=0.0))
    score = 1.0 if -lowest < TOLERATED_M else 0.5 if -lowest < FORBIDDEN_M else 0.0
    reason = None
    if score < 1.0:
        frame = int(np.argmin(windowed))
        lane = facts.places[frame][0] if facts.places[frame] else "none"
        reason = (
            f"drove {-lowest:.1f} m against the traffic of lane {lane} in the {WINDOW_S:.0f} s before "
            f"{facts.time_s[frame]:.1f} s; the ego was {ego_doing(facts, frame)}"
        )
    return MetricResult(score, {"lowest_progress_m": lowest}, {"progress_in_window_m": windowed}, reason)


def along_lanes_m(roads: Roads, places: Sequence[Place], xy: Floats) -> Floats:
    """(N,) motion of points (N, 2) along the centre line of the first lane of their place since the frame before.

    0 in no lane, on the frame of a change of lane and on the one after it, and
    wherever the projection is exactly on the start of the line (nuPlan's rules).
    """
    moved = np.zeros(len(xy))
    lane_ids = [place[0] if place else "" for place in places]
    arc = np.zeros(len(xy))
    for lane_id in dict.fromkeys(filter(None, lane_ids)):
        rows = [i for i, other in enumerate(lane_ids) if other == lane_id]
        arc[rows] = project_m(roads[lane_id].centerline, xy[rows])
    current = lane_ids[0] if lane_ids else ""
    last_m: float | None = None
    for frame, lane_id in enumerate(lane_ids):
        if not lane_id:
            continue
        if lane_id != current:
            current, last_m = lane_id, None
            continue
        now_m = float(arc[frame])
        if last_m is not None and now_m != 0.0:
            moved[frame] = now_m - last_m
        last_m = now_m
    return moved


def window_steps(step_us: float) -> int:
    """How many steps the window covers; it sums one value more than that."""
    return int(WINDOW_S * 1e6 / step_us)


def window_sums(values: Floats, steps: int) -> Floats:
    """(N,) sum of each value and the `steps` before it."""
    sums = np.concatenate(([0.0], np.cumsum(values)))
    ends = np.arange(1, len(values) + 1)
    return sums[ends] - sums[np.maximum(0, ends - steps - 1)]
