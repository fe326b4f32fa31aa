"""Posts: obstacles between two lanes, which cars pass on either side but not while they change lane.

A cone on the line between two lanes blocks neither, so SUMO's cars know nothing
of it. A lane change that is under way beside it would sweep over it: none begins
where it may not be over by then. Where a lane is closed beside one, cars must
get out of that lane, whatever stands between the lanes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import cos, hypot, sin
from typing import NamedTuple

import numpy as np

from interplan_sumo.simulation.agent_control import LONGEST_LANE_CHANGE_S
from interplan_sumo.simulation.agent_registry import AgentSnapshot
from interplan_sumo.simulation.lane_footprint import lanes_overlapped
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.simulation.obstacles import LaneBlockage
from interplan_sumo.simulation.vehicle_types import VehicleType
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.geometry import box_polygons

ACROSS_M = 4.5
"""The middles of the lanes on both sides are no farther from a post than that."""
CLOSED_M = 60.0
"""Not nearer to a post than that a lane of its road is closed."""
ALIGNED = 0.7
"""Cosine of the heading from which on an agent drives along the post's lane."""


class _Post(NamedTuple):
    """In SUMO's frame."""

    x_m: float
    y_m: float
    heading_rad: float
    """Of the lane."""
    half_m: float


class LanePosts:
    """The posts of an episode, and whom they keep in its lane."""

    def __init__(
        self,
        network: SumoNetwork,
        standing: Actors,
        blocked: Sequence[LaneBlockage],
        origin_m: tuple[float, float],
        drivers: Mapping[str, VehicleType],
    ) -> None:
        """`drivers` by agent, as they come."""
        self._drivers = drivers
        self._posts: list[_Post] = []
        x_m, y_m = standing.x_m - origin_m[0], standing.y_m - origin_m[1]
        boxes = box_polygons(x_m, y_m, standing.heading_rad, standing.length_m, standing.width_m)
        pieces, tree = network.pieces
        for row, box in enumerate(boxes):
            on = [pieces[int(hit)] for hit in np.sort(tree.query(box, predicate="intersects"))]
            piece = next((each for each in on if not each.lane.internal), None)
            if piece is None or len(network.edges[piece.lane.edge]) < 2 or lanes_overlapped(network, box):
                continue
            arc_m, _ = piece.line.project_point(float(x_m[row]), float(y_m[row]))
            at_m = piece.lane.position_of(piece.start_m + arc_m)
            beside = network.edges[piece.lane.edge]
            if any(b.lane in beside and b.start_m - CLOSED_M < at_m < b.end_m + CLOSED_M for b in blocked):
                continue
            heading_rad = piece.lane.plain_line.heading_at(piece.start_m + arc_m)
            half_m = hypot(float(standing.length_m[row]), float(standing.width_m[row])) / 2.0
            self._posts.append(_Post(float(x_m[row]), float(y_m[row]), heading_rad, half_m))

    def agents(self, snapshot: AgentSnapshot) -> frozenset[str]:
        """Names of those that must not begin to change lane now."""
        found: set[str] = set()
        for post in self._posts:
            cosine, sine = cos(post.heading_rad), sin(post.heading_rad)
            dx, dy = post.x_m - snapshot.front_x, post.y_m - snapshot.front_y
            along_m, across_m = cosine * dx + sine * dy, cosine * dy - sine * dx
            near = (np.abs(across_m) < ACROSS_M) & (np.cos(snapshot.heading_rad - post.heading_rad) > ALIGNED)
            for row in near.nonzero()[0].tolist():
                driver = self._drivers[snapshot.names[row]]
                speed_mps = float(snapshot.speed_mps[row]) + driver.accel_mps2 * LONGEST_LANE_CHANGE_S / 2.0
                ahead_m = float(along_m[row])
                if -driver.length_m - post.half_m < ahead_m < speed_mps * LONGEST_LANE_CHANGE_S + post.half_m:
                    found.add(snapshot.names[row])
        return frozenset(found)
