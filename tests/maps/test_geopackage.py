"""Map files in nuPlan's schema: what is read, what is written, and that both agree."""

from __future__ import annotations

import logging
import math
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any

import numpy as np
import pyproj
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.errors import MapError
from interplan_sumo.maps import schema
from interplan_sumo.maps.geopackage import MapSize, read_map, read_size
from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import DrivingSide, IntersectionKind, Roads, StopLineKind, Turn
from tests.maps.map_files import GOLDEN_MAPS, altered_copy, assert_same_roads, blob, edited, geometry_in
from tests.maps.road_worlds import GridPlan, grid_city

SMALL = GridPlan(columns=2, rows=2, lanes=2, spacing_m=60.0)
NO_SIDE = "DELETE FROM meta WHERE key = 'drivingSide'"
GOLDEN_FILES = sorted(GOLDEN_MAPS.glob("*/*/map.gpkg"))


@pytest.fixture(scope="module")
def city() -> Roads:
    return grid_city(SMALL)


@pytest.fixture(scope="module")
def file(city: Roads, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "grid" / "1.0" / "map.gpkg"
    write_map(city, path)
    return path


def golden(name: str) -> Path:
    return GOLDEN_MAPS / name / "1.0" / "map.gpkg"


@pytest.mark.parametrize("says_its_side", [True, False])
def test_the_size_of_a_map_is_known_without_reading_all_of_it(
    file: Path, city: Roads, tmp_path: Path, says_its_side: bool
) -> None:
    path = tmp_path / "map.gpkg"
    altered_copy(file, path, "" if says_its_side else NO_SIDE)
    assert read_size(path) == MapSize.of(read_map(path))
    assert read_size(path).lanes == len(city.lanes)


# --- what nuPlan's classes open ------------------------------------------------------------------


def test_a_golden_crossing_is_read_whole() -> None:
    roads = read_map(golden("gs-cross"))
    assert (roads.name, roads.crs, roads.driving_side) == ("gs-cross", "EPSG:32617", "right")
    assert (len(roads.lanes), len(roads.connectors), len(roads.stop_lines), len(roads.crosswalks)) == (16, 20, 4, 4)
    assert [len(block.lane_ids) for block in roads.roadblocks.values() if not block.is_connector] == [2] * 8
    lane, connector = roads.lanes["304"], roads.connectors["470"]
    assert (lane.roadblock_id, lane.index, lane.speed_limit_mps) == ("302", 0, 15.65)
    assert (connector.from_lane_id, connector.to_lane_id, connector.stop_line_ids) == ("304", "364", ("464",))
    assert (connector.turn, connector.speed_limit_mps) == (Turn.STRAIGHT, 5.0)
    assert roads.right_of("304") is roads.lanes["312"]
    assert roads.intersections[0].kind is IntersectionKind.TRAFFIC_LIGHT
    assert roads.stop_lines["464"].kind is StopLineKind.TRAFFIC_LIGHT
    # The polygon lies round the centre line, whose start is where pyproj alone puts it.
    assert lane.polygon.contains(shapely.Point(lane.centerline.pose_at(50.0).x_m, lane.centerline.pose_at(50.0).y_m))
    with sqlite3.connect(golden("gs-cross")) as tables:
        lon, lat = geometry_in(tables, "baseline_paths", 310).coords[0]
    expected = pyproj.Transformer.from_crs(4326, 32617, always_xy=True).transform(lon, lat)
    assert lane.centerline.points[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("path", GOLDEN_FILES, ids=lambda path: path.parent.parent.name)
def test_golden_maps_survive_writing_and_reading(path: Path, tmp_path: Path) -> None:
    roads = read_map(path)
    # Those with wider gaps between vertices get more of them; the line stays.
    fine = replace(
        roads,
        lanes={i: replace(x, centerline=_at_most_a_metre(x.centerline)) for i, x in roads.lanes.items()},
        connectors={i: replace(x, centerline=_at_most_a_metre(x.centerline)) for i, x in roads.connectors.items()},
    )
    write_map(roads, tmp_path / "out.gpkg")
    again = read_map(tmp_path / "out.gpkg")
    assert_same_roads(fine, again)
    assert roads.driving_side == ("left" if roads.name == "gs-merge-lht" else "right"), "no key says it"
    for id_, lane in (*roads.lanes.items(), *roads.connectors.items()):
        assert again[id_].centerline.length_m == pytest.approx(lane.centerline.length_m, abs=1e-5)
        assert np.diff(again[id_].centerline.arc_m).max() <= 1.0 + 2e-6


def _at_most_a_metre(line: Polyline) -> Polyline:
    return line.resampled(1.0 - 2e-6) if np.diff(line.arc_m).max() > 1.0 + 1e-6 else line


# --- writing -------------------------------------------------------------------------------------


@settings(max_examples=5)
@given(
    plan=st.builds(
        GridPlan,
        columns=st.integers(1, 2),
        rows=st.integers(2, 2),
        lanes=st.integers(1, 3),
        spacing_m=st.floats(45.0, 70.0),
        side=st.sampled_from(["left", "right"]),
        crs=st.sampled_from(["EPSG:32611", "EPSG:32648", "EPSG:32719", "EPSG:3414"]),
        origin_m=st.tuples(st.floats(2e4, 8e5), st.floats(3e4, 5e6)),
        rotation_rad=st.floats(-math.pi, math.pi),
        limits_mps=st.lists(st.none() | st.floats(0.0, 40.0), min_size=1, max_size=5).map(tuple),
        signals=st.booleans(),
        first_id=st.integers(1, 2**40),
    )
)
def test_any_city_survives_writing_and_reading(plan: GridPlan) -> None:
    if plan.crs == "EPSG:3414":  # Singapore's own grid covers the island only
        plan = replace(plan, origin_m=(plan.origin_m[0] % 4e4, plan.origin_m[1] % 4e4))
    roads = grid_city(plan)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "city.gpkg"
        write_map(roads, path)
        again = read_map(path)
        assert_same_roads(roads, again)
        before = path.read_bytes()
        write_map(again, path)
        assert path.read_bytes() == before


def test_the_bytes_do_not_depend_on_the_day_on_the_file_before_or_on_the_order_in_memory(
    city: Roads, file: Path, tmp_path: Path
) -> None:
    other = tmp_path / "deep" / "down" / "other.gpkg"
    turned: dict[str, Any] = {
        **{name: dict(list(getattr(city, name).items())[::-1]) for name in ("lanes", "connectors", "roadblocks")},
        **{name: getattr(city, name)[::-1] for name in ("intersections", "walkways")},
    }
    for roads in (city, replace(city, **turned)):
        write_map(roads, other)
        assert other.read_bytes() == file.read_bytes()
    assert [path.name for path in other.parent.iterdir()] == ["other.gpkg"]


def test_files_hold_every_layer_and_column_of_the_schema_and_so_do_the_golden_maps(file: Path) -> None:
    with sqlite3.connect(file) as tables, sqlite3.connect(golden("gs-cross")) as model:
        for name, layer in schema.LAYERS.items():
            columns = {row[1]: row[2] for row in tables.execute(f'PRAGMA table_info("{name}")')}
            assert set(columns) == {"fid", *layer.columns, *(("geom",) if layer.geometry else ())}
            assert set(columns) - {"geom"} == {r[1] for r in model.execute(f'PRAGMA table_info("{name}")')} - {"geom"}
            for column, filler in layer.columns.items():
                kind = {int: "INTEGER", float: "REAL", bool: "BOOLEAN", str: "TEXT"}[type(filler)]
                assert columns[column] == kind, (name, column)
        assert dict(tables.execute("SELECT key, value FROM meta")) == {
            "geographicCoordSystem": "epsg:4326",
            "projectedCoordSystem": "epsg:32611",
            "drivingSide": "right",
            "coordinateGridMetres": "1e-06",
        }


def test_written_files_obey_nuplans_rules(city: Roads, file: Path) -> None:
    with sqlite3.connect(file) as tables:

        def column(query: str) -> list[Any]:
            return [row[0] for row in tables.execute(query)]

        lanes, connectors = column("SELECT fid FROM lanes_polygons"), column("SELECT fid FROM lane_connectors")
        assert set(lanes).isdisjoint(connectors)
        assert column("SELECT lane_fid FROM lanes_polygons") == lanes
        assert sorted(column("SELECT lane_fid FROM baseline_paths WHERE lane_fid IS NOT NULL")) == lanes
        assert sorted(column("SELECT lane_connector_fid FROM baseline_paths WHERE lane_fid IS NULL")) == connectors
        assert set(column("SELECT traffic_light_stop_line_fids IS NULL FROM lane_connectors")) == {0}
        everything = [fid for name in schema.LAYERS if name != "meta" for fid in column(f'SELECT fid FROM "{name}"')]
        assert len(everything) == len(set(everything))
        # Lanes side by side name the same line between them.
        block = next(b for b in city.roadblocks.values() if not b.is_connector)
        left, right = (
            tables.execute(
                f"SELECT left_boundary_fid, right_boundary_fid FROM lanes_polygons WHERE fid = {lane}"
            ).fetchone()
            for lane in block.lane_ids
        )
        assert left[1] == right[0]
        segment = city.road_segments[0]
        (held,) = column(f"SELECT lane_group_fids FROM road_segments WHERE fid = {segment.id}")
        assert held == block.id
        for name, layer in schema.LAYERS.items():
            if layer.geometry is not None:
                assert column(f"SELECT srs_id FROM gpkg_geometry_columns WHERE table_name = '{name}'") == [4326]


def test_a_map_that_breaks_a_rule_or_cannot_be_drawn_is_not_written(city: Roads, tmp_path: Path) -> None:
    one, other = list(city.lanes.values())[:2]
    short = Polyline(one.left_boundary.points[0] + [[0.0, 0.0], [1e-7, 0.0]])
    endless = Polyline(np.concatenate((one.centerline.points, one.centerline.points[-1:] + 2.2e7)))
    broken: list[tuple[dict[str, Any], str]] = [
        (
            {"lanes": dict(city.lanes) | {other.id: replace(other, polygon=one.polygon)}},
            f"{one.id}: overlaps {other.id} by",
        ),
        (
            {"lanes": dict(city.lanes) | {one.id: replace(one, left_boundary=short)}},
            f"connector {one.id} cannot be written",
        ),
        (
            {"lanes": dict(city.lanes) | {one.id: replace(one, centerline=endless)}},
            f"connector {one.id} is 31113 km long, expected 100 at most",
        ),
        ({"crs": "EPSG:999999"}, "EPSG:999999"),
    ]
    for changes, said in broken:
        with pytest.raises(MapError, match=said):
            write_map(replace(city, **changes), tmp_path / "map.gpkg")
        assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_to_is_named(city: Roads, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(MapError, match=r"cannot write .*map\.gpkg: "):
        write_map(city, tmp_path / "file" / "map.gpkg")
    (tmp_path / "folder").mkdir()
    with pytest.raises(MapError, match=r"cannot write .*folder: "):
        write_map(city, tmp_path / "folder")


# --- what real files bring with them ---------------------------------------------------------------


def test_empty_values_are_taken_as_nuplan_takes_them(city: Roads, file: Path, tmp_path: Path) -> None:
    path = altered_copy(
        file,
        tmp_path / "map.gpkg",
        "UPDATE lanes_polygons SET speed_limit_mps = NULL, name = NULL;"
        "UPDATE lane_connectors SET traffic_light_stop_line_fids = NULL, turn_type_fid = NULL;"
        "UPDATE stop_polygons SET stop_polygon_type_fid = NULL;"
        "UPDATE intersections SET intersection_type_fid = 77;"
        "UPDATE lane_group_connectors SET intersection_fid = NULL",
    )
    roads = read_map(path)
    assert {lane.speed_limit_mps for lane in roads.lanes.values()} == {None}
    assert {c.stop_line_ids for c in roads.connectors.values()} == {()}
    assert {c.turn for c in roads.connectors.values()} == {Turn.UNKNOWN}
    assert {stop.kind for stop in roads.stop_lines.values()} == {StopLineKind.UNKNOWN}
    assert {area.kind for area in roads.intersections} == {IntersectionKind.DEFAULT}
    assert {block.intersection_id for block in roads.roadblocks.values()} == {None}
    assert roads.roadblocks.keys() == city.roadblocks.keys()


def test_ids_may_be_stored_as_reals_or_texts(city: Roads, file: Path, tmp_path: Path) -> None:
    path = altered_copy(
        file,
        tmp_path / "map.gpkg",
        "ALTER TABLE lanes_polygons RENAME COLUMN lane_group_fid TO old;"
        "ALTER TABLE lanes_polygons ADD COLUMN lane_group_fid REAL;"
        "UPDATE lanes_polygons SET lane_group_fid = old;"
        "ALTER TABLE baseline_paths RENAME COLUMN lane_fid TO old;"
        "ALTER TABLE baseline_paths ADD COLUMN lane_fid TEXT;"
        "UPDATE baseline_paths SET lane_fid = CAST(CAST(old AS INTEGER) AS TEXT)",
    )
    assert_same_roads(city, read_map(path))


def test_a_list_of_stop_lines_may_hold_spaces(city: Roads, file: Path, tmp_path: Path) -> None:
    connector = next(iter(city.connectors.values()))
    stops = list(city.stop_lines)[:2]
    statement = f"UPDATE lane_connectors SET traffic_light_stop_line_fids = ' {stops[0]}, {stops[1]},'"
    path = altered_copy(file, tmp_path / "map.gpkg", f"{statement} WHERE fid = {connector.id}")
    assert read_map(path).connectors[connector.id].stop_line_ids == tuple(stops)


def test_tables_that_only_their_own_queries_need_may_be_missing(file: Path, tmp_path: Path) -> None:
    drop = "DROP TABLE {0}; DELETE FROM gpkg_contents WHERE table_name = '{0}';"
    names = ("crosswalks", "walkways", "traffic_lights", "dubins_nodes")
    path = altered_copy(file, tmp_path / "map.gpkg", "".join(map(drop.format, names)))
    roads = read_map(path)
    assert roads.crosswalks == roads.walkways == ()
    assert roads.carparks


def reshaped(file: Path, folder: Path, change: Callable[[Any], Any], *layers: str, rows: str = "TRUE") -> Path:
    """A copy of a map file with other geometries in some rows of layers."""
    path = shutil.copyfile(file, folder / "map.gpkg")
    with edited(path) as tables:
        for layer in layers:
            for (row,) in tables.execute(f"SELECT fid FROM {layer} WHERE {rows}").fetchall():
                geometry = blob(change(geometry_in(tables, layer, row)))
                tables.execute(f"UPDATE {layer} SET geom = ? WHERE fid = ?", (geometry, row))
    return path


def test_coordinates_may_be_stored_in_metres(city: Roads, file: Path, tmp_path: Path) -> None:
    """A map whose layers are in the projected system already: exact, no longitudes in between."""
    project = pyproj.Transformer.from_crs(4326, city.crs, always_xy=True).transform
    drawn = [name for name, layer in schema.LAYERS.items() if layer.geometry]
    path = reshaped(file, tmp_path, lambda one: shapely.transform(one, lambda xy: np.stack(project(*xy.T), 1)), *drawn)
    system = "INSERT OR REPLACE INTO gpkg_spatial_ref_sys VALUES ('UTM', 32611, 'EPSG', 32611, 'undefined', '')"
    columns = "UPDATE gpkg_geometry_columns SET srs_id = 32611"
    assert_same_roads(city, read_map(altered_copy(path, tmp_path / "metres.gpkg", f"{system}; {columns}")))


def test_boundaries_run_with_the_traffic_whatever_the_file_says(city: Roads, file: Path, tmp_path: Path) -> None:
    assert_same_roads(city, read_map(reshaped(file, tmp_path, shapely.reverse, "boundaries", rows="fid % 2 = 0")))


def test_a_third_dimension_is_dropped(city: Roads, file: Path, tmp_path: Path) -> None:
    path = reshaped(file, tmp_path, lambda flat: shapely.force_3d(flat, 12.0), "lanes_polygons")
    assert_same_roads(city, read_map(path))


def test_a_small_fold_is_cut_off_with_a_line_in_the_log(
    city: Roads, file: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def folded(polygon: shapely.Polygon) -> shapely.Polygon:
        ring = np.array(polygon.exterior.coords)[:-1]
        ring = np.roll(ring, -int(np.hypot(*np.diff(ring, axis=0).T).argmax()), axis=0)
        ahead, aside = (ring[1] - ring[0]) / 30.0, (ring[-1] - ring[0]) / 10.0
        loop = ring[0] + np.array([5 * ahead, 5 * ahead + aside, 4 * ahead - aside, 6 * ahead])
        return shapely.Polygon(np.concatenate((ring[:1], loop, ring[1:])))

    lane = next(iter(city.lanes.values()))
    with caplog.at_level(logging.WARNING, logger="interplan_sumo"):
        roads = read_map(reshaped(file, tmp_path, folded, "lanes_polygons", rows=f"fid = {lane.id}"))
    assert f"lanes_polygons {lane.id}: cut off a fold" in caplog.text
    healed = roads.lanes[lane.id].polygon
    assert healed.is_valid
    assert healed.symmetric_difference(lane.polygon).area < 0.05 * lane.polygon.area


def test_an_area_of_several_parts_becomes_several_areas(city: Roads, file: Path, tmp_path: Path) -> None:
    lot = city.carparks[0]
    twice = reshaped(
        file, tmp_path, lambda here: shapely.MultiPolygon([here, shapely.transform(here, lambda xy: xy + 1e-3)]),
        "carpark_areas",
    )  # fmt: skip
    areas = read_map(twice).carparks
    assert [area.id for area in areas] == [lot.id, str(int(lot.id) + 1)]
    assert areas[1].polygon.area == pytest.approx(lot.polygon.area, rel=1e-3)


def test_lanes_are_ordered_from_left_to_right_by_their_index(city: Roads, file: Path, tmp_path: Path) -> None:
    block = next(b for b in city.roadblocks.values() if not b.is_connector)
    first, second = block.lane_ids
    move = f"UPDATE lanes_polygons SET lane_index = 3 WHERE fid = {first}"
    roads = read_map(altered_copy(file, tmp_path / "map.gpkg", move))
    assert roads.roadblocks[block.id].lane_ids == (second, first)
    assert roads.lanes[first].index == 3


# --- driving side ----------------------------------------------------------------------------------


def test_the_driving_side_that_is_written_down_counts(tmp_path: Path) -> None:
    write_map(grid_city(replace(SMALL, side="right")), tmp_path / "sg-somewhere.gpkg")
    assert read_map(tmp_path / "sg-somewhere.gpkg").driving_side == "right"


@pytest.mark.parametrize("side", ["left", "right"])
def test_without_a_word_the_roads_tell_the_driving_side(side: DrivingSide, tmp_path: Path) -> None:
    write_map(grid_city(replace(SMALL, side=side, rotation_rad=0.7)), tmp_path / "a.gpkg")
    path = altered_copy(tmp_path / "a.gpkg", tmp_path / "b.gpkg", NO_SIDE)
    assert read_map(path).driving_side == side
    assert read_map(path, name="sg-one-north").driving_side == "left"


def test_a_one_way_road_is_taken_for_right_hand_traffic(city: Roads, tmp_path: Path) -> None:
    block = next(b for b in city.roadblocks.values() if not b.is_connector)
    alone = replace(
        city,
        lanes={i: city.lanes[i] for i in block.lane_ids},
        connectors={},
        roadblocks={block.id: block},
        stop_lines=MappingProxyType({}),
    )
    write_map(alone, tmp_path / "a.gpkg")
    path = altered_copy(tmp_path / "a.gpkg", tmp_path / "b.gpkg", NO_SIDE)
    assert read_map(path).driving_side == "right"


# --- beside SUMO ------------------------------------------------------------------------------------


def test_libsumo_changes_nothing(file: Path, tmp_path: Path) -> None:
    """Importing libsumo points PROJ at SUMO's own data by environment variables."""
    code = (
        "import libsumo, os, sys\n"
        "assert 'PROJ_LIB' in os.environ or 'PROJ_DATA' in os.environ\n"
        "from pathlib import Path\n"
        "from interplan_sumo.maps.geopackage import read_map\n"
        "from interplan_sumo.maps.geopackage_writer import write_map\n"
        "write_map(read_map(Path(sys.argv[1])), Path(sys.argv[2]))\n"
    )
    copy = tmp_path / "map.gpkg"
    subprocess.run([sys.executable, "-c", code, str(file), str(copy)], check=True, timeout=120)
    assert copy.read_bytes() == file.read_bytes()
