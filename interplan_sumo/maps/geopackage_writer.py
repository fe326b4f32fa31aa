"""`Roads` written as a GeoPackage that nuPlan's own map classes open."""

from __future__ import annotations

import os
import sqlite3
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, fields, replace
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from pyproj.exceptions import ProjError

from interplan_sumo.errors import MapError
from interplan_sumo.maps import schema
from interplan_sumo.maps.geometry_blobs import SRS_ID, blobs_of
from interplan_sumo.maps.rules import areas_by_layer, schema_problems
from interplan_sumo.maps.schema import Value
from interplan_sumo.maps.tables import snapped, transformer
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import Connector, Lane, LaneLike, Roadblock, Roads

GRID_M = 1e-6
"""Coordinates are written as multiples of this, so that reading them back undoes the rounding of longitudes."""

LONGEST_M = 100_000.0
"""No lane is longer; one that is damaged would fill the memory with a vertex at each metre."""

# Codes of boundary lines in nuPlan's files: dashed between lanes, solid at the edge, none painted on connectors.
_DASHED, _SOLID, _VIRTUAL = 0, 2, 3


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
    layers = layer_rows(roads)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=path.parent, prefix=".writing-") as folder:
            file = Path(folder) / "map.gpkg"
            _write_file(file, layers, roads.crs)
            os.replace(file, path)
    except (OSError, sqlite3.Error) as error:
        raise MapError(f"cannot write {path}: {getattr(error, 'strerror', None) or error}") from error


# --- what is written ---------------------------------------------------------------------------


@dataclass
class LayerRows:
    """Rows of one layer in the making; columns that are not given get the schema's filler."""

    ids: list[int] = field(default_factory=list)
    shapes: list[shapely.Geometry] = field(default_factory=list)
    columns: dict[str, list[Value | None]] = field(default_factory=lambda: defaultdict(list))

    def add(self, id_: int, shape: shapely.Geometry | None, **columns: Value | None) -> int:
        self.ids.append(id_)
        if shape is not None:
            self.shapes.append(shape)
        for name, value in columns.items():
            self.columns[name].append(value)
        return id_


def _prepared(roads: Roads) -> Roads:
    """The same roads on the grid of the file, everything in the order of its id."""
    found: dict[str, Any] = {}
    for name in (part.name for part in fields(roads)):
        things: Any = getattr(roads, name)
        if isinstance(things, Mapping):
            found[name] = {key: _on_grid(things[key]) for key in sorted(things, key=_rank)}
        elif isinstance(things, tuple):
            found[name] = tuple(_on_grid(thing) for thing in sorted(things, key=lambda thing: _rank(thing.id)))
    return replace(roads, **found)


def _rank(id_: str) -> tuple[int, str]:
    """Sorts ids as numbers; what is no number comes first and is refused later."""
    return (int(id_), "") if id_.isascii() and id_.isdecimal() else (-1, id_)


def _lines(lane: LaneLike) -> dict[str, Polyline]:
    line = lane.centerline
    if line.length_m > LONGEST_M:
        long_km, most_km = line.length_m / 1000.0, LONGEST_M / 1000.0
        raise MapError(
            f"lane or connector {lane.id} is {long_km:.0f} km long, expected {most_km:.0f} at most; mend the file"
        )
    if np.diff(line.arc_m).max() > schema.MAX_SPACING_M + 2 * GRID_M:  # both ends of a step lie on the grid
        line = line.resampled(schema.MAX_SPACING_M - 2 * GRID_M)
    lines = {"centerline": line, "left_boundary": lane.left_boundary, "right_boundary": lane.right_boundary}
    try:
        return {name: Polyline(snapped(line.points, GRID_M)) for name, line in lines.items()}
    except ValueError as error:
        raise MapError(f"lane or connector {lane.id} cannot be written: {error}") from error


def _on_grid(thing: Any) -> Any:
    lines = _lines(thing) if isinstance(thing, Lane | Connector) else {}
    return replace(thing, polygon=shapely.transform(thing.polygon, lambda xy: snapped(xy, GRID_M)), **lines)


def layer_rows(roads: Roads) -> dict[str, LayerRows]:
    """The rows of all layers, in the order of the file."""
    layers = {name: LayerRows() for name in schema.LAYERS}
    free = _free_ids(roads)
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


def _free_ids(roads: Roads) -> Iterator[int]:
    """Ids above all that the map uses, so that no two things in the file share one."""
    areas = (area.id for areas in (roads.intersections, *areas_by_layer(roads).values()) for area in areas)
    used = (*roads.lanes, *roads.connectors, *roads.roadblocks, *roads.stop_lines, *areas)
    return count(1 + max(map(int, used), default=0))


class _Boundaries:
    """The layer of boundary lines: lanes side by side share the row of the line between them."""

    def __init__(self, rows: LayerRows, free: Iterator[int]) -> None:
        self._rows = rows
        self._free = free
        self._known: dict[tuple[int, bytes], int] = {}

    def id_of(self, line: Polyline, kind: int) -> int:
        key = (kind, line.points.tobytes())
        if key not in self._known:
            self._known[key] = self._rows.add(next(self._free), line.linestring, boundary_type_fid=kind)
        return self._known[key]


