"""Map files that cannot be used: one clear line each, whatever is wrong with them."""

from __future__ import annotations

import logging
import re
import shutil
import struct
import time
from pathlib import Path

import numpy as np
import pytest
import shapely

from interplan_sumo.errors import MapError
from interplan_sumo.maps import schema, tables
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.world.roads import Roads
from tests.maps.map_files import altered_copy, blob, edited, geometry_in, mutate
from tests.maps.road_worlds import GridPlan, grid_city

SMALL = GridPlan(columns=2, rows=2, lanes=1, spacing_m=50.0)


@pytest.fixture(scope="module")
def city() -> Roads:
    return grid_city(SMALL)


@pytest.fixture(scope="module")
def file(city: Roads, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "map.gpkg"
    write_map(city, path)
    return path


@pytest.fixture(scope="module")
def ids(city: Roads) -> dict[str, str]:
    """One of each, to put into statements and messages."""
    return {
        "lane": next(iter(city.lanes)),
        "other_lane": list(city.lanes)[1],
        "connector": next(iter(city.connectors)),
        "block": next(b.id for b in city.roadblocks.values() if not b.is_connector),
        "way": next(b.id for b in city.roadblocks.values() if b.is_connector),
        "stop": next(iter(city.stop_lines)),
    }


def refusal(path: Path) -> str:
    """The one line that reading ends in, without the path."""
    with pytest.raises(MapError) as caught:
        read_map(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    return message.replace(str(path), "FILE")


# --- files -----------------------------------------------------------------------------------------


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert refusal(tmp_path / "map.gpkg").startswith("no map file at FILE")
    assert refusal(tmp_path).startswith("no map file at FILE")


def test_an_empty_file(tmp_path: Path) -> None:
    (tmp_path / "map.gpkg").touch()
    assert refusal(tmp_path / "map.gpkg") == "FILE: the file is empty; copy or download it again"


@pytest.mark.parametrize("content", [b"<osm/>", b"\x00" * 5000, b"SQLite format 3"])
def test_a_file_of_another_kind(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "map.gpkg").write_bytes(content)
    assert refusal(tmp_path / "map.gpkg").startswith("FILE: not a GeoPackage")


@pytest.mark.parametrize("share", [0.001, 0.9, 0.9999])
def test_a_truncated_file(share: float, file: Path, tmp_path: Path) -> None:
    content = file.read_bytes()
    (tmp_path / "map.gpkg").write_bytes(content[: int(len(content) * share)])
    assert refusal(tmp_path / "map.gpkg").startswith("FILE: the file is damaged (")


def test_a_database_that_is_no_geopackage(tmp_path: Path) -> None:
    with edited(tmp_path / "map.gpkg") as connection:
        connection.execute("CREATE TABLE lanes (id INTEGER)")
    assert refusal(tmp_path / "map.gpkg").startswith("FILE: not a GeoPackage that can be opened")


@pytest.mark.parametrize("layer", [schema.LANES, schema.ROAD_SEGMENTS, schema.META])
def test_a_missing_layer(layer: str, file: Path, tmp_path: Path) -> None:
    path = altered_copy(
        file,
        tmp_path / "map.gpkg",
        f"DROP TABLE {layer}",
        f"DELETE FROM gpkg_contents WHERE table_name = '{layer}'",
    )
    assert refusal(path).startswith(f"FILE: layer {layer} is missing")


@pytest.mark.parametrize(
    ("layer", "column"), [(schema.LANES, "lane_index"), (schema.CONNECTORS, "speed_limit_mps"), (schema.META, "key")]
)
def test_a_missing_column(layer: str, column: str, file: Path, tmp_path: Path) -> None:
    path = altered_copy(file, tmp_path / "map.gpkg", f'ALTER TABLE {layer} DROP COLUMN "{column}"')
    assert refusal(path) == f"FILE: layer {layer} has no column {column}"


@pytest.mark.parametrize(
    "statement", ["DELETE FROM gpkg_geometry_columns", "UPDATE gpkg_geometry_columns SET column_name = 'lane_fid'"]
)
def test_a_layer_without_geometry(statement: str, file: Path, tmp_path: Path) -> None:
    path = altered_copy(file, tmp_path / "map.gpkg", f"{statement} WHERE table_name = 'lanes_polygons'")
    assert refusal(path) == "FILE: layer lanes_polygons has no geometry column"


# --- the coordinate system ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("epsg:999999", "not a known system"),
        ("metres", "not a known system"),
        ("epsg:4326", "does not measure metres"),
        ("epsg:2263", "does not measure metres"),
    ],
)
def test_a_projected_system_that_is_none(value: str, reason: str, file: Path, tmp_path: Path) -> None:
    path = altered_copy(
        file,
        tmp_path / "map.gpkg",
        "UPDATE meta SET value = ? WHERE key = 'projectedCoordSystem'",
        values=(value,),
    )
    message = refusal(path)
    assert message.startswith("FILE: meta: projectedCoordSystem")
    assert reason in message


