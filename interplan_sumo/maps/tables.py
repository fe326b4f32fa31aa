"""The tables of one GeoPackage file as arrays; every fault is a MapError that names file, layer and id."""

from __future__ import annotations

import logging
import sqlite3
import warnings
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pyogrio
import pyproj
import shapely
from numpy.typing import NDArray
from pyogrio.raw import read
from pyproj.exceptions import CRSError, ProjError

from interplan_sumo.errors import MapError
from interplan_sumo.maps import schema
from interplan_sumo.world.geometry import Floats, Ints

Objects = NDArray[np.object_]

_SQLITE_MAGIC = b"SQLite format 3\x00"
_MAX_ID = 2**53
"""Ids travel through columns of doubles in nuPlan's files: beyond this they would not stay apart."""
_MAX_FOLD = 0.05
"""Share of a polygon's area that a fold may have and still be cut off."""
_TYPE_IDS: dict[schema.Geometry, int] = {"Point": 0, "LineString": 1, "Polygon": 3}
_FIRST_COLLECTION = 4
_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class LayerTable:
    """One layer: ids, columns and geometries, row by row."""

    path: Path
    layer: str
    ids: tuple[str, ...]
    columns: dict[str, NDArray[Any]]
    geometries: Objects
    """(N,) shapely geometries in the projected system; empty for a table read without geometry."""

    def __len__(self) -> int:
        return len(self.ids)

    def fault(self, row: int, what: str) -> NoReturn:
        """MapError about one row."""
        raise MapError(f"{self.path}: {self.layer} {self.ids[row]}: {what}")

    def numbers(self, column: str) -> Floats:
        """(N,) the column as floats, NaN where empty; texts that are numbers count (nuPlan converts them too)."""
        values = self.columns[column]
        if values.dtype.kind in "iufb":
            return values.astype(np.float64)
        numbers = np.full(len(values), np.nan)
        for row, value in enumerate(values):
            if value is not None and value != "":
                try:
                    numbers[row] = float(value)
                except (TypeError, ValueError):
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
        if values.dtype.kind == "f":
            return ["" if np.isnan(v) else f"{v:.0f}" for v in values.tolist()]
        return ["" if v is None or v != v else str(v) for v in values.tolist()]


class GeoPackage:
    """An open map file: checks that it is one, knows its layers and reads them one at a time.

    Geometries come out in the projected system that the file's own `meta` table names.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        _check_file(path)
        try:
            with _quiet_gdal():
                self.layers = frozenset(str(name) for name in pyogrio.list_layers(path)[:, 0])
        except Exception as error:
            raise MapError(f"{path}: not a GeoPackage that can be opened ({_brief(error)})") from error
        meta = self.read(schema.META)
        self.meta = dict(zip(meta.texts("key"), meta.texts("value"), strict=True))
        if schema.PROJECTED_CRS_KEY not in self.meta:
            raise MapError(f"{path}: {schema.META}: no key {schema.PROJECTED_CRS_KEY}, so nobody knows its metres")
        self.crs = _crs_name(self.meta[schema.PROJECTED_CRS_KEY])
        try:
            projected = pyproj.CRS.from_user_input(self.crs)
        except CRSError as error:
            raise MapError(
                f"{path}: {schema.META}: {schema.PROJECTED_CRS_KEY} is {self.crs[:60]!r}, not a known system"
            ) from error
        if not projected.is_projected or any(axis.unit_name != "metre" for axis in projected.axis_info[:2]):
            raise MapError(f"{path}: {schema.META}: {schema.PROJECTED_CRS_KEY} {self.crs[:60]} does not measure metres")
        self.grid_m = _grid(self.meta.get(schema.GRID_KEY, ""))

    def read(self, layer: str, *, geometry: bool = True) -> LayerTable:
        """One layer; an absent optional layer is an empty table, an absent required one a MapError."""
        wanted = schema.LAYERS[layer]
        geometry = geometry and wanted.geometry is not None
        if layer not in self.layers:
            if wanted.required:
                raise MapError(f"{self.path}: layer {layer} is missing; nuPlan's maps have it even when it is empty")
            return LayerTable(self.path, layer, (), {}, np.zeros(0, dtype=object))
        try:
            with _quiet_gdal():
                info, fids, wkb, values = read(
                    self.path,
                    layer=layer,
                    columns=[*wanted.needed, *wanted.helpful],
                    read_geometry=geometry,
                    force_2d=True,
                    return_fids=True,
                )
        except Exception as error:
            raise MapError(f"{self.path}: layer {layer} cannot be read ({_brief(error)})") from error
        columns = dict(zip((str(name) for name in info["fields"]), values, strict=True))
        for column in wanted.needed:
            if column not in columns:
                raise MapError(f"{self.path}: layer {layer} has no column {column}")
        ids = tuple(map(str, fids.tolist()))
        table = LayerTable(self.path, layer, ids, columns, np.zeros(0, dtype=object))
        if not geometry:
            return table
        if wkb is None:
            raise MapError(f"{self.path}: layer {layer} has no geometry column")
        shapes = _decoded(table, wkb)
        if wanted.areas:
            ids, rows, shapes = _split(table, shapes)
            table = LayerTable(self.path, layer, ids, {name: column[rows] for name, column in columns.items()}, shapes)
        shapes = self._projected(table, _single(table, shapes, wanted.geometry or "Polygon"), info["crs"])
        if wanted.geometry == "Polygon":
            shapes = _sound(table, shapes)
        return LayerTable(self.path, layer, ids, table.columns, shapes)

    def _projected(self, table: LayerTable, shapes: Objects, stored_crs: str | None) -> Objects:
        coordinates = shapely.get_coordinates(shapes)
        if not len(coordinates):
            return shapes
        if stored_crs is None:
            raise MapError(f"{self.path}: layer {table.layer} names no coordinate system")
        try:
            transformer = _transformer(stored_crs, self.crs)
        except ProjError as error:
            raise MapError(
                f"{self.path}: layer {table.layer} cannot be projected to {self.crs} ({_brief(error)})"
            ) from error
        xy = np.stack(transformer.transform(coordinates[:, 0], coordinates[:, 1]), axis=1)
        if self.grid_m:
            xy = snapped(xy, self.grid_m)
        bad = ~np.isfinite(xy).all(axis=1)
        if bad.any():
            owner = np.repeat(np.arange(len(shapes)), shapely.get_num_coordinates(shapes))
            table.fault(int(owner[np.argmax(bad)]), f"a vertex lies outside the reach of {self.crs}")
        return shapely.set_coordinates(shapes, xy)


@contextmanager
def _quiet_gdal() -> Generator[None]:
    """Without GDAL's warnings: what matters in them is checked here and becomes a MapError."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def snapped(xy: Floats, grid_m: float) -> Floats:
    """Coordinates moved to the nearest multiple of `grid_m`, an inverse power of ten."""
    per_metre = np.round(1.0 / grid_m)
    return np.round(xy * per_metre) / per_metre


