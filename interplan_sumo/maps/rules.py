"""What a map must obey so that nuPlan's classes, and planners written for them, can drive on it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.maps import schema
from interplan_sumo.maps.problem import MapProblem
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Area, Connector, Lane, LaneLike, Roadblock, Roads

MAX_OVERLAP_M = 0.01
"""Lanes drawn with separate vertices along a shared curve overlap by millimetres; nobody drives there."""
MANY_VERTICES, PLAINER_M = 2000, 0.001
"""Polygons of more are held against each other without those that matter by less."""
MAX_SPACING_M = 1.5
"""Vertices of a centre line: planners take headings from the nearest one. Written files keep to 1 m."""
MAX_ID = 2**53
"""Ids beyond this do not survive nuPlan's columns of doubles."""


def schema_problems(roads: Roads) -> list[MapProblem]:
    """Every rule that the map breaks; empty if nuPlan can use it.

    Ids are positive integers, unique across lanes and connectors and across
    roadblocks and roadblock connectors. Lane polygons are disjoint, and so are
    roadblock polygons. Blocks and their members name each other. Centre lines
    run with the traffic between their boundaries, meet at the joints, and have
    vertices close enough to take headings from.
    """
    return [
        *_id_problems(roads),
        *_block_problems(roads),
        *_shape_problems(roads),
        *_line_problems(roads),
        *_joint_problems(roads),
        *_overlaps(schema.LANES, list(roads.lanes.values())),
        *_overlaps(schema.ROADBLOCKS, [block for block in roads.roadblocks.values() if not block.is_connector]),
    ]


def areas_by_layer(roads: Roads) -> dict[str, tuple[Area, ...]]:
    """The plain areas with the layers that they belong to."""
    return {
        schema.CROSSWALKS: roads.crosswalks,
        schema.WALKWAYS: roads.walkways,
        schema.CARPARKS: roads.carparks,
        schema.ROAD_SEGMENTS: roads.road_segments,
        schema.GENERIC_DRIVABLE_AREAS: roads.generic_drivable_areas,
    }


def block_layer(block: Roadblock) -> str:
    return schema.ROADBLOCK_CONNECTORS if block.is_connector else schema.ROADBLOCKS


def lane_layer(lane: LaneLike) -> str:
    return schema.CONNECTORS if isinstance(lane, Connector) else schema.LANES


def _id_problems(roads: Roads) -> Iterator[MapProblem]:
    keyed = (
        *((schema.LANES, key, lane.id) for key, lane in roads.lanes.items()),
        *((schema.CONNECTORS, key, connector.id) for key, connector in roads.connectors.items()),
        *((block_layer(block), key, block.id) for key, block in roads.roadblocks.items()),
        *((schema.STOP_LINES, key, stop.id) for key, stop in roads.stop_lines.items()),
    )
    for layer, key, id_ in keyed:
        if key != id_:
            yield MapProblem("id", layer, id_, f"filed under the id {key}")
    listed = {schema.INTERSECTIONS: [area.id for area in roads.intersections]}
    listed |= {layer: [area.id for area in areas] for layer, areas in areas_by_layer(roads).items()}
    for layer, ids in listed.items():
        for id_, count in Counter(ids).items():
            if count > 1:
                yield MapProblem("id", layer, id_, f"{count} areas of this id")
    for layer, id_ in (*((layer, id_) for layer, _, id_ in keyed), *((k, i) for k, ids in listed.items() for i in ids)):
        if not (id_.isascii() and id_.isdecimal() and 0 < int(id_) < MAX_ID and str(int(id_)) == id_):
            yield MapProblem("id", layer, id_, "the id is not a positive whole number")


def _block_problems(roads: Roads) -> Iterator[MapProblem]:
    blocks = roads.roadblocks
    for lane in (*roads.lanes.values(), *roads.connectors.values()):
        block, named = blocks[lane.roadblock_id], (lane_layer(lane), lane.id)
        if block.is_connector != isinstance(lane, Connector):
            yield MapProblem("membership", *named, f"its block {block.id} is a {block_layer(block)} row")
        elif lane.id not in block.lane_ids:
            yield MapProblem("membership", *named, f"its {block_layer(block)} {block.id} does not list it")
    inside = {area.id for area in roads.intersections}
    for block in blocks.values():
        named = block_layer(block), block.id
        members: list[LaneLike] = [(roads.connectors if block.is_connector else roads.lanes)[i] for i in block.lane_ids]
        for lane in members:
            if lane.roadblock_id != block.id:
                yield MapProblem("membership", *named, f"lists {lane.id}, which belongs to {lane.roadblock_id}")
        order = [lane.index for lane in members if isinstance(lane, Lane)]
        if any(b <= a for a, b in pairwise(order)) or any(index < 0 for index in order):
            said = f"its lanes {', '.join(block.lane_ids)} have the places {order}; they must rise from the left"
            yield MapProblem("membership", *named, said)
        if block.intersection_id is not None and block.intersection_id not in inside:
            said = f"lies in intersection {block.intersection_id}, which does not exist"
            yield MapProblem("membership", *named, said)
        if not block.is_connector:
            continue
        for what, end in (("from", block.from_id), ("to", block.to_id)):
            if end is None or end not in blocks or blocks[end].is_connector:
                yield MapProblem("membership", *named, f"leads {what} roadblock {end}, which does not exist")
        for lane in members:
            if isinstance(lane, Connector):
                ends = roads.lanes[lane.from_lane_id].roadblock_id, roads.lanes[lane.to_lane_id].roadblock_id
                if ends != (block.from_id, block.to_id):
                    said = f"its connector {lane.id} leads from roadblock {ends[0]} to {ends[1]}"
                    yield MapProblem("membership", *named, said)


