"""`Roads` as the tables that nuPlan's map classes ask for: what a GeoPackage of the map holds, without the file."""

from __future__ import annotations

from collections import defaultdict
from math import nan
from typing import Any

import geopandas
import numpy as np
import shapely

from interplan_sumo.maps import schema
from interplan_sumo.maps.rules import areas_by_layer
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import LaneLike, Roads

_NONE = 0
"""In a column of references, where there is nothing to refer to: ids are positive."""


def vector_layers(roads: Roads) -> dict[str, geopandas.GeoDataFrame]:
    """Every layer that nuPlan's map classes query, by its name in the GeoPackage; empty ones too.

    As nuPlan's own loader hands them over: indexed by the id as text, the id
    again in column `fid`, geometries in the projected system. Columns are those
    that its classes read. Centre lines have a vertex at least every metre.
    """
    layers = {
        name: _Rows(layer) for name, layer in schema.LAYERS.items() if layer.geometry in ("Polygon", "LineString")
    }
    lines = _Lines(layers[schema.BASELINES], layers[schema.BOUNDARIES])
    _add_lanes(layers[schema.LANES], lines, roads)
    _add_connectors(layers[schema.CONNECTORS], layers[schema.CONNECTOR_POLYGONS], lines, roads)
    _add_blocks(layers[schema.ROADBLOCKS], layers[schema.ROADBLOCK_CONNECTORS], roads)
    for area in roads.intersections:
        layers[schema.INTERSECTIONS].add(area.id, area.polygon, intersection_type_fid=int(area.kind))
    for stop in roads.stop_lines.values():
        layers[schema.STOP_LINES].add(stop.id, stop.polygon, stop_polygon_type_fid=int(stop.kind))
    for name, areas in areas_by_layer(roads).items():
        for area in areas:
            layers[name].add(area.id, area.polygon)
    return {name: rows.table(roads.crs) for name, rows in layers.items()}


class _Rows:
    """Rows of one layer in the making."""

    def __init__(self, layer: schema.Layer) -> None:
        self._names = (*layer.needed, *layer.helpful)
        self._ids: list[str] = []
        self._shapes: list[shapely.Geometry] = []
        self._columns: defaultdict[str, list[Any]] = defaultdict(list)

    def add(self, id_: str, shape: shapely.Geometry, **columns: Any) -> None:
        self._ids.append(id_)
        self._shapes.append(shape)
        for name, value in columns.items():
            self._columns[name].append(value)

    def table(self, crs: str) -> geopandas.GeoDataFrame:
        columns = {name: self._columns[name] for name in self._names}
        return geopandas.GeoDataFrame({**columns, "fid": self._ids}, index=self._ids, geometry=self._shapes, crs=crs)


class _Lines:
    """Centre lines and boundaries, which have ids of their own; lanes side by side share the line between them."""

    def __init__(self, baselines: _Rows, boundaries: _Rows) -> None:
        self._baselines = baselines
        self._boundaries = boundaries
        self._known: dict[bytes, int] = {}

    def add_baseline(self, lane: LaneLike, **owner: int) -> None:
        line = lane.centerline
        if np.diff(line.arc_m).max() > schema.MAX_SPACING_M + 1e-3:  # a written grid may stretch it by a hair
            line = line.resampled(schema.MAX_SPACING_M)
        self._baselines.add(lane.id, line.linestring, **owner)

    def boundary_ids(self, lane: LaneLike) -> dict[str, int]:
        return {
            "left_boundary_fid": self._boundary_id(lane.left_boundary),
            "right_boundary_fid": self._boundary_id(lane.right_boundary),
        }

    def _boundary_id(self, line: Polyline) -> int:
        key = line.points.tobytes()
        if key not in self._known:
            self._known[key] = len(self._known) + 1
            self._boundaries.add(str(self._known[key]), line.linestring)
        return self._known[key]


def _add_lanes(rows: _Rows, lines: _Lines, roads: Roads) -> None:
    for lane in roads.lanes.values():
        lines.add_baseline(lane, lane_fid=int(lane.id), lane_connector_fid=_NONE)
        rows.add(
            lane.id,
            lane.polygon,
            lane_fid=int(lane.id),
            lane_group_fid=int(lane.roadblock_id),
            lane_index=lane.index,
            speed_limit_mps=_or_nan(lane.speed_limit_mps),
            **lines.boundary_ids(lane),
        )


def _add_connectors(rows: _Rows, shapes: _Rows, lines: _Lines, roads: Roads) -> None:
    """The connectors as lines, and their polygons, which are a layer of their own."""
    for connector in roads.connectors.values():
        lines.add_baseline(connector, lane_fid=_NONE, lane_connector_fid=int(connector.id))
        rows.add(
            connector.id,
            connector.centerline.linestring,
            # nuPlan's words are those of the connector: traffic exits the lane behind it and enters the one ahead.
            exit_lane_fid=int(connector.from_lane_id),
            entry_lane_fid=int(connector.to_lane_id),
            lane_group_connector_fid=int(connector.roadblock_id),
            traffic_light_stop_line_fids=",".join(connector.stop_line_ids),
            speed_limit_mps=_or_nan(connector.speed_limit_mps),
            turn_type_fid=int(connector.turn),
        )
        shapes.add(
            connector.id, connector.polygon, lane_connector_fid=int(connector.id), **lines.boundary_ids(connector)
        )


def _add_blocks(blocks: _Rows, connectors: _Rows, roads: Roads) -> None:
    for block in roads.roadblocks.values():
        if not block.is_connector:
            blocks.add(block.id, block.polygon)
            continue
        connectors.add(
            block.id,
            block.polygon,
            intersection_fid=int(block.intersection_id or _NONE),
            from_lane_group_fid=int(block.from_id or _NONE),
            to_lane_group_fid=int(block.to_id or _NONE),
        )


def _or_nan(limit_mps: float | None) -> float:
    """An unknown limit as nuPlan's classes know it."""
    return nan if limit_mps is None else limit_mps
