"""Surfaces of an imported map: lanes clipped apart, intersections, plain areas."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely

from interplan_sumo.maps.importers.cross_sections import largest, polygons_in, sound
from interplan_sumo.maps.importers.signs import ConnectorControls
from interplan_sumo.maps.junctions import Sets, end_port, start_port
from interplan_sumo.maps.rules import overlapping
from interplan_sumo.world.roads import (
    Area,
    Connector,
    Intersection,
    IntersectionKind,
    Lane,
    Roadblock,
)

_TOUCH_M = 0.01
"""Surfaces that should touch are grown by this before they are joined."""
_MEETING_M2 = 0.5
"""Connectors that share more than this lie in one intersection."""


def clipped(surfaces: Mapping[str, shapely.Polygon]) -> dict[str, shapely.Polygon]:
    """The surfaces without what they share: of two that overlap, the later one gives way."""
    found = dict(surfaces)
    ids = list(surfaces)
    shapes = np.array([surfaces[id_] for id_ in ids], dtype=object)
    for one, other, _ in sorted(overlapping(shapes)):
        left = shapely.difference(found[ids[other]], shapely.buffer(found[ids[one]], _TOUCH_M / 2.0))
        rest = sound(largest(left))
        if not rest.is_empty:
            found[ids[other]] = rest
    return found


def surface_of(polygons: Sequence[shapely.Polygon]) -> shapely.Polygon:
    """The one surface that some polygons side by side cover, without holes; their hull where they lie apart."""
    if len(polygons) == 1:
        return polygons[0]
    grown = shapely.union_all([shapely.buffer(p, _TOUCH_M, join_style="mitre") for p in polygons])
    whole = polygons_in(grown)
    return sound(shapely.Polygon(whole[0].exterior) if len(whole) == 1 else largest(shapely.convex_hull(grown)))


def numbered(shapes: Sequence[shapely.Geometry]) -> tuple[Area, ...]:
    """Areas counted from 1, one for each part of the shapes."""
    parts: list[shapely.Polygon] = []
    for shape in shapes:
        parts += polygons_in(shape if shapely.is_valid(shape) else shapely.make_valid(shape))
    neat = [part for part in map(sound, parts) if not part.is_empty]
    return tuple(Area(str(k), part) for k, part in enumerate(neat, start=1))


def intersections(
    lanes: Mapping[str, Lane],
    connectors: Mapping[str, Connector],
    roadblocks: Mapping[str, Roadblock],
    controls: ConnectorControls,
) -> tuple[tuple[Intersection, ...], dict[str, Roadblock]]:
    """The places where connectors meet, and the roadblocks that now name theirs.

    Connectors meet where they share the end of a roadblock, or more ground than lanes side by side do.
    """
    group = _groups(lanes, connectors)
    members: dict[str, list[str]] = defaultdict(list)
    for id_, name in group.items():
        members[name].append(id_)
    areas: list[Intersection] = []
    place_of: dict[str, str] = {}
    for number, ids in enumerate(members.values(), start=1):
        blocks = {connectors[id_].roadblock_id for id_ in ids}
        ends = {(roadblocks[b].from_id, roadblocks[b].to_id) for b in blocks}
        kind = _kind(ids, ends, controls)
        shape = surface_of([shapely.buffer(connectors[id_].polygon, _TOUCH_M) for id_ in ids])
        areas.append(Intersection(str(number), shape, kind))
        place_of |= dict.fromkeys(blocks, str(number))
    named = {
        id_: replace(block, intersection_id=place_of[id_]) if id_ in place_of else block
        for id_, block in roadblocks.items()
    }
    return tuple(areas), named


def _kind(
    ids: Sequence[str], ends: set[tuple[str | None, str | None]], controls: ConnectorControls
) -> IntersectionKind:
    if any(id_ in controls.lights for id_ in ids):
        return IntersectionKind.TRAFFIC_LIGHT
    if any(id_ in controls.signs for id_ in ids):
        return IntersectionKind.STOP_SIGN
    if len(ends) == 1:
        return IntersectionKind.PASS_THROUGH
    if len({start for start, _ in ends}) == 1:
        return IntersectionKind.LANE_BRANCH
    if len({end for _, end in ends}) == 1:
        return IntersectionKind.LANE_MERGE
    return IntersectionKind.DEFAULT


def _groups(lanes: Mapping[str, Lane], connectors: Mapping[str, Connector]) -> dict[str, str]:
    """Connector -> what names its intersection."""
    sets = Sets()
    for connector in connectors.values():
        sets.join(connector.id, end_port(lanes[connector.from_lane_id].roadblock_id))
        sets.join(connector.id, start_port(lanes[connector.to_lane_id].roadblock_id))
    ids = list(connectors)
    shapes = np.array([connectors[id_].polygon for id_ in ids], dtype=object)
    one, other = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    one, other = one[one < other], other[one < other]
    shared = shapely.area(shapely.intersection(shapes[one], shapes[other]))
    for a, b in zip(one[shared > _MEETING_M2].tolist(), other[shared > _MEETING_M2].tolist(), strict=True):
        sets.join(ids[a], ids[b])
    return {id_: sets.find(id_) for id_ in ids}
