"""The anchor: the one lane on whose centre line SUMO sees the ego."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos

import numpy as np
import shapely

from interplan_sumo.simulation.network import Network

REACH_M = 20.0
"""Beyond this distance from any lane the ego is off the network."""
LANE_CHANGE_PENALTY_M = 0.3
"""A new lane must be nearer by this much: no flicker at a lane line."""
LOCAL_M = 15.0
"""The ego moves less than this in a step, and its box reaches no farther."""
OFF_ROUTE_PENALTY_M = 5.0
"""A lane off the ego's route must be nearer by more than a lane's width."""


@dataclass(frozen=True, slots=True)
class Anchor:
    """A place on the centre line of a SUMO lane, in SUMO's frame."""

    lane: str
    position_m: float
    """SUMO's lane position of the front bumper."""
    x_m: float
    y_m: float
    heading_rad: float
    on_route: bool
    """Whether the lane lies on the ego's SUMO route."""


def find_anchor(
    network: Network,
    front: tuple[float, float],
    heading_rad: float,
    before: Anchor | None,
    route: tuple[str, ...],
) -> Anchor | None:
    """The anchor of an ego whose front bumper's centre is at `front` (SUMO's frame); None when off the network.

    Only lanes of the ego's own direction count, so in an oncoming lane the
    nearest lane of its own side holds the anchor. Among them the nearest
    centre line wins; lanes off the ego's route, and lanes that do not follow
    from the last anchor, are held back.
    """
    if before is not None and before.on_route:
        stays = _still_on(network, before, front, heading_rad)
        if stays is not None:
            return stays
    point = shapely.Point(front)
    return _nearest(network, point, LANE_CHANGE_PENALTY_M, heading_rad, before, route) or _nearest(
        network, point, REACH_M, heading_rad, before, route
    )


def _still_on(network: Network, before: Anchor, front: tuple[float, float], heading_rad: float) -> Anchor | None:
    """The anchor moved along its lane while the front is inside that normal lane: what the full search would find."""
    lane = network.lanes[before.lane]
    if lane.internal:
        return None
    here_m = lane.arc_of(before.position_m)
    arc_m, lateral_m = lane.line.project_point(*front, (here_m - LOCAL_M, here_m + LOCAL_M))
    if abs(lateral_m) > lane.width_m / 2.0 or not 0.0 < arc_m < lane.line.length_m:
        return None
    pose = lane.line.pose_at(arc_m)
    if cos(pose.heading_rad - heading_rad) < 0.0:
        return None
    x_m, y_m = round(pose.x_m, 6), round(pose.y_m, 6)
    return Anchor(lane.id, lane.position_of(arc_m), x_m, y_m, pose.heading_rad, before.on_route)


def _nearest(
    network: Network,
    front: shapely.Point,
    reach_m: float,
    heading_rad: float,
    before: Anchor | None,
    route: tuple[str, ...],
) -> Anchor | None:
    strips, tree = network.strips
    kept = network.continuations(before.lane) if before is not None else frozenset[str]()
    best: tuple[float, str, Anchor] | None = None
    hits = tree.query(front, predicate="dwithin", distance=reach_m)
    away_m = shapely.distance(tree.geometries[hits], front)
    for i in np.lexsort((hits, away_m)):
        if best is not None and away_m[i] > best[0]:
            break  # nothing farther can cost less
        strip = strips[hits[i]]
        lane = strip.lane
        arc_m, lateral_m = strip.line.project_point(front.x, front.y)
        pose = strip.line.pose_at(arc_m)
        if cos(pose.heading_rad - heading_rad) < 0.0:
            continue
        on_route = network.on_route(lane.id, route)
        cost = abs(lateral_m)  # the distance from the line, beyond its ends too
        cost += 0.0 if on_route else OFF_ROUTE_PENALTY_M
        cost += 0.0 if lane.id in kept else LANE_CHANGE_PENALTY_M
        if best is None or (cost, lane.id) < best[:2]:
            x_m, y_m = round(pose.x_m, 6), round(pose.y_m, 6)
            best = (
                cost,
                lane.id,
                Anchor(lane.id, lane.position_of(strip.start_m + arc_m), x_m, y_m, pose.heading_rad, on_route),
            )
    return best[2] if best is not None else None