@lru_cache(maxsize=16)
def _transformer(stored_crs: str, projected_crs: str) -> pyproj.Transformer:
    return pyproj.Transformer.from_crs(stored_crs, projected_crs, always_xy=True)


def transformer_to_stored(projected_crs: str) -> pyproj.Transformer:
    """From the projected system to the longitudes and latitudes that map files hold."""
    return _transformer(projected_crs, schema.STORED_CRS)


def _decoded(table: LayerTable, wkb: NDArray[Any]) -> Objects:
    """Row by row the geometry; MapError for one that is absent, empty or damaged."""
    try:
        shapes = np.asarray(shapely.from_wkb(wkb), dtype=object)
    except Exception:
        for row, item in enumerate(wkb):
            try:
                shapely.from_wkb(item)
            except Exception as error:
                table.fault(row, f"its geometry is damaged ({_brief(error)})")
        raise
    empty = shapely.is_missing(shapes) | shapely.is_empty(shapes)
    if empty.any():
        table.fault(int(np.argmax(empty)), "has no geometry")
    return shapes


def _split(table: LayerTable, shapes: Objects) -> tuple[tuple[str, ...], Ints, Objects]:
    """Ids, rows and geometries with one row per part; further parts get ids above all others."""
    parts, rows = shapely.get_parts(shapes, return_index=True)
    ids = [table.ids[row] for row in rows]
    free = max(map(int, table.ids), default=0) + 1
    for place in range(1, len(rows)):
        if rows[place] == rows[place - 1]:
            ids[place] = str(free)
            free += 1
    return tuple(ids), rows, parts


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


def _check_file(path: Path) -> None:
    """That the file is there and a sound SQLite file: GDAL would read half of a torn one without a word."""
    if not path.is_file():
        raise MapError(f"no map file at {path}; `interplan-sumo maps list` shows the maps that are there")
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            header = file.read(100)
    except OSError as error:
        raise MapError(f"{path}: cannot be read ({error.strerror})") from error
    if size == 0:
        raise MapError(f"{path}: the file is empty; copy or download it again")
    if not header.startswith(_SQLITE_MAGIC):
        raise MapError(f"{path}: not a GeoPackage (it does not begin as an SQLite file does)")
    page = int.from_bytes(header[16:18], "big")  # 1 stands for 65,536
    if len(header) < 100 or size % (65536 if page == 1 else max(page, 512)):
        raise MapError(f"{path}: the file is damaged (cut off at {size} bytes); copy or download it again")
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    try:
        verdict = connection.execute("PRAGMA quick_check(1)").fetchone()
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise MapError(f"{path}: the file is damaged ({_brief(error)}); copy or download it again") from error
    finally:
        connection.close()
    if verdict != ("ok",):
        problem = " ".join(str(verdict and verdict[0]).split())
        raise MapError(f"{path}: the file is damaged ({problem[:120]}); copy or download it again")


def _crs_name(text: str) -> str:
    """ "EPSG:32611" for "epsg:32611", any other definition as it is."""
    text = text.strip()
    return text.upper() if text.lower().startswith("epsg:") else text


def _grid(text: str) -> float:
    try:
        grid_m = float(text)
    except ValueError:
        return 0.0
    return grid_m if 1e-9 <= grid_m <= 1e-3 else 0.0


def _brief(error: BaseException) -> str:
    """The first 160 characters of an error's text, on one line."""
    return " ".join((str(error) or type(error).__name__).split())[:160]
