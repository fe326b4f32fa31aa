"""Last resort: lanes and connectors that nuPlan's rules cannot bear are taken out, each with its reason."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import replace

from interplan_sumo.maps import schema
from interplan_sumo.maps.importers.lines import SHORTEST_M
from interplan_sumo.maps.rules import schema_problems
from interplan_sumo.world.roads import Roads

_ROUNDS = 4
_LAYERS = (schema.LANES, schema.CONNECTORS, schema.CONNECTOR_POLYGONS)


def drop_invalid(roads: Roads) -> tuple[Roads, dict[str, str]]:
    """The roads without the lanes and connectors that break a rule, and why each of those does, by its id.

    So does a lane of which others have left no surface. With a lane go the
    connectors that join it. What else is wrong stays, for the writer to refuse.
    """
    reasons: dict[str, str] = {}
    for _ in range(_ROUNDS):
        broken: dict[str, str] = {}
        for problem in schema_problems(roads):
            if problem.layer in _LAYERS and problem.id in roads:
                broken.setdefault(problem.id, problem.message)
        for lane in roads.lanes.values():
            if lane.polygon.area < SHORTEST_M * lane.centerline.length_m:  # netconvert has no lanes without width
                broken.setdefault(lane.id, "other lanes lie on all of it")
        if not broken:
            break
        reasons |= broken
        roads = _without(roads, broken.keys())
    return roads, reasons


def _without(roads: Roads, ids: Set[str]) -> Roads:
    """The roads without some lanes and connectors, and without what then leads nowhere."""
    lanes = {key: lane for key, lane in roads.lanes.items() if key not in ids}
    connectors = {
        key: connector
        for key, connector in roads.connectors.items()
        if key not in ids and connector.from_lane_id in lanes and connector.to_lane_id in lanes
    }
    kept = lanes.keys() | connectors.keys()
    members = {key: tuple(i for i in block.lane_ids if i in kept) for key, block in roads.roadblocks.items()}
    roadblocks = {key: replace(block, lane_ids=members[key]) for key, block in roads.roadblocks.items() if members[key]}
    used = {block.intersection_id for block in roadblocks.values()}
    return replace(
        roads,
        lanes=lanes,
        connectors=connectors,
        roadblocks=roadblocks,
        intersections=tuple(area for area in roads.intersections if area.id in used),
    )
