"""Argoverse 2 maps: what becomes of their lanes, links, neighbours and surfaces."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pyproj
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from interplan_sumo.errors import MapError, UnknownNameError
from interplan_sumo.maps.importers.argoverse2.count import count_argoverse2
from interplan_sumo.maps.importers.argoverse2.reader import BRIDGE_M, MAX_NEIGHBOUR_GAP_M, read_argoverse2
from interplan_sumo.maps.importers.source import SourceLane, SourceMap
from interplan_sumo.world.argoverse_frame import CITIES, city_frame
from interplan_sumo.world.frame import UNPLACED_CRS, UNPLACED_ORIGIN_M
from interplan_sumo.world.geometry import Floats
from tests.maps.argoverse_files import lane, line, straight, street, tile, written
from tests.maps.source_worlds import assert_as_counted
from tests.realdata import real


def read(content: dict[str, Any], folder: Path) -> SourceMap:
    return read_argoverse2(written(content, folder))


def local(points: Floats) -> Floats:
    """In the coordinates of the file again."""
    return points - city_frame("PIT")[1]


def outline(one: SourceLane) -> shapely.Polygon:
    return shapely.Polygon(np.concatenate((one.left, one.right[::-1])))


def noted(source: SourceMap, words: str) -> str:
    """The one note with these words, '' if there is none."""
    found = [note for note in source.notes if words in note]
    assert len(found) < 2
    return "".join(found)


# --- lanes -----------------------------------------------------------------------------------------


def test_lanes_for_cars_are_kept_with_their_boundaries(tmp_path: Path) -> None:
    source = read(street(), tmp_path)
    assert list(source.lanes) == ["1", "2", "3", "4"]
    assert_allclose(local(source.lanes["1"].left), [(0.0, 0.0), (40.0, 0.0)], atol=1e-6)
    assert_allclose(local(source.lanes["1"].right), [(0.0, -3.0), (40.0, -3.0)], atol=1e-6)
    assert [one.in_intersection for one in source.lanes.values()] == [False, False, False, True]
    assert source.driving_side == "right"
    assert noted(source, "no speed limits, traffic lights or signs")
    assert all(one.speed_limit_mps is None and not one.lights_at_end for one in source.lanes.values())


def test_lanes_of_other_types_are_left_out_with_reason_and_surface(tmp_path: Path) -> None:
    content = tile(
        straight(1, 0.0, 40.0, 0.0),
        straight(2, 0.0, 40.0, -3.0, lane_type="BIKE"),
        straight(3, 0.0, 40.0, -6.0, lane_type="BUS"),
        straight(4, 0.0, 40.0, -9.0, lane_type="TRAM"),
    )
    source = read(content, tmp_path)
    assert source.reasons == {"bicycle lane": 1, "bus lane": 1, "lane of type TRAM": 1}
    assert [item.polygon.area for item in source.left_out if item.polygon] == pytest.approx([120.0] * 3)
    assert count_argoverse2(tmp_path).left_out == 3


@pytest.mark.parametrize(
    ("turned", "note"),
    [
        (("left_lane_boundary",), "was turned"),
        (("right_lane_boundary",), "was turned"),
        ((), "exchanged"),
    ],
)
def test_boundaries_against_each_other_or_exchanged_are_put_right(
    turned: tuple[str, ...], note: str, tmp_path: Path
) -> None:
    """Left of left and right: the lane that went east still does, whichever of its boundaries was drawn west."""
    content = tile(straight(1, 0.0, 40.0, 0.0) if turned else lane(1, [(0, -3), (40, -3)], [(0, 0), (40, 0)]))
    for side in turned:
        content["lane_segments"]["1"][side].reverse()
    source = read(content, tmp_path)
    assert_allclose(local(source.lanes["1"].left), [(0.0, 0.0), (40.0, 0.0)], atol=1e-6)
    assert_allclose(local(source.lanes["1"].right), [(0.0, -3.0), (40.0, -3.0)], atol=1e-6)
    assert noted(source, note).endswith(": 1.")


@settings(max_examples=30)
@given(turn=st.floats(-3.1, 3.1), bend=st.floats(-2.5, 2.5), length_m=st.floats(0.5, 200.0))
def test_left_stays_left_on_lanes_of_any_direction_and_bend(
    turn: float, bend: float, length_m: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    heading = turn + np.linspace(0.0, bend, 12)
    middle = np.cumsum(np.stack((np.cos(heading), np.sin(heading)), axis=1), axis=0) * (10.0 + length_m) / 12
    aside = np.stack((-np.sin(heading), np.cos(heading)), axis=1) * 1.5
    left, right = (middle + aside).tolist(), (middle - aside).tolist()
    one = read(tile(lane(1, left, right)), tmp_path_factory.mktemp("map")).lanes["1"]
    assert_allclose(local(one.left), left, atol=1e-6)
    assert_allclose(local(one.right), right, atol=1e-6)


# --- links -----------------------------------------------------------------------------------------


def test_links_are_known_to_both_ends_and_kept_beyond_the_file_but_not_to_what_is_left_out(tmp_path: Path) -> None:
    source = read(street(), tmp_path)
    assert source.lanes["4"].predecessors == ("1",)
    assert noted(source, "only one of the two lanes names").endswith(": 1.")
    assert (source.lanes["2"].successors, source.lanes["2"].predecessors) == (("900",), ("901",))
    assert source.lanes["4"].successors == ()
    assert noted(source, "left out, not kept").endswith(": 1.")


# --- neighbours ------------------------------------------------------------------------------------


def test_neighbours_for_cars_of_the_same_direction_are_kept_on_both_sides_and_no_others(tmp_path: Path) -> None:
    source = read(street(), tmp_path)
    sides = {id_: (one.left_neighbour, one.right_neighbour) for id_, one in source.lanes.items()}
    assert sides == {"1": (None, "2"), "2": ("1", None), "3": (None, None), "4": (None, None)}
    assert noted(source, "neighbours").endswith(": 1.")


@pytest.mark.parametrize(
    ("points", "kept"),
    [
        ([(0, -3 - MAX_NEIGHBOUR_GAP_M + 0.01), (40, -3)], True),
        ([(0, -3 - MAX_NEIGHBOUR_GAP_M - 0.01), (40, -3)], False),
        ([(0, -3), (40, -3 - MAX_NEIGHBOUR_GAP_M - 0.01)], False),
        ([(0, -3), (20, -3 - MAX_NEIGHBOUR_GAP_M + 0.01), (40, -3)], True),
        ([(0, -3), (20, -3 - MAX_NEIGHBOUR_GAP_M - 0.01), (40, -3)], False),
        ([(0, -3), (39, -3)], False),
    ],
)
def test_neighbours_adjoin_from_end_to_end_and_it_is_enough_that_one_names_the_other(
    points: list[tuple[float, float]], kept: bool, tmp_path: Path
) -> None:
    content = tile(straight(1, 0.0, 40.0, 0.0), lane(2, points, [(0, -7), (40, -7)], left_neighbor_id=1))
    source = read(content, tmp_path)
    assert (source.lanes["1"].right_neighbour == "2") is kept
    assert (source.lanes["2"].left_neighbour == "1") is kept
    assert bool(noted(source, "neighbours")) is not kept


def test_a_lane_has_one_neighbour_a_side_even_if_two_claim_to_be_it(tmp_path: Path) -> None:
    content = tile(
        straight(1, 0.0, 40.0, 0.0, right_neighbor_id=2),
        straight(2, 0.0, 40.0, -3.0, left_neighbor_id=1),
        straight(3, 0.0, 40.0, -3.2, left_neighbor_id=1),
    )
    source = read(content, tmp_path)
    assert source.lanes["1"].right_neighbour == "2"
    assert source.lanes["3"].left_neighbour is None


# --- heights and surfaces --------------------------------------------------------------------------


@pytest.mark.parametrize(("height_m", "bridge"), [(BRIDGE_M - 0.1, False), (BRIDGE_M + 0.1, True)])
def test_lanes_that_cross_at_different_heights_are_noted(height_m: float, bridge: bool, tmp_path: Path) -> None:
    """The upper lane climbs: what counts is its height at the crossing, half way."""
    rise = 2.0 * height_m
    above = lane(2, [(17.0, -20.0), (17.0, 20.0, rise)], [(20.0, -20.0), (20.0, 20.0, rise)])
    source = read(tile(straight(1, 0.0, 40.0, 1.5), above), tmp_path)
    assert noted(source, "different heights").endswith(": 1." if bridge else "")
    assert bool(noted(source, "different heights")) is bridge


ODD = "pedestrian crossings that cross themselves"


@pytest.mark.parametrize(
    ("edges", "area_m2", "note"),
    [
        (((30, -6), (30, 3), (33, -6), (33, 3)), 27.0, ""),
        (((30, -6), (30, 3), (33, 3), (33, -6)), 27.0, ""),  # one edge runs the other way
        (((0, 0), (4, 4), (0, 4), (4, 0)), 16.0, ""),  # edges that cross
        (((0, 0), (4, 4), (1, 1), (5, 5)), None, ODD),  # no surface
    ],
)
def test_a_crossing_is_a_sound_surface_however_its_edges_lie(
    edges: tuple[tuple[float, float], ...], area_m2: float | None, note: str, tmp_path: Path
) -> None:
    content = street()
    content["pedestrian_crossings"]["7"] |= {"edge1": line(*edges[:2]), "edge2": line(*edges[2:])}
    source = read(content, tmp_path)
    assert [found.area for found in source.crosswalks] == ([] if area_m2 is None else [pytest.approx(area_m2)])
    assert all(found.is_valid for found in source.crosswalks)
    assert noted(source, ODD).endswith(": 1." if note else "")
    assert bool(noted(source, ODD)) == bool(note)


def test_drivable_areas_are_surfaces(tmp_path: Path) -> None:
    source = read(street(), tmp_path)
    (area,) = source.drivable
    assert area.area == pytest.approx(62.0 * 14.0)
    assert all(area.covers(outline(one)) for one in source.lanes.values())


def test_a_drivable_area_that_crosses_itself_is_mended_and_noted(tmp_path: Path) -> None:
    content = street()
    content["drivable_areas"]["8"]["area_boundary"] = line((0, 0), (10, 10), (10, 0), (0, 10))
    source = read(content, tmp_path)
    assert [area.area for area in source.drivable] == pytest.approx([25.0, 25.0])
    assert all(area.is_valid for area in source.drivable)
    assert noted(source, "drivable areas that cross themselves").endswith(": 1.")


# --- where the map lies ----------------------------------------------------------------------------


@pytest.mark.parametrize("city", CITIES, ids=lambda city: city.code)
def test_the_origin_of_each_city_is_where_argoverse_has_it(city: Any) -> None:
    crs, (x_m, y_m) = city_frame(city.code)
    back = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    assert back.transform(x_m, y_m) == pytest.approx((city.longitude_deg, city.latitude_deg), abs=1e-9)
    assert 100_000 < x_m < 900_000  # within the zone
    assert all(city_frame(name) == (crs, (x_m, y_m)) for name in (city.code.lower(), *city.names))


def test_the_city_is_the_argument_before_the_name_of_the_file(tmp_path: Path) -> None:
    file = written(street(), tmp_path)
    assert read_argoverse2(file).crs == "EPSG:32617"
    assert read_argoverse2(file).name == "argoverse2-pittsburgh-42"
    assert read_argoverse2(file, "Palo Alto").crs == "EPSG:32610"
    with pytest.raises(UnknownNameError, match="Did you mean 'miami'"):
        read_argoverse2(file, "miamy")


def test_the_city_is_found_in_the_recording_beside(tmp_path: Path) -> None:
    file = written(street(), tmp_path, "log_map_archive_0123abcd-1.json")
    pq.write_table(pa.table({"city": ["austin"]}), tmp_path / "scenario_0123abcd-1.parquet")
    pq.write_table(pa.table({"city": ["miami"]}), tmp_path / "scenario_other.parquet")
    source = read_argoverse2(file)
    assert (source.name, source.crs) == ("argoverse2-austin-0123abcd", "EPSG:32614")


@pytest.mark.parametrize("beside", [None, b"", b"PAR1", {"city": ["gotham"]}, {"town": ["austin"]}, {"city": []}])
def test_a_map_without_a_city_is_unplaced(beside: Any, tmp_path: Path) -> None:
    file = written(street(), tmp_path, "log_map_archive_0123abcd-1.json")
    if isinstance(beside, bytes):
        (tmp_path / "scenario_0123abcd-1.parquet").write_bytes(beside)
    elif beside is not None:
        pq.write_table(pa.table(beside), tmp_path / "scenario_0123abcd-1.parquet")
    source = read_argoverse2(file)
    assert (source.name, source.crs) == ("argoverse2-0123abcd", UNPLACED_CRS)
    assert_allclose(source.lanes["1"].left[0], UNPLACED_ORIGIN_M)
    assert noted(source, "not on the globe")


def test_a_folder_stands_for_the_one_map_in_it(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="holds no files"):
        read_argoverse2(tmp_path)
    written(street(), tmp_path)
    assert len(read_argoverse2(tmp_path).lanes) == 4
    written(street(), tmp_path, "log_map_archive_2.json")
    with pytest.raises(MapError, match="holds 2 files"):
        read_argoverse2(tmp_path)


# --- the second reading ----------------------------------------------------------------------------


def test_the_count_agrees_with_the_reader_on_a_street(tmp_path: Path) -> None:
    file = written(street(), tmp_path)
    assert_as_counted(read_argoverse2(file), count_argoverse2(file))
    assert count_argoverse2(tmp_path).lane_length_m == pytest.approx({"1": 40.0, "2": 40.0, "3": 40.0, "4": 20.0})


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"lane_segments": {"1": 3}}', "[" * 100_000])
def test_a_file_that_cannot_be_counted_is_refused_in_one_line(content: str, tmp_path: Path) -> None:
    with pytest.raises(MapError, match="cannot be counted") as caught:
        count_argoverse2(written(content, tmp_path))
    assert "\n" not in str(caught.value)


# --- real maps -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "lanes", "length_m", "crossings", "areas", "inside", "links"),
    [("austin_0a1e6f0a", 71, 1409.0, 6, 2, 32, (87, 8)), ("pit_57819", 199, 4091.0, 11, 8, 61, (230, 31))],
)
def test_a_real_map_has_what_its_publishers_put_in(
    name: str, lanes: int, length_m: float, crossings: int, areas: int, inside: int,
    links: tuple[int, int], tmp_path: Path,
) -> None:  # fmt: skip
    """Every lane counts, so those for bicycles and buses are read as lanes for cars."""
    (file,) = real("argoverse2", name).glob("*.json")
    content = json.loads(file.read_text())
    for row in content["lane_segments"].values():
        row["lane_type"] = "VEHICLE"
    source = read(content, tmp_path)
    assert len(source.lanes) == lanes
    left_m = [shapely.LineString(one.left).length for one in source.lanes.values()]
    assert sum(left_m) == pytest.approx(length_m, rel=0.02)
    assert sum(count_argoverse2(tmp_path).lane_length_m.values()) == pytest.approx(length_m, abs=1.0)
    assert (len(source.crosswalks), len(source.drivable)) == (crossings, areas)
    assert sum(one.in_intersection for one in source.lanes.values()) == inside
    ways = [other for one in source.lanes.values() for other in one.successors]
    assert (len(ways), sum(other not in source.lanes for other in ways)) == links