def _polygons(roads: Roads) -> Iterator[tuple[str, Sequence[Area | LaneLike | Roadblock]]]:
    """Everything with an id and a polygon, layer by layer."""
    yield schema.LANES, list(roads.lanes.values())
    yield schema.CONNECTOR_POLYGONS, list(roads.connectors.values())
    yield schema.ROADBLOCKS, [block for block in roads.roadblocks.values() if not block.is_connector]
    yield schema.ROADBLOCK_CONNECTORS, [block for block in roads.roadblocks.values() if block.is_connector]
    yield schema.STOP_LINES, [Area(stop.id, stop.polygon) for stop in roads.stop_lines.values()]
    yield schema.INTERSECTIONS, [Area(area.id, area.polygon) for area in roads.intersections]
    yield from areas_by_layer(roads).items()


def _shape_problems(roads: Roads) -> Iterator[MapProblem]:
    for layer, items in _polygons(roads):
        shapes = np.array([item.polygon for item in items], dtype=object)
        good = shapely.is_valid(shapes) & (shapely.get_type_id(shapes) == 3) & ~shapely.is_empty(shapes)
        for row in np.flatnonzero(~good).tolist():
            reason = "empty" if shapely.is_empty(shapes[row]) else shapely.is_valid_reason(shapes[row])
            yield MapProblem("shape", layer, items[row].id, f"its polygon is not valid ({reason})")


def _line_problems(roads: Roads) -> Iterator[MapProblem]:
    for lane in (*roads.lanes.values(), *roads.connectors.values()):
        named = lane_layer(lane), lane.id
        limit = lane.speed_limit_mps
        if limit is not None and not 0.0 <= limit < float("inf"):
            yield MapProblem("line", *named, f"a speed limit of {limit} m/s")
        widest = float(np.diff(lane.centerline.arc_m).max())
        if widest > MAX_SPACING_M:
            said = f"vertices of its centre line lie {widest:.2f} m apart, at most {MAX_SPACING_M:g} m allowed"
            yield MapProblem("line", *named, said)
        if _signed_area(np.concatenate((lane.right_boundary.points, lane.left_boundary.points[::-1]))) <= 0.0:
            said = "its left boundary is not on the left of its right one in the direction of travel"
            yield MapProblem("line", *named, said)
        elif lane.centerline.length_m > 1.0 and not lane.left_boundary.runs_with(lane.centerline):
            yield MapProblem("line", *named, "its centre line runs against its boundaries")


def _signed_area(ring: Floats) -> float:
    """Area within a ring of vertices, positive if it runs counter-clockwise."""
    x, y = (ring - ring[0]).T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2.0


def _joint_problems(roads: Roads) -> Iterator[MapProblem]:
    for connector in roads.connectors.values():
        start = roads.lanes[connector.from_lane_id].centerline.points[-1]
        end = roads.lanes[connector.to_lane_id].centerline.points[0]
        line = connector.centerline.points
        for lane, a, b in ((connector.from_lane_id, start, line[0]), (connector.to_lane_id, end, line[-1])):
            gap = float(np.hypot(*(a - b)))
            if gap >= schema.MAX_JOINT_GAP_M:
                said = f"a gap of {gap:.2f} m to lane {lane}, less than {schema.MAX_JOINT_GAP_M:g} m allowed"
                yield MapProblem("joint", schema.CONNECTORS, connector.id, said)


def _overlaps(layer: str, items: Sequence[Lane] | Sequence[Roadblock]) -> Iterator[MapProblem]:
    """Pairs whose interiors meet: nuPlan refuses a point that lies in two of them."""
    shapes = np.array([item.polygon for item in items], dtype=object)
    for one, other, depth in overlapping(shapes):
        yield MapProblem("overlap", layer, items[one].id, f"overlaps {items[other].id} by {depth:.2f} m")


def overlapping(shapes: NDArray[np.object_]) -> list[tuple[int, int, float]]:
    """Pairs of polygons that overlap by more than a drawing tolerance, with the width of the overlap in metres.

    Invalid polygons are left out: they are reported as such.
    """
    rows = np.flatnonzero(shapely.is_valid(shapes))
    if not len(rows):
        return []
    one, other = shapely.STRtree(shapes[rows]).query(shapes[rows], predicate="intersects")
    one, other = rows[one[one < other]], rows[other[one < other]]
    plain = _plainer(shapes)
    common = shapely.intersection(plain[one], plain[other])
    around = shapely.length(common)
    # A sliver of length l and width w has the area l w and the perimeter 2 l.
    width = 2.0 * shapely.area(common) / np.where(around > 0.0, around, 1.0)
    found = np.flatnonzero(width > MAX_OVERLAP_M)
    return [(int(one[k]), int(other[k]), float(width[k])) for k in found]


def _plainer(shapes: NDArray[np.object_]) -> NDArray[np.object_]:
    """Polygons without the vertices that long ones hardly need: two lanes of 8 km on the same ground take a second."""
    many = shapely.get_num_coordinates(shapes) > MANY_VERTICES
    simpler = shapely.simplify(shapes[many], PLAINER_M)
    plain = shapes.copy()
    plain[many] = np.where(shapely.is_valid(simpler), simpler, shapes[many])
    return plain
