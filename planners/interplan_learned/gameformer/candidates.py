"""Candidate paths: ways along the lanes of the route, each joined to the ego at several distances."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from interplan_planners.common.paths import centerline
from interplan_planners.common.route_search import lanes_of_route
from interplan_sumo.planner import Mission
from interplan_sumo.world.geometry import Floats, Polyline, Pose

REACH_M: Final = 120.0
"""So far ways are sought, beyond the lane on which they begin."""
NEAR_LANE_M: Final = 4.0
"""Ways begin on the lanes of the ego's roadblock that are nearer to the rear axle than this."""
OFF_ROUTE_M: Final = 5.0
"""There are none if the route is further away."""
SHORT_M: Final = 0.2 * REACH_M
"""Ways that are shorter are left out where a longer one leads on."""
JOINS_M: Final = (5.0, 10.0, 15.0, 20.0)
"""Arc lengths on a way at which a path from the ego reaches it."""
_LEAST_M: Final = 1.0
"""A way of which less is left is none."""
_JOIN_POINTS: Final = 20


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A path of the rear axle, map frame."""

    points: Floats
    """(N, 2) from the ego on."""
    lanes: tuple[str, ...]
    """Lanes and connectors of its way."""
    beside_m: float
    """How far beside the way the ego is."""
    length_m: float
    """Of what is left of the way."""


class CandidatePaths:
    """The candidate paths of one mission."""

    def __init__(self, mission: Mission) -> None:
        self._roads = mission.roads
        self._members = lanes_of_route(mission.roads, mission.route)
        self._blocks = [mission.roads.roadblocks[block] for block in mission.route]
        self._polygons = [
            np.array([mission.roads[lane].polygon for lane in block.lane_ids], dtype=object) for block in self._blocks
        ]
        self._ways: dict[str, list[tuple[tuple[str, ...], Polyline]]] = {}

    def block_under(self, rear_axle: Pose) -> tuple[int, Floats] | None:
        """Index of the route's first roadblock that holds the rear axle, else of the nearest; and its lanes' distances.

        None where the route is further than `OFF_ROUTE_M` away.
        """
        point = shapely.Point(rear_axle.x_m, rear_axle.y_m)
        distances = [shapely.distance(polygons, point) for polygons in self._polygons]
        nearest = [float(each.min()) for each in distances]
        index = int(np.argmin(nearest)) if nearest else 0
        return (index, distances[index]) if nearest and nearest[index] <= OFF_ROUTE_M else None

    def lanes_beside(self, index: int) -> int:
        """How many lanes or connectors a roadblock of the route has."""
        return len(self._blocks[index].lane_ids)

    def of(self, rear_axle: Pose, index: int, distances_m: Floats) -> list[Candidate]:
        """Candidates from a roadblock of the route on, those of the nearest way first; may be none."""
        lanes = self._blocks[index].lane_ids
        chosen = np.flatnonzero(distances_m < NEAR_LANE_M).tolist() or [int(distances_m.argmin())]
        ways: list[tuple[float, float, tuple[str, ...], Polyline]] = []
        for lane in (lanes[row] for row in chosen):
            for chain, line in self._ways_from(lane):
                arc_m, left_m = line.project_point(rear_axle.x_m, rear_axle.y_m)
                if line.length_m - arc_m >= _LEAST_M:
                    ways.append((abs(left_m), line.length_m - arc_m, chain, line))
        if not ways:
            return []
        enough_m = min(SHORT_M, max(length_m for _, length_m, _, _ in ways))
        kept = sorted((way for way in ways if way[1] >= enough_m), key=lambda way: way[0])
        return [
            Candidate(joined(rear_axle, line, line.length_m - length_m, join_m), chain, beside_m, length_m)
            for beside_m, length_m, chain, line in kept
            for join_m in joins(length_m)
        ]

    def _ways_from(self, lane: str) -> list[tuple[tuple[str, ...], Polyline]]:
        if lane not in self._ways:
            chains = self._chains(lane, 0.0)
            self._ways[lane] = [(chain, centerline(self._roads, chain)) for chain in chains]
        return self._ways[lane]

    def _chains(self, lane: str, passed_m: float) -> list[tuple[str, ...]]:
        """Depth first: all chains of lanes of the route from a lane on, until they are long enough or end."""
        ahead = [each for each in self._roads.outgoing(lane) if each in self._members] if passed_m < REACH_M else []
        return [
            (lane, *chain)
            for each in ahead
            for chain in self._chains(each, passed_m + self._roads[each].centerline.length_m)
        ] or [(lane,)]


def joined(start: Pose, way: Polyline, from_m: float, join_m: float) -> Floats:
    """(N, 2) a cubic Bezier curve from a pose to the way `join_m` after `from_m`, then the way, up to `REACH_M`."""
    end_x, end_y, end_rad = way.poses_at(from_m + join_m)[0].tolist()
    third_m = np.hypot(end_x - start.x_m, end_y - start.y_m) / 3.0
    corners = np.array(
        (
            (start.x_m, start.y_m),
            (start.x_m + third_m * np.cos(start.heading_rad), start.y_m + third_m * np.sin(start.heading_rad)),
            (end_x - third_m * np.cos(end_rad), end_y - third_m * np.sin(end_rad)),
            (end_x, end_y),
        )
    )
    u = np.linspace(0.0, 1.0, _JOIN_POINTS)[:, None]
    weights = np.concatenate(((1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3), axis=1)
    last_m = min(from_m + REACH_M, way.length_m)
    inside = way.points[(way.arc_m > from_m + join_m + 0.1) & (way.arc_m < last_m - 0.1)]
    last = way.poses_at(last_m)[:, :2] if last_m > from_m + join_m + 0.1 else np.zeros((0, 2))
    return np.concatenate((weights @ corners, inside, last))


def joins(length_m: float) -> tuple[float, ...]:
    """Where a way of that length may be reached."""
    return tuple(each for each in JOINS_M if each < length_m) or (length_m / 2.0,)