def test_no_projected_system(file: Path, tmp_path: Path) -> None:
    path = altered_copy(file, tmp_path / "map.gpkg", "DELETE FROM meta WHERE key = 'projectedCoordSystem'")
    assert "no key projectedCoordSystem" in refusal(path)


def test_a_driving_side_that_is_none(file: Path, tmp_path: Path) -> None:
    path = altered_copy(file, tmp_path / "map.gpkg", "UPDATE meta SET value = 'middle' WHERE key = 'drivingSide'")
    assert refusal(path) == "FILE: meta: drivingSide is 'middle', expected left or right"


# --- rows --------------------------------------------------------------------------------------------

ROWS = {
    "connector to nowhere": (
        "UPDATE lane_connectors SET entry_lane_fid = 99999 WHERE fid = {connector}",
        "FILE: lane_connectors {connector}: entry_lane_fid is lane 99999, which does not exist",
    ),
    "connector without an end": (
        "UPDATE lane_connectors SET exit_lane_fid = NULL WHERE fid = {connector}",
        "FILE: lane_connectors {connector}: exit_lane_fid is empty",
    ),
    "connector without a polygon": (
        "DELETE FROM gen_lane_connectors_scaled_width_polygons WHERE lane_connector_fid = {connector}",
        "FILE: lane_connectors {connector}: has no polygons in gen_lane_connectors_scaled_width_polygons, "
        "needs exactly one",
    ),
    "connector in no group": (
        "UPDATE lane_connectors SET lane_group_connector_fid = {block} WHERE fid = {connector}",
        "FILE: lane_connectors {connector}: belongs to lane_group_connectors {block}, which does not exist",
    ),
    "unknown stop line": (
        "UPDATE lane_connectors SET traffic_light_stop_line_fids = '{lane}' WHERE fid = {connector}",
        "FILE: lane_connectors {connector}: names stop line '{lane}', which is not in stop_polygons",
    ),
    "no baseline": (
        "DELETE FROM baseline_paths WHERE lane_fid = {lane}",
        "FILE: lanes_polygons {lane}: has no baseline in baseline_paths, needs exactly one",
    ),
    "two baselines": (
        "UPDATE baseline_paths SET lane_fid = {lane} WHERE lane_fid = {other_lane}",
        "FILE: lanes_polygons {lane}: has 2 baselines \\(.*\\) in baseline_paths, needs exactly one",
    ),
    "id of another lane": (
        "UPDATE lanes_polygons SET lane_fid = {other_lane} WHERE fid = {lane}",
        "FILE: lanes_polygons {lane}: its lane_fid is {other_lane}; both must be the same",
    ),
    "id taken by a connector": (
        "UPDATE lane_connectors SET fid = {lane} WHERE fid = {connector}",
        "FILE: lane_connectors {lane}: the id is taken by lanes_polygons {lane}",
    ),
    "id taken by a roadblock": (
        "UPDATE lane_group_connectors SET fid = {block} WHERE fid = {way}",
        "FILE: lane_group_connectors {block}: the id is taken by lane_groups_polygons {block}",
    ),
    "lane without a group": (
        "UPDATE lanes_polygons SET lane_group_fid = {way} WHERE fid = {lane}",
        "FILE: lanes_polygons {lane}: belongs to lane group {way}, which is not in lane_groups_polygons",
    ),
    "group that leads nowhere": (
        "UPDATE lane_group_connectors SET to_lane_group_fid = {way} WHERE fid = {way}",
        "FILE: lane_group_connectors {way}: to_lane_group_fid is lane group {way}, which does not exist",
    ),
    "unknown boundary": (
        "UPDATE lanes_polygons SET right_boundary_fid = 99999 WHERE fid = {lane}",
        "FILE: lanes_polygons {lane}: names boundary 99999, which does not exist",
    ),
    "half an id": (
        "UPDATE baseline_paths SET lane_fid = 1.5 WHERE lane_fid = {lane}",
        "FILE: baseline_paths \\d+: lane_fid is 1.5, expected a whole number",
    ),
    "negative limit": (
        "UPDATE lanes_polygons SET speed_limit_mps = -3 WHERE fid = {lane}",
        "FILE: lanes_polygons {lane}: speed_limit_mps is -3",
    ),
    "no geometry": (
        "UPDATE intersections SET geom = NULL",
        "FILE: intersections \\d+: has no geometry",
    ),
}


