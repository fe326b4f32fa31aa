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


def mutate(path: Path, rng: np.random.Generator) -> str:
    """Damage a map file in one of many ways; says how."""
    return _MUTATIONS[int(rng.integers(len(_MUTATIONS)))](path, rng)


def _flip_bytes(path: Path, rng: np.random.Generator) -> str:
    content = np.frombuffer(path.read_bytes(), dtype=np.uint8).copy()
    places = rng.integers(len(content), size=int(rng.integers(1, 40)))
    content[places] ^= rng.integers(1, 256, size=len(places), dtype=np.uint8)
    path.write_bytes(content.tobytes())
    return f"bytes {places.tolist()} flipped"


def _truncate(path: Path, rng: np.random.Generator) -> str:
    size = int(rng.integers(path.stat().st_size))
    os.truncate(path, size)
    return f"truncated to {size} bytes"


def _overwrite(path: Path, rng: np.random.Generator) -> str:
    content = bytearray(path.read_bytes())
    start, length = int(rng.integers(len(content))), int(rng.integers(1, 9000))
    content[start : start + length] = rng.bytes(len(content[start : start + length]))
    path.write_bytes(content)
    return f"{length} bytes of noise at {start}"


def _layer(tables: sqlite3.Connection, rng: np.random.Generator) -> str:
    names = [name for (name,) in tables.execute("SELECT table_name FROM gpkg_contents ORDER BY 1")]
    return str(rng.choice(names))


def _column(tables: sqlite3.Connection, layer: str, rng: np.random.Generator) -> str:
    return str(rng.choice([row[1] for row in tables.execute(f'PRAGMA table_info("{layer}")')]))


def _some_rows(rng: np.random.Generator) -> str:
    return f"fid % {int(rng.integers(1, 12))} = {int(rng.integers(0, 3))}"


def _delete_rows(path: Path, rng: np.random.Generator) -> str:
    with edited(path) as tables:
        statement = f'DELETE FROM "{_layer(tables, rng)}" WHERE {_some_rows(rng)}'
        tables.execute(statement)
    return statement


def _change_values(path: Path, rng: np.random.Generator) -> str:
    with edited(path) as tables:
        layer = _layer(tables, rng)
        column = _column(tables, layer, rng)
        pool = (None, 0, -1, 1, 7, 2**62, 1.5, 1e308, float("inf"), "", "x", "12,13", "ü" * 50, b"\xff\x00GP", "nan")
        value = pool[int(rng.integers(len(pool)))]
        statement = f'UPDATE OR IGNORE "{layer}" SET "{column}" = ? WHERE {_some_rows(rng)}'
        with suppress(sqlite3.IntegrityError):  # a key may not be empty: the file stays sound
            tables.execute(statement, (value,))
    return f"{statement} with {value!r}"


def _swap_values(path: Path, rng: np.random.Generator) -> str:
    with edited(path) as tables:
        layer = _layer(tables, rng)
        one, other = _column(tables, layer, rng), _column(tables, layer, rng)
        statement = f'UPDATE OR IGNORE "{layer}" SET "{one}" = "{other}" WHERE {_some_rows(rng)}'
        with suppress(sqlite3.IntegrityError):
            tables.execute(statement)
    return statement


def _drop(path: Path, rng: np.random.Generator) -> str:
    with edited(path) as tables:
        layer = _layer(tables, rng)
        if rng.random() < 0.5:
            statement = f'DROP TABLE "{layer}"'
        else:
            names = [row[1] for row in tables.execute(f'PRAGMA table_info("{layer}")')][1:]
            statement = f'ALTER TABLE "{layer}" DROP COLUMN "{rng.choice(names)}"'
        tables.execute(statement)
    return statement


def _bend_geometry(path: Path, rng: np.random.Generator) -> str:
    with edited(path) as tables:
        layer = _layer(tables, rng)
        rows = tables.execute(f'SELECT fid, geom FROM "{layer}"').fetchall() if layer != "meta" else []
        if not rows:
            return "nothing"
        row, content = rows[int(rng.integers(len(rows)))]
        damaged = bytearray(content)
        if rng.random() < 0.3:
            del damaged[int(rng.integers(len(damaged))) :]
        else:
            for place in rng.integers(len(damaged), size=int(rng.integers(1, 4))):
                damaged[place] ^= int(rng.integers(1, 256))
        tables.execute(f'UPDATE "{layer}" SET geom = ? WHERE fid = ?', (bytes(damaged), row))
    return f"geometry of {layer} {row} bent"


def _change_meta(path: Path, rng: np.random.Generator) -> str:
    pool = ("", "epsg:4326", "epsg:999999", "EPSG:2263", "+proj=utm +zone=11", "left", "1e-6", "\x00", "epsg:32748")
    with edited(path) as tables:
        statement = f"UPDATE meta SET value = {str(rng.choice(pool))!r} WHERE {_some_rows(rng)}"
        tables.execute(statement)
        if rng.random() < 0.3:
            tables.execute(f"UPDATE gpkg_geometry_columns SET srs_id = {int(rng.choice((0, -1, 3857)))}")
    return statement


_MUTATIONS = (
    _flip_bytes, _truncate, _overwrite, _delete_rows, _change_values, _change_values, _swap_values, _drop,
    _bend_geometry, _bend_geometry, _change_meta,
)  # fmt: skip
