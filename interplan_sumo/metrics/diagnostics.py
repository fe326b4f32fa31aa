"""Diagnostics: what else one wants to know of a drive; informs only."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.metrics.association import runs
from interplan_sumo.metrics.collisions import STOPPED_MPS
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.lane_crossings import find_crossings
from interplan_sumo.metrics.manoeuvres import aborted_changes, accepted_gaps
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.metrics.red_lights import red_light_runs
from interplan_sumo.metrics.time_to_collision import span_with_ego_s
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, Ints, box_corners
from interplan_sumo.world.trace import ActorTable


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
        "distance_m": least(facts, distance),
        "time_to_collision_s": least(facts, time_to_collision),
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


def distances_m(facts: Facts, among: NDArray[np.bool_] | None = None) -> Floats:
    """(R,) distance between ego and actor boxes; infinite for rows that cannot be the nearest of their frame.

    `among` (R,) leaves out all other rows.
    """
    actors = facts.trace.actors
    counted = np.ones(len(actors), dtype=np.bool_) if among is None else among
    shape = facts.trace.shape
    centres = np.hypot(*(facts.actor_xy - facts.centre[actors.frame]).T)
    radii = (np.hypot(shape.length_m, shape.width_m) + np.hypot(actors.length_m, actors.width_m)) / 2
    nearest = np.full(facts.frames, np.inf)
    np.minimum.at(nearest, actors.frame[counted], centres[counted])
    rows = np.flatnonzero(counted & (centres - radii <= nearest[actors.frame]))
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


def least(facts: Facts, per_row: Floats) -> dict[str, Any] | None:
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


# --- how hard somebody behind the ego had to brake -----------------------------------------------

LONGEST_GAP_M = 50.0
"""Who is farther behind is not taken to brake for the ego."""
AT_ONCE = 50
"""So many followers are looked at together, those that brake hardest first."""
SLACK_M = 0.01
"""For the rounding of what is ruled out quickly."""
LARGEST_ANGLE_RAD = np.deg2rad(45.0)
"""Who drives in another direction than this is no follower."""


def hardest_braking(facts: Facts) -> dict[str, Any] | None:
    """The hardest deceleration of any follower, with its time, track and gap; None if no follower ever brakes.

    A follower is a vehicle or bicycle with some of the ego's box straight ahead
    in the corridor of its own width, at most `LONGEST_GAP_M` away, and nobody between.
    """
    actors = facts.trace.actors
    acceleration = accelerations_mps2(facts)
    gap = gaps_to_ego_m(facts, acceleration < 0.0)
    rows = np.flatnonzero(np.isfinite(gap))
    rows = rows[np.argsort(acceleration[rows], kind="stable")]
    for some in np.split(rows, np.arange(AT_ONCE, len(rows), AT_ONCE)):  # it mostly is one of the first
        seen = some[~screened(facts, some, gap[some])]
        if len(seen):
            break
    else:
        return None
    row = int(seen[0])
    return {
        "deceleration_mps2": float(-acceleration[row]),
        "time_s": float(facts.time_s[actors.frame[row]]),
        "track": str(actors.ids[row]),
        "gap_m": float(gap[row]),
    }


def accelerations_mps2(facts: Facts) -> Floats:
    """(R,) change of speed since the frame before; 0 for a row whose track was not there then."""
    before = facts.row_before
    change = (facts.actor_speed_mps - facts.actor_speed_mps[before]) / (facts.step_us * 1e-6)
    return np.where(before >= 0, change, 0.0)


def gaps_to_ego_m(facts: Facts, among: NDArray[np.bool_]) -> Floats:
    """(R,) gap from each follower's front to the nearest corner of the ego; infinite for whoever is no follower.

    `among` (R,) leaves out all other rows.
    """
    actors = facts.trace.actors
    gap = np.full(len(actors), np.inf)
    drives = (actors.kind == ActorKind.VEHICLE) | (actors.kind == ActorKind.BICYCLE)
    turned = facts.trace.ego.heading_rad[actors.frame] - actors.heading_rad
    near = np.hypot(*(facts.centre[actors.frame] - facts.actor_xy).T) < 2 * LONGEST_GAP_M
    rows = np.flatnonzero(among & drives & near & (np.cos(turned) > np.cos(LARGEST_ANGLE_RAD)) & facts.not_hit)
    _, aside = _seen_from(actors, rows, facts.centre[actors.frame[rows]][:, None, :])
    widest_m = np.hypot(facts.trace.shape.length_m, facts.trace.shape.width_m) / 2 + actors.width_m[rows] / 2
    rows = rows[np.abs(aside[:, 0]) < widest_m + SLACK_M]
    along, across = _seen_from(actors, rows, facts.corners[actors.frame[rows]])
    ahead = along.min(axis=1) - actors.length_m[rows] / 2
    half_width = actors.width_m[rows] / 2
    inside = (across.max(axis=1) > -half_width) & (across.min(axis=1) < half_width)
    follows = inside & (ahead >= 0.0) & (ahead <= LONGEST_GAP_M)
    gap[rows[follows]] = ahead[follows]
    return gap


def screened(facts: Facts, rows: Ints, gap_m: Floats) -> NDArray[np.bool_]:
    """(K,) whether the centre of another actor lies between each follower and the ego, in the follower's corridor."""
    actors = facts.trace.actors
    hidden = np.zeros(len(rows), dtype=np.bool_)
    first, last = actors.starts[actors.frame[rows]], actors.starts[actors.frame[rows] + 1]
    counts = last - first
    pair = np.repeat(np.arange(len(rows)), counts)
    other = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + np.repeat(first, counts)
    along, across = _seen_from(actors, rows[pair], facts.actor_xy[other][:, None, :])
    front = actors.length_m[rows[pair]] / 2
    between = (along[:, 0] > front) & (along[:, 0] < front + gap_m[pair])
    between &= np.abs(across[:, 0]) < (actors.width_m[rows[pair]] + actors.width_m[other]) / 2
    hidden[pair[between]] = True
    return hidden


def _seen_from(actors: ActorTable, rows: Ints, xy: Floats) -> tuple[Floats, Floats]:
    """Forward and leftward coordinates (K, P) of points (K, P, 2) as the actors of the rows see them."""
    offset = xy - np.column_stack((actors.x_m[rows], actors.y_m[rows]))[:, None, :]
    cos, sin = np.cos(actors.heading_rad[rows])[:, None], np.sin(actors.heading_rad[rows])[:, None]
    return cos * offset[..., 0] + sin * offset[..., 1], cos * offset[..., 1] - sin * offset[..., 0]
