"""The part of a large map around a place or several, whole and consistent in itself."""

from __future__ import annotations

import math
from collections.abc import Sequence, Set
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.errors import MapError
from interplan_sumo.world.roads import Area, Intersection, Roadblock, Roads, StopLine


def crop(roads: Roads, places: Sequence[tuple[float, float]], radius_m: float) -> Roads:
    """The roads that reach into a circle around one of some places, uncut, with everything that lies on them.

    A roadblock stays whole with all its lanes if one of them reaches into a
    circle; a connector stays if both its lanes do, so every link leads
    somewhere. Areas, intersections and stop lines stay if they reach into a
    circle or overlap a lane or connector that stays. Ids do not change.
    MapError if no lane reaches into any.
    """
    if not (places and np.isfinite(places).all() and math.isfinite(radius_m) and radius_m > 0.0):
        raise ValueError(f"a crop needs finite places and a positive radius, got {list(places)} and {radius_m} m")
    near = {id_ for place in places for id_ in roads.lanes_near(*place, radius_m)}
    blocks = {roads.lanes[id_].roadblock_id for id_ in near if id_ in roads.lanes}
    if not blocks:
        x_m, y_m = places[0]
        raise MapError(f"map {roads.name}: no lane within {radius_m:g} m of ({x_m:.1f}, {y_m:.1f})")
    lanes = {id_: lane for id_, lane in roads.lanes.items() if lane.roadblock_id in blocks}
    connectors = {
        id_: connector
        for id_, connector in roads.connectors.items()
        if connector.from_lane_id in lanes and connector.to_lane_id in lanes
    }
    roadblocks = _kept_blocks(roads, blocks, connectors.keys())

    surfaces = [lane.polygon for lane in (*lanes.values(), *connectors.values())]
    around = _Around(shapely.MultiPoint(places), radius_m, surfaces)
    named = {stop for connector in connectors.values() for stop in connector.stop_line_ids}
    stops = list(roads.stop_lines.values())
    crossings = {block.intersection_id for block in roadblocks.values()}
    return replace(
        roads,
        lanes=lanes,
        connectors=connectors,
        roadblocks=roadblocks,
        stop_lines={
            stop.id: stop for stop, holds in zip(stops, around.holds(stops), strict=True) if holds or stop.id in named
        },
        intersections=tuple(
            area
            for area, holds in zip(roads.intersections, around.holds(roads.intersections), strict=True)
            if holds or area.id in crossings
        ),
        crosswalks=around.only(roads.crosswalks),
        walkways=around.only(roads.walkways),
        carparks=around.only(roads.carparks),
        road_segments=around.only(roads.road_segments),
        generic_drivable_areas=around.only(roads.generic_drivable_areas),
    )


def _kept_blocks(roads: Roads, blocks: Set[str], members: Set[str]) -> dict[str, Roadblock]:
    """The roadblocks themselves, and the roadblock connectors between two of them or with a connector that stays."""
    kept: dict[str, Roadblock] = {}
    for id_, block in roads.roadblocks.items():
        if not block.is_connector:
            if id_ in blocks:
                kept[id_] = block
            continue
        ways = tuple(lane for lane in block.lane_ids if lane in members)
        ends = tuple(end if end in blocks else None for end in (block.from_id, block.to_id))
        if ways or None not in ends:
            kept[id_] = replace(block, lane_ids=ways, from_id=ends[0], to_id=ends[1])
    return kept


class _Around:
    """Which things lie in one of the circles or on lanes that stay."""

    def __init__(self, centers: shapely.MultiPoint, radius_m: float, lanes: Sequence[shapely.Polygon]) -> None:
        self._centers = centers
        self._radius_m = radius_m
        self._lanes = shapely.STRtree(lanes)

    def holds(self, things: Sequence[Area] | Sequence[StopLine] | Sequence[Intersection]) -> NDArray[np.bool_]:
        """(N,) one answer per thing; merely touching a lane's edge is not enough."""
        shapes = np.array([thing.polygon for thing in things], dtype=object)
        held = np.zeros(len(shapes), dtype=np.bool_)
        if len(shapes):
            held |= shapely.dwithin(shapes, self._centers, self._radius_m)
            rows, lanes = self._lanes.query(shapes, predicate="intersects")
            held[rows[shapely.relate_pattern(shapes[rows], self._lanes.geometries[lanes], "T********")]] = True
        return held

    def only(self, areas: Sequence[Area]) -> tuple[Area, ...]:
        return tuple(area for area, holds in zip(areas, self.holds(areas), strict=True) if holds)
