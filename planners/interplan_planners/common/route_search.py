"""Which lanes lead along a route, where the ego stands on it, and how many lane changes it asks for."""

from __future__ import annotations

import numpy as np
import shapely

from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Pose, wrap_angle
from interplan_sumo.world.lane_changes import lane_changes_needed
from interplan_sumo.world.roads import Roads


def starting_lane(roads: Roads, route: tuple[str, ...], ego: EgoState, shape: EgoShape) -> tuple[int, str]:
    """Index of the route's block on which the ego stands, and its lane or connector there.

    The first one in route order that contains the ego's centre; if none does,
    the one nearest to the ego's box. nuPlan looks at the first two blocks
    only; here an ego that starts further along is found as well.
    """
    lanes = [(index, lane_id) for index, block in enumerate(route) for lane_id in roads.roadblocks[block].lane_ids]
    polygons = [roads[lane_id].polygon for _, lane_id in lanes]
    centre = shapely.Point(ego.x_m, ego.y_m)
    for place, inside in zip(lanes, shapely.contains_properly(polygons, centre), strict=True):
        if inside:
            return place
    return lanes[int(shapely.distance(polygons, ego.polygon(shape)).argmin())]


def lane_chain(
    roads: Roads, route: tuple[str, ...], index: int, lane_id: str, *, shortest: bool = False, depth: int | None = None
) -> tuple[str, ...]:
    """Lanes and connectors from a lane of `route[index]` on, one per block, as far along the route as they lead.

    Breadth first, so that of several ways the first in map order is taken, or
    the shortest one. If no way reaches the last block, the longest one is
    returned. `depth` limits the number of blocks.
    """
    end = len(route) if depth is None else index + depth
    layers: list[dict[str, tuple[float, str]]] = [{lane_id: (0.0, "")}]
    for block in route[index + 1 : end]:
        found: dict[str, tuple[float, str]] = {}
        for here, (way_m, _) in layers[-1].items():
            for there in roads.outgoing(here):
                if roads[there].roadblock_id == block:
                    cost = way_m + roads[there].centerline.length_m if shortest else 0.0
                    if there not in found or cost < found[there][0]:
                        found[there] = (cost, here)
        if not found:
            break
        layers.append(found)
    here = min(layers[-1], key=lambda lane: layers[-1][lane][0])
    chain: list[str] = []
    for layer in reversed(layers):
        chain.append(here)
        here = layer[here][1]
    return tuple(reversed(chain))


def lanes_of_route(roads: Roads, route: tuple[str, ...]) -> frozenset[str]:
    """All lanes and connectors of a route's blocks."""
    return frozenset(lane_id for block in route for lane_id in roads.roadblocks[block].lane_ids)


class LaneFinder:
    """Finds the lane of a route that a car is on, by PDM's rule."""

    def __init__(self, roads: Roads, route: tuple[str, ...]) -> None:
        self._roads = roads
        self._places = [(i, lane_id) for i, block in enumerate(route) for lane_id in roads.roadblocks[block].lane_ids]
        self._polygons = np.array([roads[lane_id].polygon for _, lane_id in self._places], dtype=object)
        shapely.prepare(self._polygons)

    def at(self, x_m: float, y_m: float, heading_rad: float) -> tuple[int, str]:
        """Index of the route's block at a point, and the lane or connector there.

        Among those that contain the point the one with the least heading
        error, then the first in route order; if none does, the nearest.
        """
        inside = np.flatnonzero(shapely.contains_xy(self._polygons, x_m, y_m)).tolist()
        if len(inside) == 1:
            return self._places[inside[0]]
        if not inside:
            return self._places[int(shapely.distance(self._polygons, shapely.Point(x_m, y_m)).argmin())]

        def error_rad(place: tuple[int, str]) -> float:
            line = self._roads[place[1]].centerline
            return abs(float(wrap_angle(line.pose_at(line.project_point(x_m, y_m)[0]).heading_rad - heading_rad)))

        return min((self._places[i] for i in inside), key=error_rad)


def lane_changes_to(roads: Roads, route: tuple[str, ...], goal: Pose) -> dict[str, int]:
    """For each lane of the route: the fewest lane changes on the way to the goal lane; absent where none lead there.

    The goal lane is the one of the last block that contains the goal, else the
    nearest. Going on costs nothing, a step to a neighbour 1; the way stays on
    the route.
    """
    point = shapely.Point(goal.x_m, goal.y_m)
    last = roads.roadblocks[route[-1]].lane_ids
    target = last[int(shapely.distance([roads[lane_id].polygon for lane_id in last], point).argmin())]
    return lane_changes_needed(roads, route, target)