@pytest.mark.parametrize("name", ROWS)
def test_rows_that_cannot_be_are_named(name: str, file: Path, ids: dict[str, str], tmp_path: Path) -> None:
    statement, message = (text.format(**ids) for text in ROWS[name])
    path = altered_copy(file, tmp_path / "map.gpkg", statement)
    assert re.fullmatch(message, refusal(path)), refusal(path)


# --- geometries --------------------------------------------------------------------------------------


def with_geometry(file: Path, folder: Path, layer: str, row: str, geometry: shapely.Geometry | bytes) -> Path:
    path = shutil.copyfile(file, folder / "map.gpkg")
    with edited(path) as connection:
        content = geometry if isinstance(geometry, bytes) else blob(geometry)
        connection.execute(f'UPDATE "{layer}" SET geom = ? WHERE fid = ?', (content, int(row)))
    return path


@pytest.mark.parametrize("layer", [schema.LANES, schema.ROADBLOCKS])
def test_a_polygon_that_crosses_itself(layer: str, file: Path, ids: dict[str, str], tmp_path: Path) -> None:
    row = ids["lane"] if layer == schema.LANES else ids["block"]
    with edited(file) as connection:
        ring = shapely.get_coordinates(shapely.minimum_rotated_rectangle(geometry_in(connection, layer, int(row))))
    bow_tie = shapely.Polygon(ring[[0, 1, 3, 2]])
    message = refusal(with_geometry(file, tmp_path, layer, row, bow_tie))
    assert message.startswith(f"FILE: {layer} {row}: its polygon crosses itself (Self-intersection[")


def test_a_baseline_without_length(file: Path, ids: dict[str, str], tmp_path: Path) -> None:
    with edited(file) as connection:
        (row,) = connection.execute(f"SELECT fid FROM baseline_paths WHERE lane_fid = {ids['lane']}").fetchone()
        at = geometry_in(connection, "baseline_paths", row).coords[0]
    message = refusal(with_geometry(file, tmp_path, "baseline_paths", str(row), shapely.LineString([at, at])))
    assert message == f"FILE: baseline_paths {row}: a line without length (a Polyline needs two distinct points)"


def test_a_geometry_of_another_type(file: Path, ids: dict[str, str], tmp_path: Path) -> None:
    path = with_geometry(file, tmp_path, schema.LANES, ids["lane"], shapely.Point(1.0, 2.0))
    assert refusal(path) == f"FILE: lanes_polygons {ids['lane']}: its geometry is a Point, expected one Polygon"


def test_a_lane_in_two_parts(file: Path, ids: dict[str, str], tmp_path: Path) -> None:
    with edited(file) as connection:
        one = geometry_in(connection, schema.LANES, int(ids["lane"]))
    both = shapely.MultiPolygon([one, shapely.transform(one, lambda xy: xy + 1e-3)])
    path = with_geometry(file, tmp_path, schema.LANES, ids["lane"], both)
    assert refusal(path) == f"FILE: lanes_polygons {ids['lane']}: its geometry is a MultiPolygon, expected one Polygon"


def test_a_vertex_beyond_the_world(file: Path, ids: dict[str, str], tmp_path: Path) -> None:
    far = shapely.Polygon([(0.0, 0.0), (1e9, 0.0), (1e9, 1e9)])
    message = refusal(with_geometry(file, tmp_path, schema.LANES, ids["lane"], far))
    assert message == f"FILE: lanes_polygons {ids['lane']}: a vertex lies outside the reach of EPSG:32611"


def test_geometries_within_geometries_never_reach_geos(file: Path, ids: dict[str, str], tmp_path: Path) -> None:
    """GEOS follows them until its stack runs over and the process is gone."""
    for kind in (6, 7):
        nested = (
            blob(shapely.Point())[:8] + struct.pack("<BII", 1, kind, 1) * 100_000 + shapely.to_wkb(shapely.Point(1, 2))
        )
        message = refusal(with_geometry(file, tmp_path, schema.LANES, ids["lane"], nested))
        assert message == f"FILE: lanes_polygons {ids['lane']}: its geometry is damaged (of an unknown type, {kind})"


