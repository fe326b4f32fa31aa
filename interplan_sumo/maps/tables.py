"""The tables of one GeoPackage file, read with SQLite alone; every fault is a MapError that names file, layer and id.

A map file is foreign input: it is opened read-only, checked as a whole first, and nothing in it is run. Views, virtual
tables and computed columns in place of stored ones are refused, since they may cost any amount of time and memory.
"""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pyproj
import shapely
from numpy.typing import NDArray
from pyproj.exceptions import CRSError, ProjError

from interplan_sumo.errors import MapError
from interplan_sumo.maps import schema
from interplan_sumo.maps.geometry_blobs import BlobError, wkb_of
from interplan_sumo.world.geometry import Floats, Ints

Objects = NDArray[np.object_]

_SQLITE_MAGIC = b"SQLite format 3\x00"
_MAX_ID = 2**53
"""Ids travel through columns of doubles in nuPlan's files: beyond this they would not stay apart."""
_MAX_FOLD = 0.05
"""Share of a polygon's area that a fold may have and still be cut off."""
_TYPE_IDS: dict[schema.Geometry, int] = {"Point": 0, "LineString": 1, "Polygon": 3}
_FIRST_COLLECTION = 4
_STEPS, _STEPS_PER_BYTE = 10_000_000, 2
"""Instructions that SQLite may spend on a file; sound ones need a hundredth per byte."""
_MAX_DEFINITION_CHARS = 50_000
"""Of one table; a default value stands in it once and in every row that is read."""
_ROWS_AT_ONCE = 500
_SQLITE_ERRORS = (sqlite3.Error, UnicodeDecodeError)  # the message of an error may quote bytes of a damaged file
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class LayerTable:
    """One layer: ids, columns and geometries, row by row."""

    path: Path
    layer: str
    ids: tuple[str, ...]
    columns: dict[str, tuple[Any, ...]]
    """What SQLite holds: None, int, float, str or bytes, whatever the type of the column says."""
    geometries: Objects
    """(N,) shapely geometries in the projected system; empty for a table read without geometry."""

    def __len__(self) -> int:
        return len(self.ids)

    def fault(self, row: int, what: str) -> NoReturn:
        """MapError about one row."""
        raise MapError(f"{self.path}: {self.layer} {self.ids[row]}: {what}")

    def numbers(self, column: str) -> Floats:
        """(N,) the column as floats, NaN where empty; texts that are numbers count (nuPlan converts them too)."""
        numbers = np.full(len(self), np.nan)
        for row, value in enumerate(self.columns[column]):
            if value is not None and value != "":
                try:
                    numbers[row] = float(value)
                except ValueError:
                    self.fault(row, f"{column} is {str(value)[:40]!r}, expected a number")
        return numbers

    def codes(self, column: str, default: int) -> Ints:
        """(N,) the column as integers, `default` where it is empty, broken or absent."""
        if column not in self.columns:
            return np.full(len(self), default, dtype=np.int64)
        numbers = self.numbers(column)
        usable = np.abs(numbers) < _MAX_ID
        return np.where(usable, np.where(usable, numbers, 0.0), default).astype(np.int64)

    def references(self, column: str) -> list[str | None]:
        """(N,) ids that the column holds, None where it is empty."""
        numbers = self.numbers(column)
        empty = np.isnan(numbers)
        bad = ~empty & ~((np.abs(numbers) < _MAX_ID) & (numbers == np.round(numbers)))
        if bad.any():
            row = int(np.argmax(bad))
            self.fault(row, f"{column} is {numbers[row]}, expected a whole number")
        whole = np.where(empty, 0.0, numbers).astype(np.int64).tolist()
        return [None if none else str(value) for value, none in zip(whole, empty.tolist(), strict=True)]

    def ids_in(self, column: str) -> list[str]:
        """(N,) ids that the column holds; MapError where it is empty."""
        found = self.references(column)
        for row, value in enumerate(found):
            if value is None:
                self.fault(row, f"{column} is empty")
        return [value for value in found if value is not None]

    def texts(self, column: str) -> list[str]:
        """(N,) the column as texts, '' where it is empty; whole numbers lose their decimal point."""
        values = self.columns[column]
        return ["" if v is None else f"{v:.0f}" if isinstance(v, float) else str(v) for v in values]


