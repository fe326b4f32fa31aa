"""Repairs routes that do not start at the ego, have gaps or run in circles; as PDM does before it plans."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import shapely

from interplan_sumo.world.geometry import Pose, wrap_angle
from interplan_sumo.world.roads import Roads

# PDM's limits, in roadblocks and in metres and radians from the ego's rear axle.
DEPTH_BACKWARD = 15
DEPTH_FORWARD = 30
NEAR_M = 1.0
FARTHEST_FROM_LINE_M = 3.0
LARGEST_TURN_RAD = 0.7853981633974483  # 45 degrees


def corrected_route(roads: Roads, route: tuple[str, ...], at: Pose) -> tuple[str, ...]:
    """The route, made to start where the ego's rear axle is, without gaps and without circles.

    If the ego is on no block of the route, the way from its block to the route
    is sought: up to 15 blocks back from the route's start, else up to 30 ahead
    to the block of the route that is met first. Blocks that are missing
    between two others are filled in, up to 30. Where the route comes back to
    the ego's block it is cut. A route that cannot be repaired stays as it is.
    """
    here = block_at(roads, route, at)
    if here not in route:
        back = _way(roads.incoming_roadblocks, route[0], {here}, DEPTH_BACKWARD)
        if back:
            route = (*reversed(back[1:]), *route)
        else:
            ahead = _way(roads.outgoing_roadblocks, here, set(route), DEPTH_FORWARD)
            if ahead:
                route = (*ahead[:-1], *route[route.index(ahead[-1]) :])
    filled = [route[0]]
    for block in route[1:]:
        if block not in roads.outgoing_roadblocks(filled[-1]):
            missing = _way(roads.outgoing_roadblocks, filled[-1], {block}, DEPTH_FORWARD)
            filled += missing[1:-1]
        filled.append(block)
    if here in filled:
        again = filled.index(here) + 1
        if here in filled[again:]:
            del filled[filled.index(here, again) :]
    return tuple(filled)


def block_at(roads: Roads, route: tuple[str, ...], at: Pose) -> str:
    """The roadblock under a pose: one that heads the same way and is near, rather of the route, else the nearest."""
    blocks = sorted({roads[lane].roadblock_id for lane in roads.lanes_near(at.x_m, at.y_m, NEAR_M)})
    if not blocks:
        return roads[roads.nearest_lane(at.x_m, at.y_m)].roadblock_id
    ranks: list[tuple[bool, bool, float, str]] = []
    for block in blocks:
        fits, nearest_m = False, float("inf")
        for lane in roads.roadblocks[block].lane_ids:
            line = roads[lane].centerline
            away_m = float(shapely.distance(line.linestring, shapely.Point(at.x_m, at.y_m)))
            turned = abs(wrap_angle(line.pose_at(line.project_point(at.x_m, at.y_m)[0]).heading_rad - at.heading_rad))
            fits |= bool(turned < LARGEST_TURN_RAD) and away_m < FARTHEST_FROM_LINE_M
            nearest_m = min(nearest_m, away_m)
        ranks.append((not fits, not (fits and block in route), nearest_m, block))
    return min(ranks)[3]


def _way(step: Callable[[str], tuple[str, ...]], start: str, ends: set[str], depth: int) -> tuple[str, ...]:
    """Blocks from `start` to the first of `ends` that is met, both included, breadth first; empty if there is none."""
    parents: dict[str, str | None] = {start: None}
    queue = deque([(start, 0)])
    while queue:
        here, far = queue.popleft()
        if here in ends:
            way: list[str] = []
            at: str | None = here
            while at is not None:
                way.append(at)
                at = parents[at]
            return tuple(reversed(way))
        if far < depth:
            for there in step(here):
                if there not in parents:
                    parents[there] = here
                    queue.append((there, far + 1))
    return ()
