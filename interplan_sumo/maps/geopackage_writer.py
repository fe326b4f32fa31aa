"""`Roads` written as a GeoPackage that nuPlan's own map classes open."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyogrio
import shapely
from numpy.typing import NDArray
from pyogrio.raw import write
from pyproj.exceptions import ProjError

from interplan_sumo.errors import MapError
from interplan_sumo.maps import schema
from interplan_sumo.maps.rules import areas_by_layer, schema_problems
from interplan_sumo.maps.schema import Value
from interplan_sumo.maps.tables import snapped, transformer_to_stored
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import Area, LaneLike, Roadblock, Roads

GRID_M = 1e-6
"""Coordinates are written as multiples of this, so that reading them back undoes the rounding of longitudes."""

# Codes of boundary lines in nuPlan's files: dashed between lanes, solid at the edge, none painted on connectors.
_DASHED, _SOLID, _VIRTUAL = 0, 2, 3

# The bytes of a file must not depend on the day; any fixed date will do.
_GDAL_OPTIONS = {"OGR_CURRENT_DATE": "2024-01-01T00:00:00.000Z", "OGR_SQLITE_SYNCHRONOUS": "OFF"}


def write_map(roads: Roads, path: Path) -> None:
    """Write the map with nuPlan's complete schema; folders are made, a file of that name is replaced as a whole.

    MapError with the first broken rules if nuPlan's classes could not use it
    (`rules.schema_problems`). Coordinates are rounded to 1e-6 m and centre
    lines get a vertex at least every metre; nothing else is changed, so that
    reading gives the same roads again, and writing those gives the same bytes.
    """
    path = Path(path)
    roads = _prepared(roads)
    problems = schema_problems(roads)
    if problems:
        more = f" (and {len(problems) - 1} more; `schema_problems` lists them)" if len(problems) > 1 else ""
        raise MapError(f"map {roads.name} cannot be written: {problems[0]}{more}")
    layers = _layers(roads)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=path.parent, prefix=".writing-") as folder, _gdal_options(_GDAL_OPTIONS):
            file = Path(folder) / "map.gpkg"
            for name, rows in layers.items():
                _write_layer(file, name, rows, roads.crs)
            os.replace(file, path)
    except OSError as error:
        raise MapError(f"cannot write {path}: {error.strerror or error}") from error


# --- what is written ---------------------------------------------------------------------------


@dataclass
class _Rows:
    """Rows of one layer in the making; columns that are not given get the schema's filler."""

    ids: list[int] = field(default_factory=list)
    shapes: list[shapely.Geometry] = field(default_factory=list)
    columns: dict[str, list[Value]] = field(default_factory=lambda: defaultdict(list))

    def add(self, id_: int, shape: shapely.Geometry | None, **columns: Value) -> int:
        self.ids.append(id_)
        if shape is not None:
            self.shapes.append(shape)
        for name, value in columns.items():
            self.columns[name].append(value)
        return id_


def _prepared(roads: Roads) -> Roads:
    """The same roads on the grid of the file, everything in the order of its id."""

    def areas(found: Sequence[Area]) -> tuple[Area, ...]:
        return tuple(replace(area, polygon=_on_grid(area.polygon)) for area in sorted(found, key=lambda a: _rank(a.id)))

    def keyed(found: Mapping[str, Any]) -> dict[str, Any]:
        return {key: replace(found[key], polygon=_on_grid(found[key].polygon)) for key in sorted(found, key=_rank)}

    intersections = sorted(roads.intersections, key=lambda area: _rank(area.id))
    return replace(
        roads,
        lanes={key: replace(lane, **_lines(lane)) for key, lane in keyed(roads.lanes).items()},
        connectors={key: replace(lane, **_lines(lane)) for key, lane in keyed(roads.connectors).items()},
        roadblocks=keyed(roads.roadblocks),
        stop_lines=keyed(roads.stop_lines),
        intersections=tuple(replace(area, polygon=_on_grid(area.polygon)) for area in intersections),
        crosswalks=areas(roads.crosswalks),
        walkways=areas(roads.walkways),
        carparks=areas(roads.carparks),
        road_segments=areas(roads.road_segments),
        generic_drivable_areas=areas(roads.generic_drivable_areas),
    )


def _rank(id_: str) -> tuple[int, str]:
    """Sorts ids as numbers; what is no number comes first and is refused later."""
    return (int(id_), "") if id_.isascii() and id_.isdecimal() else (-1, id_)


def _lines(lane: LaneLike) -> dict[str, Polyline]:
    line = lane.centerline
    if np.diff(line.arc_m).max() > schema.MAX_SPACING_M + GRID_M:
        line = line.resampled(schema.MAX_SPACING_M - 2 * GRID_M)
    lines = {"centerline": line, "left_boundary": lane.left_boundary, "right_boundary": lane.right_boundary}
    try:
        return {name: Polyline(snapped(line.points, GRID_M)) for name, line in lines.items()}
    except ValueError as error:
        raise MapError(f"lane or connector {lane.id} cannot be written: {error}") from error


