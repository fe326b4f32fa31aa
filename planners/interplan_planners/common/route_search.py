"""Which lanes lead along a route without a lane change."""

from __future__ import annotations

import shapely

from interplan_sumo.world.ego import EgoShape, EgoState
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


def lane_chain(roads: Roads, route: tuple[str, ...], index: int, lane_id: str) -> tuple[str, ...]:
    """Lanes and connectors from a lane of `route[index]` on, one per block, as far along the route as they lead.

    Breadth first, so that of several ways the first in map order is taken. If
    no way reaches the last block, the longest one is returned.
    """
    parents: list[dict[str, str]] = []
    layer = [lane_id]
    for block in route[index + 1 :]:
        found: dict[str, str] = {}
        for here in layer:
            for there in roads.outgoing(here):
                if roads[there].roadblock_id == block:
                    found.setdefault(there, here)
        if not found:
            break
        parents.append(found)
        layer = list(found)
    chain = [layer[0]]
    for parent in reversed(parents):
        chain.append(parent[chain[-1]])
    return tuple(reversed(chain))


def lanes_of_route(roads: Roads, route: tuple[str, ...]) -> frozenset[str]:
    """All lanes and connectors of a route's blocks."""
    return frozenset(lane_id for block in route for lane_id in roads.roadblocks[block].lane_ids)
