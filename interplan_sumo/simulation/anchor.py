"""The anchor: the one lane on whose centre line SUMO sees the ego."""

from __future__ import annotations

from math import cos, hypot, sin
from typing import NamedTuple

from interplan_sumo.simulation.lane_polygons import ego_ring
from interplan_sumo.simulation.network import LanePiece, SumoNetwork
from interplan_sumo.world.ego import EgoShape, EgoState

REACH_M = 20.0
"""Beyond this distance from any lane the ego is off the network."""
LANE_CHANGE_PENALTY_M = 0.3
"""A new lane must be nearer by this much: no flicker at a lane line."""
LOCAL_M = 15.0
"""The ego moves less than this in a step, and its box reaches no farther."""
OFF_ROUTE_PENALTY_M = 5.0
"""A lane off the ego's route must be nearer by more than a lane's width."""
BEND_M = 0.3
"""A lane bends away from its direction at the ego's front by less than this within the ego's length."""


class Anchor(NamedTuple):
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
    network: SumoNetwork,
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
    kept = network.continuations(before.lane) if before is not None else frozenset[str]()
    return _nearest(network, front, LANE_CHANGE_PENALTY_M, heading_rad, kept, route) or _nearest(
        network, front, REACH_M, heading_rad, kept, route
    )


def _still_on(network: SumoNetwork, before: Anchor, front: tuple[float, float], heading_rad: float) -> Anchor | None:
    """The anchor moved along its lane while the front is inside that normal lane: what the full search would find."""
    lane = network.lanes[before.lane]
    if lane.internal:
        return None
    here_m = lane.arc_of(before.position_m)
    arc_m, lateral_m = lane.plain_line.project(*front, (here_m - LOCAL_M, here_m + LOCAL_M))
    if abs(lateral_m) > lane.width_m / 2.0 or not 0.0 < arc_m < lane.plain_line.length_m:
        return None
    pose = lane.plain_line.pose_at(arc_m)
    if cos(pose.heading_rad - heading_rad) < 0.0:
        return None
    x_m, y_m = round(pose.x_m, 6), round(pose.y_m, 6)
    return Anchor(lane.id, lane.position_of(arc_m), x_m, y_m, pose.heading_rad, before.on_route)


def _nearest(
    network: SumoNetwork,
    front: tuple[float, float],
    reach_m: float,
    heading_rad: float,
    kept: frozenset[str],
    route: tuple[str, ...],
) -> Anchor | None:
    """The anchor of the least cost on lanes of the ego's direction that lie within reach."""
    x, y = front
    least: tuple[float, str] | None = None
    best: tuple[LanePiece, float, bool] | None = None
    for piece, away_m in network.pieces_around(x, y, reach_m):
        if least is not None and away_m > least[0]:
            break  # nothing farther can cost less
        arc_m, lateral_m = piece.plain_line.project(x, y)
        line_m = abs(lateral_m)  # the distance from the line, beyond its ends too
        if line_m > reach_m and not piece.reaches(x, y, reach_m):
            continue
        if cos(piece.plain_line.heading_at(arc_m) - heading_rad) < 0.0:
            continue
        on_route = network.on_route(piece.lane.id, route)
        cost = line_m + (0.0 if on_route else OFF_ROUTE_PENALTY_M)
        cost += 0.0 if piece.lane.id in kept else LANE_CHANGE_PENALTY_M
        if least is None or (cost, piece.lane.id) < least:
            least, best = (cost, piece.lane.id), (piece, arc_m, on_route)
    if best is None:
        return None
    piece, arc_m, on_route = best
    pose, position_m = piece.plain_line.pose_at(arc_m), piece.lane.position_of(piece.start_m + arc_m)
    return Anchor(piece.lane.id, position_m, round(pose.x_m, 6), round(pose.y_m, 6), pose.heading_rad, on_route)


def touches_road(
    network: SumoNetwork, ego: EgoState, shape: EgoShape, origin_m: tuple[float, float], anchor: Anchor
) -> bool:
    """Whether the ego's box reaches into any lane."""
    lane, half_m, reach_m = network.lanes[anchor.lane], shape.width_m / 2.0, shape.length_m / 2.0
    dx = ego.x_m - origin_m[0] + reach_m * cos(ego.heading_rad) - anchor.x_m
    dy = ego.y_m - origin_m[1] + reach_m * sin(ego.heading_rad) - anchor.y_m
    away_m = hypot(dx, dy)
    if away_m < half_m:
        return True
    if half_m < anchor.position_m < lane.length_m - half_m:
        nearer_m = half_m * cos(anchor.heading_rad - ego.heading_rad) - BEND_M
        if away_m - nearer_m < lane.width_m / 2.0:  # a front corner is well inside the lane
            return True
    return network.touches_lane(ego_ring(ego, shape, origin_m))