# --- files made to do harm ---------------------------------------------------------------------------

ENDLESS = (
    "WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n) SELECT k AS fid, 'a' AS key, 'b' AS value FROM n"
)


@pytest.mark.parametrize(
    ("table", "statement", "message"),
    [
        ("meta", f"CREATE VIEW meta AS {ENDLESS}", "FILE: meta is a view or a virtual table, expected a table"),
        (
            "gpkg_geometry_columns",
            "CREATE VIEW gpkg_geometry_columns AS SELECT 1",
            "FILE: gpkg_geometry_columns is a view or a virtual table, expected a table",
        ),
        (
            "lanes_polygons",
            "CREATE VIRTUAL TABLE lanes_polygons USING rtree(fid, a, b)",
            "FILE: lanes_polygons is a view or a virtual table, expected a table",
        ),
        (
            "meta",
            "CREATE TABLE meta (rowid TEXT, key TEXT, value TEXT)",
            "FILE: layer meta has a column rowid, which hides its ids",
        ),
        (
            "meta",
            "CREATE TABLE meta (fid INTEGER PRIMARY KEY, key TEXT, value TEXT AS (hex(zeroblob(100000000))))",
            "FILE: layer meta has no column value",
        ),
    ],
)
def test_what_computes_in_place_of_a_table_is_refused(
    table: str, statement: str, message: str, file: Path, tmp_path: Path
) -> None:
    assert refusal(altered_copy(file, tmp_path / "map.gpkg", f"DROP TABLE {table}", statement)) == message


def test_checks_that_a_file_demands_of_its_rows_are_not_run(file: Path, tmp_path: Path) -> None:
    endless = "CHECK (length(hex(randomblob(300000000))) > 0)"
    path = altered_copy(
        file,
        tmp_path / "map.gpkg",
        "DROP TABLE walkways",
        "PRAGMA ignore_check_constraints = ON",
        f"CREATE TABLE walkways (fid INTEGER PRIMARY KEY, geom POLYGON, {endless})",
    )
    assert read_map(path).walkways == ()


def test_rows_that_hold_more_than_the_file_are_refused(file: Path, tmp_path: Path) -> None:
    path = altered_copy(
        file,
        tmp_path / "map.gpkg",
        "INSERT INTO meta (key) SELECT 'x' FROM boundaries a, boundaries b LIMIT 3000",
        "ALTER TABLE meta DROP COLUMN value",
        f"ALTER TABLE meta ADD COLUMN value TEXT DEFAULT '{'x' * 40_000}'",
    )
    assert refusal(path) == "FILE: layer meta cannot be read (more comes out than the whole file holds)"


def test_work_without_end_is_cut_off(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "_STEPS", 0)
    monkeypatch.setattr(tables, "_STEPS_PER_BYTE", 0)
    assert refusal(shutil.copyfile(file, tmp_path / "map.gpkg")).startswith("FILE: the file is damaged (interrupted)")


# --- anything at all ---------------------------------------------------------------------------------


def survive(seeds: range, file: Path, folder: Path) -> tuple[int, int]:
    """How many damaged files were read and how many refused; anything else raises."""
    read = refused = 0
    for seed in seeds:
        path = shutil.copyfile(file, folder / "map.gpkg")
        how = f"seed {seed}: {mutate(path, np.random.default_rng(seed))}"
        start = time.monotonic()
        try:
            found: Roads | MapError = read_map(path)
        except MapError as error:
            found = error
        except Exception as error:
            raise AssertionError(f"{how}: {error!r}") from error
        assert time.monotonic() - start < 10.0, how
        if isinstance(found, Roads):
            read += 1
            assert all(lane.polygon.is_valid for lane in (*found.lanes.values(), *found.connectors.values())), how
        else:
            refused += 1
            assert "\n" not in str(found), how
    return read, refused


def test_damaged_files_are_read_or_refused_and_nothing_else(
    file: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.CRITICAL)
    read, refused = survive(range(30), file, tmp_path)
    assert read > 3
    assert refused > 9


@pytest.mark.slow
def test_five_hundred_damaged_files(file: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL)
    read, refused = survive(range(1000, 1500), file, tmp_path)
    assert read > 60
    assert refused > 150