class GeoPackage:
    """An open map file: checks that it is one, knows its layers and reads them one at a time.

    Geometries come out in the projected system that the file's own `meta` table names.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._size = self._left_bytes = _checked_size(path)
        self._connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
        try:
            self._tables = self._checked_tables()
            self._geometry_columns = self._read_geometry_columns()
            self._read_meta()
        except BaseException:
            self._connection.close()
            raise

    def __enter__(self) -> GeoPackage:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def read(self, layer: str, *, geometry: bool = True) -> LayerTable:
        """One layer; an absent optional layer is an empty table, an absent required one a MapError."""
        wanted = schema.LAYERS[layer]
        if layer not in self._tables:
            if wanted.required:
                raise MapError(f"{self.path}: layer {layer} is missing; nuPlan's maps have it even when it is empty")
            return LayerTable(self.path, layer, (), {}, np.zeros(0, dtype=object))
        stored = self._stored_columns(layer)
        names = [*wanted.needed, *(name for name in wanted.helpful if name in stored)]
        geometry_column, stored_crs = self._geometry_columns.get(layer, ("", None))
        if geometry and wanted.geometry is not None:
            if geometry_column not in stored or geometry_column in names:
                raise MapError(f"{self.path}: layer {layer} has no geometry column")
            names.append(geometry_column)
        rows = self._rows(layer, names)
        ids, *values = zip(*rows, strict=True) if rows else [()] * (1 + len(names))
        table = LayerTable(
            self.path, layer, tuple(map(str, ids)), dict(zip(names, values, strict=True)), np.zeros(0, dtype=object)
        )
        if not geometry or wanted.geometry is None:
            return table
        shapes = _decoded(table, table.columns.pop(geometry_column))
        if wanted.areas:
            table, shapes = _split(table, shapes)
        shapes = self._projected(table, _single(table, shapes, wanted.geometry), stored_crs)
        if wanted.geometry == "Polygon":
            shapes = _sound(table, shapes)
        return LayerTable(self.path, layer, table.ids, table.columns, shapes)

    def _checked_tables(self) -> dict[str, str]:
        """The names of all tables and views with what made them, once the whole file was found sound."""
        connection, damage = self._connection, "the file is damaged"
        connection.text_factory = partial(str, encoding="utf-8", errors="replace")
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(self._size, 1_000_000))
        connection.setlimit(sqlite3.SQLITE_LIMIT_SQL_LENGTH, _MAX_DEFINITION_CHARS)
        left = iter(range((_STEPS + self._size * _STEPS_PER_BYTE) // 1_000))
        connection.set_progress_handler(lambda: next(left, None) is None, 1_000)
        for pragma in ("trusted_schema = OFF", "cell_size_check = ON", "ignore_check_constraints = ON"):
            connection.execute(f"PRAGMA {pragma}")
        ((verdict,),) = self._query("PRAGMA quick_check(1)", damage)
        ((size,),) = self._query(
            "SELECT page_size * page_count FROM pragma_page_size, pragma_page_count", "the file is damaged"
        )
        problem = verdict if verdict != "ok" else "cut off" if size != self._size else ""
        if problem:
            raise MapError(f"{self.path}: {damage} ({_brief(problem)}); copy or download it again")
        tables = self._query(
            "SELECT name, sql FROM sqlite_master WHERE type IN ('table', 'view')", "the file is damaged"
        )
        return {str(name): str(sql) for name, sql in tables}

    def _read_geometry_columns(self) -> dict[str, tuple[str, str | None]]:
        """By layer the column of its geometries and the system of their coordinates, None where it names none."""
        systems: dict[Any, str | None] = {
            id_: f"EPSG:{number}" if str(organization).upper() == "EPSG" else str(definition)
            for _, id_, organization, number, definition in self._rows(
                "gpkg_spatial_ref_sys", ("srs_id", "organization", "organization_coordsys_id", "definition")
            )
        }
        columns = self._rows("gpkg_geometry_columns", ("table_name", "column_name", "srs_id"))
        return {
            str(layer): (str(column), systems.get(id_) if id_ not in (0, -1) else None)
            for _, layer, column, id_ in columns
        }

    def _read_meta(self) -> None:
        table = self.read(schema.META)
        self.meta = dict(zip(table.texts("key"), table.texts("value"), strict=True))
        key = schema.PROJECTED_CRS_KEY
        if key not in self.meta:
            raise MapError(f"{self.path}: {schema.META}: no key {key}, so nobody knows its metres")
        name = self.meta[key].strip()
        self.crs = name.upper() if name.lower().startswith("epsg:") else name
        try:
            projected = pyproj.CRS.from_user_input(self.crs)
        except CRSError as error:
            raise MapError(f"{self.path}: {schema.META}: {key} is {self.crs[:60]!r}, not a known system") from error
        if not projected.is_projected or any(axis.unit_name != "metre" for axis in projected.axis_info[:2]):
            raise MapError(f"{self.path}: {schema.META}: {key} {self.crs[:60]} does not measure metres")
        self.grid_m = _grid(self.meta.get(schema.GRID_KEY, ""))

    def _stored_columns(self, table: str) -> frozenset[str]:
        """The columns of a table that hold what they say; MapError for what is no plain table."""
        if table not in self._tables:
            raise MapError(f"{self.path}: not a GeoPackage that can be opened (it has no table {table})")
        if not self._tables[table].upper().startswith("CREATE TABLE"):
            raise MapError(f"{self.path}: {table} is a view or a virtual table, expected a table")
        columns = self._query(f'PRAGMA table_xinfo("{table}")', f"layer {table} cannot be read")
        return frozenset(str(name) for _, name, _, _, _, _, hidden in columns if not hidden)

    def _rows(self, table: str, columns: Sequence[str]) -> list[tuple[Any, ...]]:
        """The row id and some columns of all rows; MapError if one is missing."""
        stored = self._stored_columns(table)
        for column in columns:
            if column not in stored:
                raise MapError(f"{self.path}: layer {table} has no column {column}")
        if "rowid" in map(str.lower, stored):
            raise MapError(f"{self.path}: layer {table} has a column rowid, which hides its ids")
        quoted = "".join(', "{}"'.format(column.replace('"', '""')) for column in columns)
        return self._query(f'SELECT rowid{quoted} FROM "{table}" ORDER BY rowid', f"layer {table} cannot be read")

    def _query(self, statement: str, trouble: str) -> list[tuple[Any, ...]]:
        """All that SQLite answers; MapError for its errors, and for more than the file holds."""
        rows: list[tuple[Any, ...]] = []
        try:
            cursor = self._connection.execute(statement)
            while some := cursor.fetchmany(_ROWS_AT_ONCE):
                rows += some
                self._left_bytes -= sum(len(value) for row in some for value in row if isinstance(value, str | bytes))
                if self._left_bytes < 0:
                    raise MapError(f"{self.path}: {trouble} (more comes out than the whole file holds)")
        except _SQLITE_ERRORS as error:
            raise MapError(f"{self.path}: {trouble} ({_brief(error)}); copy or download it again") from error
        return rows

    def _projected(self, table: LayerTable, shapes: Objects, stored_crs: str | None) -> Objects:
        coordinates = shapely.get_coordinates(shapes)
        if not len(coordinates):
            return shapes
        if stored_crs is None:
            raise MapError(f"{self.path}: layer {table.layer} names no coordinate system")
        try:
            xy = np.stack(transformer(stored_crs, self.crs).transform(*coordinates.T), axis=1)
        except ProjError as error:
            raise MapError(f"{self.path}: layer {table.layer} cannot be projected to {self.crs}: {error}") from error
        if self.grid_m:
            xy = snapped(xy, self.grid_m)
        bad = ~np.isfinite(xy).all(axis=1)
        if bad.any():
            owner = np.repeat(np.arange(len(shapes)), shapely.get_num_coordinates(shapes))
            table.fault(int(owner[np.argmax(bad)]), f"a vertex lies outside the reach of {self.crs}")
        return shapely.set_coordinates(shapes, xy)


def snapped(xy: Floats, grid_m: float) -> Floats:
    """Coordinates moved to the nearest multiple of `grid_m`, an inverse power of ten."""
    per_metre = np.round(1.0 / grid_m)
    return np.round(xy * per_metre) / per_metre


@lru_cache(maxsize=16)
def transformer(one: str, other: str) -> pyproj.Transformer:
    """From one system to another, east before north."""
    return pyproj.Transformer.from_crs(one, other, always_xy=True)


def _decoded(table: LayerTable, blobs: Sequence[Any]) -> Objects:
    """Row by row the geometry, without a third dimension; MapError for one that is absent, empty or damaged."""
    wkb: list[bytes] = []
    for row, blob in enumerate(blobs):
        if blob is None:
            table.fault(row, "has no geometry")
        try:
            wkb.append(wkb_of(blob))
        except BlobError as error:
            table.fault(row, f"its geometry is damaged ({_brief(error)})")
    shapes = np.asarray(shapely.force_2d(shapely.from_wkb(wkb, on_invalid="ignore")), dtype=object)
    for row in np.flatnonzero(shapely.is_missing(shapes)).tolist():
        table.fault(row, "its geometry is damaged")
    for row in np.flatnonzero(shapely.is_empty(shapes)).tolist():
        table.fault(row, "has no geometry")
    return shapes


def _split(table: LayerTable, shapes: Objects) -> tuple[LayerTable, Objects]:
    """Ids and geometries with one row per part; further parts get ids above all others. Such layers have no columns."""
    parts, rows = shapely.get_parts(shapes, return_index=True)
    ids = [table.ids[row] for row in rows]
    free = max(map(int, table.ids), default=0) + 1
    for place in range(1, len(rows)):
        if rows[place] == rows[place - 1]:
            ids[place] = str(free)
            free += 1
    return LayerTable(table.path, table.layer, tuple(ids), {}, parts), parts


def _single(table: LayerTable, shapes: Objects, geometry: schema.Geometry) -> Objects:
    """Row by row one geometry of the layer's type: collections of one part are unwrapped."""
    lone = (shapely.get_type_id(shapes) >= _FIRST_COLLECTION) & (shapely.get_num_geometries(shapes) == 1)
    shapes = np.where(lone, shapely.get_geometry(shapes, 0), shapes)
    wrong = shapely.get_type_id(shapes) != _TYPE_IDS[geometry]
    if wrong.any():
        row = int(np.argmax(wrong))
        table.fault(row, f"its geometry is a {shapes[row].geom_type}, expected one {geometry}")
    return shapes