def _add_lanes(
    layers: Mapping[str, LayerRows], roads: Roads, block: Roadblock, free: Iterator[int], boundaries: _Boundaries
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
            speed_limit_mps=lane.speed_limit_mps,
        )
        layers[schema.BASELINES].add(
            next(free), lane.centerline.linestring, lane_fid=float(id_), lane_connector_fid=None
        )
    outer = {"left_boundary_fid": sides[0], "right_boundary_fid": sides[-1]} if sides else {}
    layers[schema.ROADBLOCKS].add(
        int(block.id), block.polygon, **({"left_boundary_fid": 0, "right_boundary_fid": 0} | outer)
    )


def _add_connectors(
    layers: Mapping[str, LayerRows], roads: Roads, block: Roadblock, free: Iterator[int], boundaries: _Boundaries
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
            speed_limit_mps=connector.speed_limit_mps,
        )
        baseline = layers[schema.BASELINES].add(
            next(free), connector.centerline.linestring, lane_fid=None, lane_connector_fid=float(id_)
        )
        layers[schema.CONNECTOR_POLYGONS].add(
            next(free),
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


def _add_stop_lines(rows: LayerRows, roads: Roads) -> None:
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


# --- how it is written -------------------------------------------------------------------------

_COLUMN_TYPES: dict[type, str] = {int: "INTEGER", float: "REAL", bool: "BOOLEAN", str: "TEXT"}
_APPLICATION_ID, _VERSION = int.from_bytes(b"GPKG", "big"), 10300
_DAY = "2024-01-01T00:00:00.000Z"
"""The bytes of a file must not depend on the day; any fixed date will do."""
_REGISTERS = f"""
PRAGMA application_id = {_APPLICATION_ID};
PRAGMA user_version = {_VERSION};
CREATE TABLE gpkg_spatial_ref_sys (
    srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY, organization TEXT NOT NULL,
    organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (
    table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE, description TEXT DEFAULT '',
    last_change DATETIME NOT NULL, min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE,
    srs_id INTEGER REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (
    table_name TEXT NOT NULL UNIQUE REFERENCES gpkg_contents(table_name), column_name TEXT NOT NULL,
    geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL REFERENCES gpkg_spatial_ref_sys(srs_id),
    z TINYINT NOT NULL, m TINYINT NOT NULL, PRIMARY KEY (table_name, column_name));
INSERT INTO gpkg_spatial_ref_sys VALUES
    ('Undefined Cartesian SRS', -1, 'NONE', -1, 'undefined', NULL),
    ('Undefined geographic SRS', 0, 'NONE', 0, 'undefined', NULL),
    ('WGS 84 geodetic', 4326, 'EPSG', 4326, 'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,'
        || 'AUTHORITY["EPSG","7030"]],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],'
        || 'UNIT["degree",0.0174532925199433,AUTHORITY["EPSG","9122"]],AXIS["Latitude",NORTH],AXIS["Longitude",EAST],'
        || 'AUTHORITY["EPSG","4326"]]', 'longitude/latitude in degrees');
"""


def _write_file(file: Path, layers: Mapping[str, LayerRows], crs: str) -> None:
    with closing(sqlite3.connect(file, isolation_level=None)) as tables:
        tables.executescript("PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; BEGIN;" + _REGISTERS)
        for name, rows in layers.items():
            _write_layer(tables, name, rows, crs)
        tables.execute("COMMIT")


def _write_layer(tables: sqlite3.Connection, name: str, rows: LayerRows, crs: str) -> None:
    layer = schema.LAYERS[name]
    columns: dict[str, Sequence[Value | bytes | None]] = {"fid": rows.ids}
    types = ["fid INTEGER PRIMARY KEY NOT NULL"]
    extent: Sequence[float | None] = [None] * 4
    if layer.geometry is not None:
        shapes = _stored(np.array(rows.shapes, dtype=object), crs)
        columns["geom"] = blobs_of(shapes)
        types.append(f"geom {layer.geometry.upper()}")
        extent = shapely.total_bounds(shapes).tolist() if len(shapes) else extent
    for column, filler in layer.columns.items():
        columns[column] = rows.columns.get(column) or [filler] * len(rows.ids)
        types.append(f"{column} {_COLUMN_TYPES[type(filler)]}")
    tables.execute(f"CREATE TABLE {name} ({', '.join(types)})")
    places = ", ".join("?" * len(columns))
    tables.executemany(f"INSERT INTO {name} VALUES ({places})", sorted(zip(*columns.values(), strict=True), key=_fid))
    kind, system = ("features", SRS_ID) if layer.geometry else ("attributes", None)
    tables.execute(
        "INSERT INTO gpkg_contents VALUES (?, ?, ?, '', ?, ?, ?, ?, ?, ?)", (name, kind, name, _DAY, *extent, system)
    )
    if layer.geometry is not None:
        tables.execute(
            "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, 4326, 0, 0)", (name, layer.geometry.upper())
        )


def _fid(row: tuple[Any, ...]) -> int:
    return row[0]


def _stored(shapes: NDArray[np.object_], crs: str) -> NDArray[np.object_]:
    """Geometries as longitudes and latitudes."""
    xy: Floats = shapely.get_coordinates(shapes)
    if not len(xy):
        return shapes
    try:
        degrees = np.stack(transformer(crs, schema.STORED_CRS).transform(xy[:, 0], xy[:, 1]), axis=1)
    except ProjError as error:
        raise MapError(f"coordinates cannot be turned from {crs} to {schema.STORED_CRS}: {error}") from error
    if not np.isfinite(degrees).all():
        raise MapError(f"a coordinate lies outside the reach of {crs}")
    return shapely.set_coordinates(shapes, degrees)
