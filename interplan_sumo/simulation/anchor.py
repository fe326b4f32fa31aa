"""The anchor: the one lane on whose centre line SUMO sees the ego."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from interplan_sumo.simulation.network import Network
from interplan_sumo.world.geometry import wrap_angle

REACH_M = 20.0
"""Beyond this distance from any lane the ego is off the network."""
LANE_CHANGE_PENALTY_M = 0.3
"""A new lane must be nearer by this much: no flicker at a lane line."""


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
    names, tree = network.lane_tree
    hits = tree.query(shapely.Point(front), predicate="dwithin", distance=REACH_M)
    kept = network.continuations(before.lane) if before is not None else frozenset[str]()
    best: tuple[float, str, Anchor] | None = None
    for hit in hits:
        lane = network.lanes[names[hit]]
        arc_m, lateral_m = lane.line.project_point(*front)
        pose = lane.line.pose_at(arc_m)
        if abs(wrap_angle(pose.heading_rad - heading_rad)) > np.pi / 2.0:
            continue
        beyond_m = float(np.hypot(pose.x_m - front[0], pose.y_m - front[1]))
        on_route = network.on_route(lane.id, route)
        cost = max(abs(lateral_m), beyond_m)
        cost += 0.0 if on_route else 5.0
        cost += 0.0 if lane.id in kept else LANE_CHANGE_PENALTY_M
        if best is None or (cost, lane.id) < best[:2]:
            x_m, y_m = round(pose.x_m, 6), round(pose.y_m, 6)
            best = (cost, lane.id, Anchor(lane.id, lane.position_of(arc_m), x_m, y_m, pose.heading_rad, on_route))
    return best[2] if best is not None else None
