"""Manoeuvres: into which gaps the ego changed lanes, and how often it turned back; informs only."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely

from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.lane_crossings import Crossing
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.roads import Roads

REACH_M = 100.0
"""Who is farther away along the lanes is no neighbour; planners see as far."""


def accepted_gaps(facts: Facts, crossings: Iterable[Crossing]) -> list[dict[str, Any]]:
    """Leader and follower in the new lane when the ego's centre comes to it, for each lane change that arrives.

    Gaps are between bumpers along the lanes, negative where somebody is
    alongside. Times are what the ego needs to the leader's rear, and the
    follower to the ego's, at the speed of that moment. Lanes that lead the
    other way are left out.
    """
    found: list[dict[str, Any]] = []
    for crossing in crossings:
        arrival = _arrival(facts, crossing) if crossing.success else None
        if arrival is None:
            continue
        frame, lane = arrival
        line = facts.roads[lane].centerline
        arc_m = float(line.project(facts.centre[frame : frame + 1])[0][0])
        ego_heading = float(facts.trace.ego.heading_rad[frame])
        if np.cos(line.pose_at(arc_m).heading_rad - ego_heading) > 0.0:
            gaps = _neighbours(facts, frame, lanes_around(facts.roads, lane, arc_m))
            found.append({"time_s": float(facts.time_s[frame]), "lane": lane, **gaps})
    return found


def aborted_changes(facts: Facts, crossings: Iterable[Crossing]) -> list[dict[str, Any]]:
    """Each time the body reached into a neighbour lane of its direction and came back to its own.

    What the ego had in mind is not on record: a swerve round something counts as well.
    """
    found: list[dict[str, Any]] = []
    for crossing in crossings:
        before, after = facts.body_lanes[crossing.start - 1], facts.body_lanes[crossing.end]
        if crossing.success or not before or not after:
            continue
        own = before.union(*(facts.roads.outgoing(lane) for lane in before), after)
        beside = {
            lane.id
            for own_lane in own
            for lane in (facts.roads.left_of(own_lane), facts.roads.right_of(own_lane))
            if lane is not None
        }
        touched = {
            lane for frame in facts.corner_places[crossing.start : crossing.end] for place in frame for lane in place
        }
        reached = sorted(touched & beside - own)
        if reached:
            began_s = float(facts.time_s[crossing.start])
            found.append({"time_s": began_s, "duration_s": crossing.duration_s, "lane": reached[0]})
    return found


def _arrival(facts: Facts, crossing: Crossing) -> tuple[int, str] | None:
    """Frame in which the centre comes to the lanes where the body arrives, and its lane there."""
    before, after = facts.body_lanes[crossing.start - 1], facts.body_lanes[crossing.end]
    if not before or not after:
        return None
    leading = after.union(*(facts.roads.incoming(lane) for lane in after))
    leading = leading.union(*(facts.roads.incoming(lane) for lane in leading)) - before
    arrival: tuple[int, str] | None = None
    for frame in range(crossing.end, crossing.start - 1, -1):
        inside = leading.intersection(facts.places[frame])
        if inside:
            arrival = frame, min(inside)
        elif facts.places[frame]:  # a point on the edge of two lanes is in none
            break
    return arrival


def lanes_around(roads: Roads, lane: str, arc_m: float, reach_m: float = REACH_M) -> dict[str, float]:
    """Where the lanes and connectors before and after a place start, in metres ahead of it along the lane graph.

    Those that begin, or end, at most `reach_m` away.
    """
    start_m = {lane: -arc_m}
    queue = deque([lane])
    while queue:
        here = queue.popleft()
        end_m = start_m[here] + roads[here].centerline.length_m
        for onward in roads.outgoing(here):
            if end_m <= reach_m and onward not in start_m:
                start_m[onward] = end_m
                queue.append(onward)
    queue = deque([lane])
    while queue:
        here = queue.popleft()
        for back in roads.incoming(here):
            if start_m[here] >= -reach_m and back not in start_m:
                start_m[back] = start_m[here] - roads[back].centerline.length_m
                queue.append(back)
    return start_m


def _neighbours(facts: Facts, frame: int, start_m: dict[str, float]) -> dict[str, dict[str, Any] | None]:
    actors = facts.trace.actors
    rows = np.arange(len(actors))[actors.rows(frame)]
    rows = rows[np.isin(actors.kind[rows], (ActorKind.VEHICLE, ActorKind.BICYCLE))]
    xy = facts.actor_xy[rows]
    ahead_m = np.full(len(rows), np.inf)
    for lane, offset_m in start_m.items():
        inside = np.flatnonzero(shapely.contains_xy(facts.roads[lane].polygon, xy))
        along_m = offset_m + facts.roads[lane].centerline.project(xy[inside])[0]
        nearer = np.abs(along_m) < np.abs(ahead_m[inside])
        ahead_m[inside[nearer]] = along_m[nearer]
    gap_m = np.abs(ahead_m) - (actors.length_m[rows] + facts.trace.shape.length_m) / 2
    gap_m[np.abs(ahead_m) > REACH_M] = np.inf
    ego_mps = float(facts.speed_mps[frame])

    def nearest(side: np.ndarray, closing_mps: np.ndarray | None) -> dict[str, Any] | None:
        chosen = np.flatnonzero(side & np.isfinite(gap_m))
        if not len(chosen):
            return None
        i = int(chosen[np.argmin(gap_m[chosen])])
        speed = ego_mps if closing_mps is None else float(closing_mps[i])
        gap = float(gap_m[i])
        return {"track": str(actors.ids[rows[i]]), "gap_m": gap, "gap_s": gap / speed if speed > 0.0 else None}

    return {
        "leader": nearest(ahead_m > 0.0, None),
        "follower": nearest(ahead_m <= 0.0, facts.actor_speed_mps[rows]),
    }
