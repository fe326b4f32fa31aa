"""Map files for tests, sound ones and ones that are changed by hand or at random."""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
from collections.abc import Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import Roads
from tests.maps.damaged import bytes_changed, cut

GOLDEN = Path(os.environ.get("INTERPLAN_GOLDEN", Path(__file__).parents[1] / "golden"))
GOLDEN_MAPS = GOLDEN / "nuplan_metrics" / "maps"


def assert_same_roads(one: Roads, other: Roads, tolerance_m: float = 1e-6) -> None:
    """Same ids, links, codes and limits; vertices no further apart than the tolerance."""
    assert (one.crs, one.driving_side) == (other.crs, other.driving_side)
    for layer in ("lanes", "connectors", "roadblocks", "stop_lines"):
        _assert_same(getattr(one, layer), getattr(other, layer), tolerance_m)
    for layer in ("intersections", "crosswalks", "walkways", "carparks", "road_segments", "generic_drivable_areas"):
        areas, twins = ({area.id: area for area in getattr(roads, layer)} for roads in (one, other))
        _assert_same(areas, twins, tolerance_m)


def _assert_same(things: Mapping[str, Any], twins: Mapping[str, Any], tolerance_m: float) -> None:
    assert things.keys() == twins.keys()
    for id_, thing in things.items():
        for name in (each.name for each in fields(thing)):
            mine, other = getattr(thing, name), getattr(twins[id_], name)
            if name == "lane_ids" and thing.is_connector:
                assert sorted(mine) == sorted(other)
            elif isinstance(mine, Polyline):
                assert _apart_m(mine.points, other.points) <= tolerance_m, (id_, name)
            elif isinstance(mine, shapely.Geometry):
                assert _apart_m(*map(shapely.get_coordinates, (mine, other))) <= tolerance_m, (id_, name)
            else:
                assert mine == other, (id_, name)


def _apart_m(one: Floats, other: Floats) -> float:
    return float(np.abs(one - other).max()) if one.shape == other.shape else float("inf")


@contextmanager
def edited(path: Path) -> Generator[sqlite3.Connection]:
    """The file's tables, changed for good."""
    connection = sqlite3.connect(path)
    try:
        with connection:
            yield connection
    finally:
        connection.close()


def altered_copy(source: Path, target: Path, statements: str) -> Path:
    """A copy of a map file after some SQL."""
    shutil.copyfile(source, target)
    with edited(target) as tables:
        tables.executescript(statements)
    return target


def blob(geometry: shapely.Geometry, srs_id: int = 4326) -> bytes:
    """A geometry as GeoPackage keeps it: magic, version, flags (little-endian, no envelope), system, WKB."""
    return b"GP\x00\x01" + struct.pack("<i", srs_id) + shapely.to_wkb(geometry, byte_order=1)


def geometry_in(tables: sqlite3.Connection, layer: str, row: int) -> Any:
    """The stored geometry of a row."""
    (content,) = tables.execute(f'SELECT geom FROM "{layer}" WHERE fid = ?', (row,)).fetchone()
    envelope = (0, 32, 48, 48, 64)[(content[3] >> 1) & 7]
    return shapely.from_wkb(content[8 + envelope :])


_VALUES = (
    None, 0, -1, 1, 7, 2**62, 1.5, 1e308, float("inf"), "", "x", "12,13", "ü" * 50, b"\xff\x00GP", "nan", "left", 3857,
    "epsg:4326", "epsg:999999", "EPSG:2263", "+proj=utm +zone=11", "\x00",
)  # fmt: skip
_STATEMENTS = (
    'DELETE FROM "{layer}" WHERE {rows}',
    *('UPDATE OR IGNORE "{layer}" SET "{column}" = ? WHERE {rows}',) * 3,
    'UPDATE OR IGNORE "{layer}" SET "{column}" = "{other}" WHERE {rows}',
    'DROP TABLE "{layer}"',
    'ALTER TABLE "{layer}" DROP COLUMN "{column}"',
    "UPDATE meta SET value = ? WHERE {rows}",
    "UPDATE gpkg_geometry_columns SET srs_id = ?",
    *("geometry",) * 2,
)


def mutate(path: Path, rng: np.random.Generator) -> str:
    """Damage a map file in one of many ways; says how."""
    if rng.random() < 0.25:
        path.write_bytes((bytes_changed, cut)[int(rng.integers(2))](path.read_bytes(), rng))
        return "bytes"
    with edited(path) as tables:
        layer = str(rng.choice([name for (name,) in tables.execute("SELECT table_name FROM gpkg_contents ORDER BY 1")]))
        column, other = rng.choice([row[1] for row in tables.execute(f'PRAGMA table_info("{layer}")')], 2)
        rows = f"fid % {int(rng.integers(1, 12))} = {int(rng.integers(0, 3))}"
        what = str(rng.choice(_STATEMENTS)).format(layer=layer, column=column, other=other, rows=rows)
        with suppress(sqlite3.Error):  # a key may be neither empty nor gone: the file stays sound
            if what == "geometry":
                query = f'SELECT fid, geom FROM "{layer}" WHERE length(geom) LIMIT 1'
                for row, content in tables.execute(query).fetchall():
                    bent = (bytes_changed, cut)[int(rng.random() < 0.3)](content, rng)
                    tables.execute(f'UPDATE "{layer}" SET geom = ? WHERE fid = ?', (bent, row))
            else:
                tables.execute(what, (_VALUES[int(rng.integers(len(_VALUES)))],) * what.count("?"))
    return f"{what} in {layer}"
