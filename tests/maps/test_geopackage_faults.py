"""Map files that cannot be used: one clear line each, whatever is wrong with them."""

from __future__ import annotations

import logging
import re
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from interplan_sumo.maps import tables
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.world.roads import Roads
from tests.maps.damaged import refusal, survive
from tests.maps.map_files import altered_copy, blob, edited, geometry_in, mutate
from tests.maps.road_worlds import GridPlan, grid_city
from tests.quick import few


@pytest.fixture(scope="module")
def city() -> Roads:
    return grid_city(GridPlan(columns=2, rows=2, lanes=1, spacing_m=50.0))


@pytest.fixture(scope="module")
def file(city: Roads, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "map.gpkg"
    write_map(city, path)
    return path


@pytest.fixture(scope="module")
def ids(city: Roads, file: Path) -> dict[str, str]:
    """One of each, to put into statements and messages."""
    lane = next(iter(city.lanes))
    with edited(file) as connection:
        (line,) = connection.execute(f"SELECT fid FROM baseline_paths WHERE lane_fid = {lane}").fetchone()
    return {
        "lane": lane,
        "other_lane": list(city.lanes)[1],
        "connector": next(iter(city.connectors)),
        "block": next(b.id for b in city.roadblocks.values() if not b.is_connector),
        "way": next(b.id for b in city.roadblocks.values() if b.is_connector),
        "line": str(line),
    }


def assert_refused(path: Path, message: str) -> None:
    said = refusal(path, read_map)
    assert re.fullmatch(message, said), said


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert refusal(tmp_path / "map.gpkg", read_map).startswith("no map file at FILE")
    assert refusal(tmp_path, read_map).startswith("no map file at FILE")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda _: b"", "FILE: the file is empty; copy or download it again"),
        (lambda _: b"<osm/>", "FILE: not a GeoPackage.*"),
        (lambda _: b"\x00" * 5000, "FILE: not a GeoPackage.*"),
        (lambda _: b"SQLite format 3", "FILE: not a GeoPackage.*"),
        (lambda content: content[: len(content) // 1000], r"FILE: the file is damaged \(.*"),
        (lambda content: content[: len(content) * 9 // 10], r"FILE: the file is damaged \(.*"),
        (lambda content: content[: len(content) * 9999 // 10000], r"FILE: the file is damaged \(.*"),
    ],
)
def test_a_damaged_or_foreign_file(damage: Callable[[bytes], bytes], message: str, file: Path, tmp_path: Path) -> None:
    (tmp_path / "map.gpkg").write_bytes(damage(file.read_bytes()))
    assert_refused(tmp_path / "map.gpkg", message)


def test_a_database_that_is_no_geopackage(tmp_path: Path) -> None:
    with edited(tmp_path / "map.gpkg") as connection:
        connection.execute("CREATE TABLE lanes (id INTEGER)")
    assert_refused(tmp_path / "map.gpkg", "FILE: not a GeoPackage that can be opened.*")


ENDLESS = (
    "WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n) SELECT k AS fid, 'a' AS key, 'b' AS value FROM n"
)
GEOMETRIES, SYSTEM = "gpkg_geometry_columns", "UPDATE meta SET value = '{}' WHERE key = 'projectedCoordSystem'"
NOT_A_TABLE = "is a view or a virtual table, expected a table"


def dropped(layer: str) -> str:
    return f"DROP TABLE {layer}; DELETE FROM gpkg_contents WHERE table_name = '{layer}'"


STATEMENTS = [
    # Layers and columns.
    (dropped("lanes_polygons"), "layer lanes_polygons is missing.*"),
    (dropped("road_segments"), "layer road_segments is missing.*"),
    (dropped("meta"), "layer meta is missing.*"),
    ("ALTER TABLE lanes_polygons DROP COLUMN lane_index", "layer lanes_polygons has no column lane_index"),
    ("ALTER TABLE lane_connectors DROP COLUMN speed_limit_mps", "layer lane_connectors has no column speed_limit_mps"),
    ("ALTER TABLE meta DROP COLUMN key", "layer meta has no column key"),
    (
        f"DELETE FROM {GEOMETRIES} WHERE table_name = 'lanes_polygons'",
        "layer lanes_polygons has no geometry column",
    ),
    (
        f"UPDATE {GEOMETRIES} SET column_name = 'lane_fid' WHERE table_name = 'lanes_polygons'",
        "layer lanes_polygons has no geometry column",
    ),
    # What holds for the whole map.
    (SYSTEM.format("epsg:999999"), "meta: projectedCoordSystem.*not a known system.*"),
    (SYSTEM.format("metres"), "meta: projectedCoordSystem.*not a known system.*"),
    (SYSTEM.format("epsg:4326"), "meta: projectedCoordSystem.*does not measure metres.*"),
    (SYSTEM.format("epsg:2263"), "meta: projectedCoordSystem.*does not measure metres.*"),
    ("DELETE FROM meta WHERE key = 'projectedCoordSystem'", ".*no key projectedCoordSystem.*"),
    (
        "UPDATE meta SET value = 'middle' WHERE key = 'drivingSide'",
        "meta: drivingSide is 'middle', expected left or right",
    ),
    # Rows.
    (
        "UPDATE lane_connectors SET entry_lane_fid = 99999 WHERE fid = {connector}",
        "lane_connectors {connector}: entry_lane_fid is lane 99999, which does not exist",
    ),
    (
        "UPDATE lane_connectors SET exit_lane_fid = NULL WHERE fid = {connector}",
        "lane_connectors {connector}: exit_lane_fid is empty",
    ),
    (
        "DELETE FROM gen_lane_connectors_scaled_width_polygons WHERE lane_connector_fid = {connector}",
        "lane_connectors {connector}: has no polygons in gen_lane_connectors_scaled_width_polygons, needs exactly one",
    ),
    (
        "UPDATE lane_connectors SET lane_group_connector_fid = {block} WHERE fid = {connector}",
        "lane_connectors {connector}: belongs to lane_group_connectors {block}, which does not exist",
    ),
    (
        "UPDATE lane_connectors SET traffic_light_stop_line_fids = '{lane}' WHERE fid = {connector}",
        "lane_connectors {connector}: names stop line '{lane}', which is not in stop_polygons",
    ),
    (
        "DELETE FROM baseline_paths WHERE lane_fid = {lane}",
        "lanes_polygons {lane}: has no baseline in baseline_paths, needs exactly one",
    ),
    (
        "UPDATE baseline_paths SET lane_fid = {lane} WHERE lane_fid = {other_lane}",
        r"lanes_polygons {lane}: has 2 baselines \(.*\) in baseline_paths, needs exactly one",
    ),
    (
        "UPDATE lanes_polygons SET lane_fid = {other_lane} WHERE fid = {lane}",
        "lanes_polygons {lane}: its lane_fid is {other_lane}; both must be the same",
    ),
    (
        "UPDATE lane_connectors SET fid = {lane} WHERE fid = {connector}",
        "lane_connectors {lane}: the id is taken by lanes_polygons {lane}",
    ),
    (
        "UPDATE lane_group_connectors SET fid = {block} WHERE fid = {way}",
        "lane_group_connectors {block}: the id is taken by lane_groups_polygons {block}",
    ),
    (
        "UPDATE lanes_polygons SET lane_group_fid = {way} WHERE fid = {lane}",
        "lanes_polygons {lane}: belongs to lane group {way}, which is not in lane_groups_polygons",
    ),
    (
        "UPDATE lane_group_connectors SET to_lane_group_fid = {way} WHERE fid = {way}",
        "lane_group_connectors {way}: to_lane_group_fid is lane group {way}, which does not exist",
    ),
    (
        "UPDATE lanes_polygons SET right_boundary_fid = 99999 WHERE fid = {lane}",
        "lanes_polygons {lane}: names boundary 99999, which does not exist",
    ),
    (
        "UPDATE baseline_paths SET lane_fid = 1.5 WHERE lane_fid = {lane}",
        r"baseline_paths \d+: lane_fid is 1.5, expected a whole number",
    ),
    (
        "UPDATE lanes_polygons SET speed_limit_mps = -3 WHERE fid = {lane}",
        "lanes_polygons {lane}: speed_limit_mps is -3",
    ),
    (
        "UPDATE intersections SET geom = NULL",
        r"intersections \d+: has no geometry",
    ),
    # What computes in place of a table, or to whom a row belongs.
    (f"DROP TABLE meta; CREATE VIEW meta AS {ENDLESS}", f"meta {NOT_A_TABLE}"),
    (f"DROP TABLE {GEOMETRIES}; CREATE VIEW {GEOMETRIES} AS SELECT 1", f"{GEOMETRIES} {NOT_A_TABLE}"),
    (
        "DROP TABLE lanes_polygons; CREATE VIRTUAL TABLE lanes_polygons USING rtree(fid, a, b)",
        f"lanes_polygons {NOT_A_TABLE}",
    ),
    (
        "DROP TABLE meta; CREATE TABLE meta (rowid TEXT, key TEXT, value TEXT)",
        "layer meta has a column rowid, which hides its ids",
    ),
    (
        "DROP TABLE meta; "
        "CREATE TABLE meta (fid INTEGER PRIMARY KEY, key TEXT, value TEXT AS (hex(zeroblob(100000000))))",
        "layer meta has no column value",
    ),
    # Rows that hold more than the file.
    (
        "INSERT INTO meta (key) SELECT 'x' FROM boundaries a, boundaries b LIMIT 3000; ALTER TABLE meta DROP COLUMN "
        f"value; ALTER TABLE meta ADD COLUMN value TEXT DEFAULT '{'x' * 40_000}'",
        r"layer meta cannot be read \(more comes out than the whole file holds\)",
    ),
]


@pytest.mark.parametrize(("statements", "message"), STATEMENTS, ids=[message[:60] for _, message in STATEMENTS])
def test_tables_and_rows_that_cannot_be_are_named(
    statements: str, message: str, file: Path, ids: dict[str, str], tmp_path: Path
) -> None:
    path = altered_copy(file, tmp_path / "map.gpkg", statements.format(**ids))
    assert_refused(path, "FILE: " + message.format(**ids))


def crossing_itself(geometry: shapely.Geometry) -> shapely.Geometry:
    ring = shapely.get_coordinates(shapely.minimum_rotated_rectangle(geometry))
    return shapely.Polygon(ring[[0, 1, 3, 2]])


def nested(kind: int) -> bytes:
    """Geometries within geometries, which GEOS follows until its stack runs over and the process is gone."""
    head = blob(shapely.Point())[:8]
    return head + struct.pack("<BII", 1, kind, 1) * 100_000 + shapely.to_wkb(shapely.Point(1, 2))


FAR = shapely.Polygon([(0.0, 0.0), (1e9, 0.0), (1e9, 1e9)])
GEOMETRY: list[tuple[str, str, Callable[[Any], Any], str]] = [
    ("lanes_polygons", "lane", crossing_itself, r"its polygon crosses itself \(Self-intersection\[.*"),
    ("lane_groups_polygons", "block", crossing_itself, r"its polygon crosses itself \(Self-intersection\[.*"),
    (
        "baseline_paths", "line", lambda line: shapely.LineString([line.coords[0]] * 2),
        r"a line without length \(a Polyline needs two distinct points\)",
    ),
    ("lanes_polygons", "lane", lambda _: shapely.Point(1.0, 2.0), "its geometry is a Point, expected one Polygon"),
    (
        "lanes_polygons", "lane", lambda one: shapely.MultiPolygon([one, shapely.transform(one, lambda xy: xy + 1e-3)]),
        "its geometry is a MultiPolygon, expected one Polygon",
    ),
    ("lanes_polygons", "lane", lambda _: FAR, "a vertex lies outside the reach of EPSG:32611"),
    ("lanes_polygons", "lane", lambda _: nested(6), r"its geometry is damaged \(of an unknown type, 6\)"),
    ("lanes_polygons", "lane", lambda _: nested(7), r"its geometry is damaged \(of an unknown type, 7\)"),
]  # fmt: skip


@pytest.mark.parametrize(("layer", "row", "change", "message"), GEOMETRY)
def test_a_geometry_that_cannot_be_is_named(
    layer: str, row: str, change: Callable[[Any], Any], message: str, file: Path, ids: dict[str, str], tmp_path: Path
) -> None:
    path = shutil.copyfile(file, tmp_path / "map.gpkg")
    with edited(path) as connection:
        found = change(geometry_in(connection, layer, int(ids[row])))
        content = found if isinstance(found, bytes) else blob(found)
        connection.execute(f'UPDATE "{layer}" SET geom = ? WHERE fid = ?', (content, int(ids[row])))
    assert_refused(path, f"FILE: {layer} {ids[row]}: {message}")


def test_checks_that_a_file_demands_of_its_rows_are_not_run(file: Path, tmp_path: Path) -> None:
    path = altered_copy(
        file,
        tmp_path / "map.gpkg",
        "DROP TABLE walkways; PRAGMA ignore_check_constraints = ON; CREATE TABLE walkways "
        "(fid INTEGER PRIMARY KEY, geom POLYGON, CHECK (length(hex(randomblob(300000000))) > 0))",
    )
    assert read_map(path).walkways == ()


def test_work_without_end_is_cut_off(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "_STEPS", 0)
    monkeypatch.setattr(tables, "_STEPS_PER_BYTE", 0)
    assert refusal(shutil.copyfile(file, tmp_path / "map.gpkg"), read_map).startswith(
        "FILE: the file is damaged (interrupted)"
    )


def assert_valid(roads: Roads) -> None:
    assert all(lane.polygon.is_valid for lane in (*roads.lanes.values(), *roads.connectors.values()))


@pytest.mark.parametrize("seeds", few([30, 200], 1, 1))
def test_damaged_files_are_read_or_refused_and_nothing_else(
    seeds: int, file: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def damage(path: Path, rng: np.random.Generator) -> str:
        return mutate(shutil.copyfile(file, path), rng)

    caplog.set_level(logging.CRITICAL)
    read, refused = survive(seeds, tmp_path / "map.gpkg", damage, [read_map], assert_valid)
    assert read > 0.1
    assert refused > 0.3
