"""Diagnostics: what else one wants to know of a drive; informs only."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from interplan_sumo.metrics.association import runs
from interplan_sumo.metrics.braking_behind import hardest_braking
from interplan_sumo.metrics.collisions import STOPPED_MPS
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.lane_crossings import find_crossings
from interplan_sumo.metrics.manoeuvres import aborted_changes, accepted_gaps
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.metrics.red_lights import red_light_runs
from interplan_sumo.metrics.time_to_collision import span_with_ego_s
from interplan_sumo.world.geometry import Floats, box_corners


@metric(informative=True)
def diagnostics(facts: Facts) -> MetricResult:
    """Nearest approach, time to collision at true velocities, braking behind the ego, accepted gaps, aborted lane
    changes, red lights, waiting, jerk, planner time.

    Series: distance to the nearest actor and time to collision, infinite where
    there is nobody; speed, lane ("" off the lanes) and offset from its centre
    line, left positive, not a number off the lanes.
    """
    distance = distances_m(facts)
    time_to_collision = true_times_s(facts)
    crossings = find_crossings(facts.roads, facts.body_lanes, facts.trace.ego.time_us)
    detail = {
        "distance_m": _least(facts, distance),
        "time_to_collision_s": _least(facts, time_to_collision),
        "jerk_mps3": _percentiles(np.abs(facts.comfort_signals.get("jerk_mps3", np.zeros(0)))),
        "waiting": waiting(facts),
        "planner_s": _percentiles(facts.trace.plan_wall_s),
        "braking_behind": hardest_braking(facts),
        "accepted_gaps": accepted_gaps(facts, crossings),
        "aborted_lane_changes": aborted_changes(facts, crossings),
        "red_lights_run": red_light_runs(facts),
    }
    per_frame = {
        "distance_m": _per_frame(facts, distance),
        "time_to_collision_s": _per_frame(facts, time_to_collision),
        "speed_mps": facts.speed_mps,
        "lane": np.array([place[0] if place else "" for place in facts.places], dtype=object),
        "offset_m": offsets_m(facts),
    }
    return MetricResult(None, detail, per_frame)


def distances_m(facts: Facts) -> Floats:
    """(R,) distance between ego and actor boxes; infinite for rows that cannot be the nearest of their frame."""
    actors = facts.trace.actors
    shape = facts.trace.shape
    centres = np.hypot(*(facts.actor_xy - facts.centre[actors.frame]).T)
    radii = (np.hypot(shape.length_m, shape.width_m) + np.hypot(actors.length_m, actors.width_m)) / 2
    nearest = np.full(facts.frames, np.inf)
    np.minimum.at(nearest, actors.frame, centres)
    rows = np.flatnonzero(centres - radii <= nearest[actors.frame])
    distance = np.full(len(actors), np.inf)
    if len(rows):
        columns = ("x_m", "y_m", "heading_rad", "length_m", "width_m")
        boxes = shapely.polygons(box_corners(*(getattr(actors, c)[rows] for c in columns)))
        egos = np.asarray(shapely.polygons(facts.corners))
        distance[rows] = shapely.distance(egos[actors.frame[rows]], boxes)
    return distance


def true_times_s(facts: Facts) -> Floats:
    """(R,) time until the boxes meet at constant true velocities, whoever is where; infinite if they never do.

    Unlike nuPlan's metric it is exact, has no horizon, looks in all
    directions and lets a reversing vehicle reverse. Tracks already hit do not count.
    """
    actors = facts.trace.actors
    times = np.full(len(actors), np.inf)
    rows = np.flatnonzero(facts.not_hit)
    begin, cease = span_with_ego_s(facts, rows, np.column_stack((actors.vx_mps[rows], actors.vy_mps[rows])))
    meets = (begin <= cease) & (cease >= 0.0)
    times[rows[meets]] = np.maximum(0.0, begin[meets])
    return times


def offsets_m(facts: Facts) -> Floats:
    """(N,) distance of the centre from the centre line of its lane, left positive; not a number off the lanes."""
    offset = np.full(facts.frames, np.nan)
    first = [place[0] if place else "" for place in facts.places]
    for lane_id in dict.fromkeys(filter(None, first)):
        rows = [frame for frame, other in enumerate(first) if other == lane_id]
        offset[rows] = facts.roads[lane_id].centerline.project(facts.centre[rows])[1]
    return offset


def waiting(facts: Facts) -> dict[str, Any]:
    """How long the ego stood in all, and its longest wait with the time at which that began."""
    standing = facts.speed_mps <= STOPPED_MPS
    stretches = [(first, end) for first, end in runs(standing.tolist()) if standing[first]]
    # a step counts if it ends at rest, so the first frame has none
    waits = [(end - max(first, 1), max(first, 1) - 1) for first, end in stretches if end > 1]
    steps, since = max(waits, key=lambda wait: wait[0], default=(0, 0))
    step_s = facts.step_us * 1e-6
    longest = {"duration_s": steps * step_s, "time_s": float(facts.time_s[since])} if steps else None
    return {"total_s": float(standing[1:].sum()) * step_s, "longest": longest}


def _per_frame(facts: Facts, per_row: Floats) -> Floats:
    least = np.full(facts.frames, np.inf)
    np.minimum.at(least, facts.trace.actors.frame, per_row)
    return least


def _least(facts: Facts, per_row: Floats) -> dict[str, Any] | None:
    """The least value with its time and track; None if nothing is finite."""
    if not np.isfinite(per_row).any():
        return None
    row = int(np.argmin(per_row))
    actors = facts.trace.actors
    return {
        "least": float(per_row[row]),
        "time_s": float(facts.time_s[actors.frame[row]]),
        "track": str(actors.ids[row]),
    }


def _percentiles(values: Floats) -> dict[str, float] | None:
    """Median, 90th and 99th percentile and maximum; None without values."""
    if not len(values):
        return None
    p50, p90, p99 = np.percentile(values, (50, 90, 99))
    return {"p50": float(p50), "p90": float(p90), "p99": float(p99), "max": float(values.max())}