def _on_grid(polygon: shapely.Polygon) -> shapely.Polygon:
    return shapely.transform(polygon, lambda xy: snapped(xy, GRID_M))


def _layers(roads: Roads) -> dict[str, _Rows]:
    """The rows of all layers, in the order of the file."""
    layers = {name: _Rows() for name in schema.LAYERS}
    free = _FreeIds(roads)
    boundaries = _Boundaries(layers[schema.BOUNDARIES], free)
    for block in roads.roadblocks.values():
        if block.is_connector:
            _add_connectors(layers, roads, block, free, boundaries)
        else:
            _add_lanes(layers, roads, block, free, boundaries)
    for area in roads.intersections:
        layers[schema.INTERSECTIONS].add(int(area.id), area.polygon, intersection_type_fid=int(area.kind))
    _add_stop_lines(layers[schema.STOP_LINES], roads)
    for name, areas in areas_by_layer(roads).items():
        for area in areas:
            layers[name].add(int(area.id), area.polygon)
    layers[schema.ROAD_SEGMENTS].columns["lane_group_fids"] = list(_blocks_inside(roads))
    meta = {
        schema.GEOGRAPHIC_CRS_KEY: schema.STORED_CRS.lower(),
        schema.PROJECTED_CRS_KEY: roads.crs.lower() if roads.crs.lower().startswith("epsg:") else roads.crs,
        schema.DRIVING_SIDE_KEY: roads.driving_side,
        schema.GRID_KEY: f"{GRID_M:g}",
    }
    for row, (key, value) in enumerate(meta.items(), start=1):
        layers[schema.META].add(row, None, key=key, value=value)
    return layers


class _FreeIds:
    """Hands out ids above all that the map uses, so that no two things in the file share one."""

    def __init__(self, roads: Roads) -> None:
        areas = (area.id for areas in areas_by_layer(roads).values() for area in areas)
        used = (*roads.lanes, *roads.connectors, *roads.roadblocks, *roads.stop_lines, *areas)
        self._last = max(map(int, (*used, *(area.id for area in roads.intersections))), default=0)

    def __call__(self) -> int:
        self._last += 1
        return self._last


class _Boundaries:
    """The layer of boundary lines: lanes side by side share the row of the line between them."""

    def __init__(self, rows: _Rows, free: _FreeIds) -> None:
        self._rows = rows
        self._free = free
        self._known: dict[tuple[int, bytes], int] = {}

    def id_of(self, line: Polyline, kind: int) -> int:
        key = (kind, line.points.tobytes())
        if key not in self._known:
            self._known[key] = self._rows.add(self._free(), line.linestring, boundary_type_fid=kind)
        return self._known[key]


def _add_lanes(
    layers: Mapping[str, _Rows], roads: Roads, block: Roadblock, free: _FreeIds, boundaries: _Boundaries
) -> None:
    """A roadblock and its lanes."""
    lanes = [roads.lanes[id_] for id_ in block.lane_ids]
    sides: list[int] = []
    for place, lane in enumerate(lanes):
        id_ = int(lane.id)
        left = boundaries.id_of(lane.left_boundary, _DASHED if place else _SOLID)
        right = boundaries.id_of(lane.right_boundary, _DASHED if place + 1 < len(lanes) else _SOLID)
        sides += [left, right]
        layers[schema.LANES].add(
            id_,
            lane.polygon,
            lane_fid=id_,
            lane_group_fid=int(block.id),
            lane_index=lane.index,
            left_boundary_fid=left,
            right_boundary_fid=right,
            speed_limit_mps=_or_null(lane.speed_limit_mps),
        )
        layers[schema.BASELINES].add(free(), lane.centerline.linestring, lane_fid=float(id_), lane_connector_fid=_NULL)
    outer = {"left_boundary_fid": sides[0], "right_boundary_fid": sides[-1]} if sides else {}
    layers[schema.ROADBLOCKS].add(
        int(block.id), block.polygon, **({"left_boundary_fid": 0, "right_boundary_fid": 0} | outer)
    )


