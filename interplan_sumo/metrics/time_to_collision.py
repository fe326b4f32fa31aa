"""Time to collision: was a contact ever less than a second away, if everybody went straight on?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.metrics.circumstances import ego_doing
from interplan_sumo.metrics.collisions import AHEAD_RAD, BEHIND_RAD, bearing_rad
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, Ints

# nuPlan's values.
LEAST_S = 0.95
"""Every frame must have more."""
STEP_S = 0.1
STEPS = 29
"""Looked at are 0.1 to 2.9 s; a contact in the present is the collision metric's."""
STANDING_MPS = 0.005
"""At this speed or below the ego has no time to collision."""
TOUCH_M = 1e-9
"""Boxes this close touch: the resolution of coordinates in the millions of metres."""


def nearest_contact(_: Facts, result: MetricResult) -> int:
    """Where the time is least."""
    return int(np.argmin(result.series["time_to_collision_s"]))


@metric(failure="time to collision too short", lost_at=nearest_contact)
def time_to_collision(facts: Facts) -> MetricResult:
    """1 if every frame has more than `LEAST_S`, else 0.

    Tracks ahead count, and those at the side while the ego is astride lanes or
    in an intersection. Tracks already hit do not; a frame in which the ego hits
    somebody at fault has 0 s.
    """
    per_row = row_times_s(facts)
    per_frame = np.full(facts.frames, np.inf)
    np.minimum.at(per_frame, facts.trace.actors.frame, per_row)
    for collision in facts.collisions:
        if collision.at_fault:
            per_frame[collision.frame] = 0.0
    least = float(per_frame.min(initial=np.inf))
    score = 1.0 if least > LEAST_S else 0.0
    reason = None if score else _reason(facts, per_frame, per_row)
    return MetricResult(score, {"least_s": least}, {"time_to_collision_s": per_frame}, reason)


def _reason(facts: Facts, per_frame: Floats, per_row: Floats) -> str:
    frame = int(np.argmin(per_frame))
    actors = facts.trace.actors
    hit = next((c for c in facts.collisions if c.at_fault and c.frame == frame), None)
    rows = actors.rows(frame)
    row = rows.start + int(np.argmin(per_row[rows])) if hit is None else hit.row
    who = f"{ActorKind(int(actors.kind[row])).words} {actors.ids[row]} at {facts.time_s[frame]:.1f} s"
    what = f"close call, {per_frame[frame]:.1f} s from" if hit is None else "collided with"
    return f"{what} {who}; the ego was {ego_doing(facts, frame)}"


def row_times_s(facts: Facts, among: NDArray[np.bool_] | None = None) -> Floats:
    """(R,) time to collision with each row of the actor table, infinite where it does not count or not come.

    With a mask (R,) only the rows `among` it are looked at.
    """
    times = np.full(len(facts.trace.actors), np.inf)
    rows = np.flatnonzero(counted(facts) if among is None else counted(facts) & among)
    if len(rows):
        # along the heading even of a vehicle that reverses, as nuPlan does
        straight_on = _along(facts.trace.actors.heading_rad[rows], facts.actor_speed_mps[rows])
        times[rows] = first_step_s(*span_with_ego_s(facts, rows, straight_on))
    return times


def span_with_ego_s(facts: Facts, rows: Ints, velocity_mps: Floats) -> tuple[Floats, Floats]:
    """`overlap_span_s` of the ego and rows of the actor table that move at the given velocities (K, 2)."""
    actors, ego = facts.trace.actors, facts.trace.ego
    frame = actors.frame[rows]
    return overlap_span_s(
        facts.centre[frame],
        ego.heading_rad[frame],
        np.broadcast_to((facts.trace.shape.length_m, facts.trace.shape.width_m), (len(rows), 2)),
        _along(ego.heading_rad[frame], facts.speed_mps[frame]),
        facts.actor_xy[rows],
        actors.heading_rad[rows],
        np.column_stack((actors.length_m[rows], actors.width_m[rows])),
        velocity_mps,
    )


def counted(facts: Facts) -> NDArray[np.bool_]:
    """(R,) rows of the actor table that are looked at."""
    frame = facts.trace.actors.frame
    bearing = bearing_rad(facts.rear_axle[frame], facts.trace.ego.heading_rad[frame], facts.actor_xy)
    sideways = ~facts.in_one_lane | facts.in_intersection
    seen = (bearing < AHEAD_RAD) | (sideways[frame] & (bearing <= BEHIND_RAD))
    return seen & (facts.speed_mps > STANDING_MPS)[frame] & facts.not_hit


def _along(heading_rad: Floats, speed_mps: Floats) -> Floats:
    """(K, 2) velocity."""
    return np.column_stack((np.cos(heading_rad) * speed_mps, np.sin(heading_rad) * speed_mps))


def overlap_span_s(
    xy_a: Floats,
    heading_a: Floats,
    size_a: Floats,
    velocity_a: Floats,
    xy_b: Floats,
    heading_b: Floats,
    size_b: Floats,
    velocity_b: Floats,
) -> tuple[Floats, Floats]:
    """When pairs of boxes that move straight on without turning begin and cease to overlap.

    All arguments row by row: centre (K, 2), heading (K,), length and width
    (K, 2), velocity (K, 2). Times may be negative; a pair that never meets has
    begin > cease. Exact: on each of the four axes of two rectangles the gap
    between their shadows is linear in time.
    """
    offset, closing = xy_b - xy_a, velocity_b - velocity_a
    begin = np.full(len(offset), -np.inf)
    cease = np.full(len(offset), np.inf)
    between = heading_b - heading_a
    cos, sin = np.abs(np.cos(between)), np.abs(np.sin(between))
    for heading, own, other in ((heading_a, size_a, size_b), (heading_b, size_b, size_a)):
        along_x, along_y = np.cos(heading), np.sin(heading)
        for turn, (axis_x, axis_y) in enumerate(((along_x, along_y), (-along_y, along_x))):
            shadow = other[:, turn] * cos + other[:, 1 - turn] * sin
            reach = (own[:, turn] + shadow) / 2 + TOUCH_M
            gap = offset[:, 0] * axis_x + offset[:, 1] * axis_y
            speed = closing[:, 0] * axis_x + closing[:, 1] * axis_y
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                one, two = (-reach - gap) / speed, (reach - gap) / speed
            still = speed == 0.0
            never = still & (np.abs(gap) > reach)
            begin = np.maximum(begin, np.where(still, np.where(never, np.inf, -np.inf), np.minimum(one, two)))
            cease = np.minimum(cease, np.where(still, np.where(never, -np.inf, np.inf), np.maximum(one, two)))
    return begin, cease


def first_step_s(begin_s: Floats, cease_s: Floats) -> Floats:
    """(K,) the first of the times 0.1, 0.2, ... 2.9 s within each span, infinite if there is none."""
    with np.errstate(invalid="ignore"):
        step = np.maximum(1.0, np.ceil(begin_s / STEP_S - 1e-9))
    meets = (begin_s <= cease_s) & (step <= STEPS) & (step * STEP_S <= cease_s + 1e-9)
    return np.where(meets, step * STEP_S, np.inf)