def _sound(table: LayerTable, polygons: Objects) -> Objects:
    """Polygons without self-intersections.

    Published maps hold a few polygons with a small fold, which nuPlan's classes
    accept: it is cut off, with a line in the log. A polygon that falls apart
    without its fold is a MapError: what lies inside would be anybody's guess.
    """
    bad = np.flatnonzero(~shapely.is_valid(polygons)).tolist()
    if not bad:
        return polygons
    polygons = polygons.copy()
    for row in bad:
        reason = shapely.is_valid_reason(polygons[row])
        parts = shapely.get_parts(shapely.make_valid(polygons[row], method="structure", keep_collapsed=False))
        area = shapely.area(parts)
        largest = int(np.argmax(area)) if len(parts) else 0
        total = float(area.sum())
        if not total or area[largest] < (1.0 - _MAX_FOLD) * total or parts[largest].geom_type != "Polygon":
            table.fault(row, f"its polygon crosses itself ({reason}); draw it anew")
        share = 1.0 - area[largest] / total
        _log.warning(
            "%s: %s %s: cut off a fold of %.1f %% (%s)", table.path, table.layer, table.ids[row], 100 * share, reason
        )
        polygons[row] = parts[largest]
    return polygons


def _checked_size(path: Path) -> int:
    """The size of a file that is there and begins as SQLite's do."""
    if not path.is_file():
        raise MapError(f"no map file at {path}; `interplan-sumo maps list` shows the maps that are there")
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            start = file.read(len(_SQLITE_MAGIC))
    except OSError as error:
        raise MapError(f"{path}: cannot be read ({error.strerror})") from error
    if size == 0:
        raise MapError(f"{path}: the file is empty; copy or download it again")
    if start != _SQLITE_MAGIC:
        raise MapError(f"{path}: not a GeoPackage (it does not begin as an SQLite file does)")
    return size


def _grid(text: str) -> float:
    try:
        grid_m = float(text)
    except ValueError:
        return 0.0
    return grid_m if 1e-9 <= grid_m <= 1e-3 else 0.0


def _brief(error: object) -> str:
    """The first 160 characters of an error's text, on one line."""
    return " ".join((str(error) or type(error).__name__).split())[:160]