def _add_connectors(
    layers: Mapping[str, _Rows], roads: Roads, block: Roadblock, free: _FreeIds, boundaries: _Boundaries
) -> None:
    """A roadblock connector and its connectors."""
    inside = int(block.intersection_id or 0)
    for connector in sorted((roads.connectors[id_] for id_ in block.lane_ids), key=lambda c: int(c.id)):
        id_ = int(connector.id)
        start, end = roads.lanes[connector.from_lane_id], roads.lanes[connector.to_lane_id]
        layers[schema.CONNECTORS].add(
            id_,
            connector.centerline.linestring,
            # nuPlan's words are those of the connector: traffic exits the lane behind it and enters the one ahead.
            exit_lane_group_fid=int(start.roadblock_id),
            exit_lane_fid=int(start.id),
            entry_lane_group_fid=int(end.roadblock_id),
            entry_lane_fid=int(end.id),
            lane_group_connector_fid=int(block.id),
            intersection_fid=inside,
            turn_type_fid=int(connector.turn),
            traffic_light_stop_line_fids=",".join(connector.stop_line_ids),
            speed_limit_mps=_or_null(connector.speed_limit_mps),
        )
        baseline = layers[schema.BASELINES].add(
            free(), connector.centerline.linestring, lane_fid=_NULL, lane_connector_fid=float(id_)
        )
        layers[schema.CONNECTOR_POLYGONS].add(
            free(),
            connector.polygon,
            baseline_path_fid=baseline,
            lane_connector_fid=id_,
            left_boundary_fid=boundaries.id_of(connector.left_boundary, _VIRTUAL),
            right_boundary_fid=boundaries.id_of(connector.right_boundary, _VIRTUAL),
        )
    layers[schema.ROADBLOCK_CONNECTORS].add(
        int(block.id),
        block.polygon,
        intersection_fid=inside,
        from_lane_group_fid=int(block.from_id or 0),
        to_lane_group_fid=int(block.to_id or 0),
    )


def _add_stop_lines(rows: _Rows, roads: Roads) -> None:
    held: dict[str, list[str]] = defaultdict(list)
    for connector in roads.connectors.values():
        for stop in connector.stop_line_ids:
            held[stop].append(connector.id)
    for stop in roads.stop_lines.values():
        connectors = held[stop.id]
        blocks = sorted({int(roads.lanes[roads.connectors[c].from_lane_id].roadblock_id) for c in connectors})
        rows.add(
            int(stop.id),
            stop.polygon,
            stop_polygon_type_fid=int(stop.kind),
            lane_group_fid=blocks[0] if blocks else 0,
            lane_connector_fids=",".join(connectors),
        )


def _blocks_inside(roads: Roads) -> Iterator[str]:
    """For each road segment the roadblocks that lie in it."""
    blocks = [block for block in roads.roadblocks.values() if not block.is_connector]
    middles = shapely.STRtree([shapely.point_on_surface(block.polygon) for block in blocks])
    for area in roads.road_segments:
        yield ",".join(blocks[row].id for row in np.sort(middles.query(area.polygon, predicate="contains")))


_NULL = float("nan")


def _or_null(limit_mps: float | None) -> float:
    """NULL for an unknown limit: nuPlan skips the check there."""
    return _NULL if limit_mps is None else limit_mps


# --- how it is written -------------------------------------------------------------------------


@contextmanager
def _gdal_options(options: Mapping[str, str]) -> Generator[None]:
    """GDAL's options set for a while."""
    before = {name: pyogrio.get_gdal_config_option(name) for name in options}
    pyogrio.set_gdal_config_options(dict(options))
    try:
        yield
    finally:
        pyogrio.set_gdal_config_options(before)


def _write_layer(file: Path, name: str, rows: _Rows, crs: str) -> None:
    layer = schema.LAYERS[name]
    order = np.argsort(np.array(rows.ids, dtype=np.int64), kind="stable")
    columns: dict[str, NDArray[Any]] = {"fid": np.array(rows.ids, dtype=np.int64)[order]}
    for column, filler in layer.columns.items():
        values = rows.columns.get(column) or [filler] * len(order)
        columns[column] = np.array(values, dtype=object if isinstance(filler, str) else type(filler))[order]
    geometry: NDArray[Any] | None = None
    if layer.geometry is not None:
        shapes = np.array(rows.shapes, dtype=object)[order] if rows.shapes else np.zeros(0, dtype=object)
        geometry = np.asarray(shapely.to_wkb(_stored(shapes, crs), byte_order=1), dtype=object)
    write(
        file,
        geometry,
        list(columns.values()),
        list(columns),
        layer=name,
        driver="GPKG",
        geometry_type=layer.geometry,
        crs=schema.STORED_CRS if layer.geometry else None,
        promote_to_multi=False,
        append=file.exists(),
        layer_options={"FID": "fid", "GEOMETRY_NAME": "geom", "SPATIAL_INDEX": "NO"}
        if layer.geometry
        else {"FID": "fid"},
    )


def _stored(shapes: NDArray[np.object_], crs: str) -> NDArray[np.object_]:
    """Geometries as longitudes and latitudes."""
    xy: Floats = shapely.get_coordinates(shapes)
    if not len(xy):
        return shapes
    try:
        degrees = np.stack(transformer_to_stored(crs).transform(xy[:, 0], xy[:, 1]), axis=1)
    except ProjError as error:
        raise MapError(f"coordinates cannot be turned from {crs} to {schema.STORED_CRS}: {error}") from error
    if not np.isfinite(degrees).all():
        raise MapError(f"a coordinate lies outside the reach of {crs}")
    return shapely.set_coordinates(shapes, degrees)
