"""Lanelet2 files as source maps, and the second reading that may contradict it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.maps.importers.lanelet2.count import count_lanelet2
from interplan_sumo.maps.importers.lanelet2.reader import read_lanelet2
from interplan_sumo.world.frame import UNPLACED_CRS, UNPLACED_ORIGIN_M
from interplan_sumo.world.roads import StopLineKind
from tests.maps.lanelet2_files import ORIGIN_M, Osm, crossing, example, middle_m, read
from tests.maps.source_worlds import assert_as_counted


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "Some Town-2.osm"


# --- place -----------------------------------------------------------------------------------------------


def test_degrees_become_metres_of_the_utm_zone(osm: Osm, file: Path) -> None:
    lane = osm.straight(0.0, 40.0)
    source = read(osm, file)
    assert (source.name, source.format, source.crs) == ("some_town_2", "Lanelet2", "EPSG:32632")
    np.testing.assert_allclose(source.lanes[lane].left, np.add([[0.0, 0.0], [40.0, 0.0]], ORIGIN_M), atol=1e-3)
    np.testing.assert_allclose(source.lanes[lane].right, np.add([[0.0, -3.0], [40.0, -3.0]], ORIGIN_M), atol=1e-3)


def test_south_of_the_equator_the_zone_is_a_southern_one(osm: Osm, file: Path) -> None:
    osm.straight(0.0, 40.0)
    file.write_text(osm.text().replace("lat='", "lat='-"))
    assert read_lanelet2(file).crs == "EPSG:32732"


@pytest.mark.parametrize("degrees", ["0.00000000000", "", "35.5"])
def test_local_metres_are_used_as_they_stand_where_degrees_do_not_vary(degrees: str, osm: Osm, file: Path) -> None:
    lane = osm.straight(0.0, 40.0)
    text = osm.text("local", head="<MetaInfo format_version='1' map_version='2'/>")
    file.write_text(text.replace("'0.00000000000'", f"'{degrees}'"))
    source = read_lanelet2(file)
    assert source.crs == UNPLACED_CRS
    np.testing.assert_allclose(source.lanes[lane].left[1], np.add((40.0, 0.0), UNPLACED_ORIGIN_M), atol=1e-3)
    assert "The map is not placed on the globe." in source.notes


@pytest.mark.parametrize(
    ("root", "head"),
    [
        ("geoReference='EPSG:3857'", ""),
        ("", "<geoReference v='EPSG:3857'/>"),
        ("", "<geoReference>+init=epsg:3857</geoReference>"),
        ("", "<tag k='geoReference' v='+proj=merc +a=6378137 +b=6378137 +units=m +no_defs'/>"),
    ],
)
def test_one_map_in_three_encodings_is_equally_long(root: str, head: str, file: Path) -> None:
    osm = crossing()
    maps = [read(osm, file), read(osm, file, "local"), read(osm, file, "mercator", root=root, head=head)]
    assert [source.crs for source in maps] == ["EPSG:32632", UNPLACED_CRS, "EPSG:32632"]
    for other in maps[1:]:
        for id_, lane in maps[0].lanes.items():
            assert middle_m(other.lanes[id_]) == pytest.approx(middle_m(lane), rel=1e-3)
    assert_as_counted(maps[2], count_lanelet2(file))


def test_metres_of_a_geo_reference_that_nobody_knows_stand_as_they_are(file: Path) -> None:
    source = read(crossing(), file, "local", root="geoReference='EPSG:0'")
    assert source.crs == UNPLACED_CRS
    assert any("'EPSG:0' is not a projected system" in note for note in source.notes)


def test_degrees_win_where_local_metres_agree(file: Path) -> None:
    assert read(crossing(), file, "both").crs == "EPSG:32632"


def test_local_metres_win_where_degrees_are_of_another_size(file: Path) -> None:
    text = crossing().text("both")
    file.write_text(text.replace("lat='49.0", "lat='49.").replace("lon='8.42", "lon='8.4"))
    source = read_lanelet2(file)
    assert source.crs == UNPLACED_CRS
    assert_as_counted(source, count_lanelet2(file))
    assert middle_m(next(iter(source.lanes.values()))) == pytest.approx(40.0)


def test_local_metres_of_a_grid_lose_whole_kilometres(file: Path) -> None:
    text = crossing().text("both")
    parts = [line if not line.startswith("<node") else line.split(" lat=")[0] + ">" for line in text.split("\n")]
    file.write_text("\n".join(parts))
    source = read_lanelet2(file)
    assert source.crs == UNPLACED_CRS
    at = np.concatenate([lane.left for lane in source.lanes.values()]) - UNPLACED_ORIGIN_M
    assert np.abs(at).max() < 2000.0


# --- direction -------------------------------------------------------------------------------------------


def test_a_lanelet_much_wider_than_long_keeps_its_direction(osm: Osm, file: Path) -> None:
    lane = osm.lanelet([(0.0, 8.0), (1.0, 8.0)], [(1.0, 0.0), (0.0, 0.0)])
    heading = np.diff(read(osm, file).lanes[lane].right, axis=0)[0]
    np.testing.assert_allclose(heading, (1.0, 0.0), atol=1e-3)


def test_a_turn_on_the_spot_runs_round_its_short_boundary(osm: Osm, file: Path) -> None:
    inner, outer = [(0.0, 0.0), (-2.4, -2.0)], [(-5.0, 0.8), (-9.2, -2.8), (-3.4, -8.4), (-1.7, -6.9)]
    lane = osm.lanelet(inner, outer)
    before = osm.lanelet([(2.6, -4.8), (-2.4, -2.0)], [(0.0, 6.0), (-5.0, 0.8)])
    source = read(osm, file)
    assert source.lanes[before].successors == (lane,)
    np.testing.assert_allclose(source.lanes[lane].left[-1] - ORIGIN_M, (0.0, 0.0), atol=1e-3)
    assert_as_counted(source, count_lanelet2(file))


@settings(max_examples=30)
@given(
    heading_rad=st.floats(-3.1, 3.1),
    bend_rad=st.floats(-2.8, 2.8),
    turned=st.tuples(st.booleans(), st.booleans()),
    radius_m=st.floats(6.0, 60.0),
)
def test_left_lies_on_the_left_of_any_bend(
    heading_rad: float,
    bend_rad: float,
    turned: tuple[bool, bool],
    radius_m: float,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    steps = np.linspace(0.0, 1.0, 9)
    angles = heading_rad + bend_rad * steps
    course = np.stack((np.cos(angles), np.sin(angles)), axis=1).cumsum(axis=0) * radius_m / 6.0
    across = np.stack((-np.sin(angles), np.cos(angles)), axis=1)
    osm = Osm()
    sides = [np.round(course + sign * 1.2 * across, 3) for sign in (1.0, -1.0)]
    points = [
        [(float(x), float(y)) for x, y in side[:: -1 if turn else 1]] for side, turn in zip(sides, turned, strict=True)
    ]
    lane = osm.lanelet(points[0], points[1])
    found = read(osm, tmp_path_factory.mktemp("bends") / "map.osm").lanes[lane]
    np.testing.assert_allclose(found.left, sides[0] + ORIGIN_M, atol=2e-3)
    np.testing.assert_allclose(found.right, sides[1] + ORIGIN_M, atol=2e-3)


# --- following and adjoining -----------------------------------------------------------------------------


def test_lanelets_follow_where_both_boundaries_go_on_from_one_node(osm: Osm, file: Path) -> None:
    first = osm.straight(0.0, 40.0)
    second = osm.straight(40.0, 80.0)
    narrower = osm.straight(40.0, 80.0, width_m=2.0)
    osm.straight(80.0, 40.0, left_m=-3.0)  # oncoming
    source = read(osm, file)
    assert source.lanes[first].successors == (second,)
    assert source.lanes[second].predecessors == (first,)
    assert source.lanes[narrower].predecessors == ()


def test_no_lanelet_that_follows_another_is_worth_a_note(osm: Osm, file: Path) -> None:
    osm.straight(0.0, 40.0)
    assert not any("follows" in note for note in read(osm, file).notes)
    osm.straight(40.001, 80.0)
    assert any("No lanelet follows another" in note for note in read(osm, file).notes)


def test_neighbours_share_a_way_and_a_direction(osm: Osm, file: Path) -> None:
    left, right = osm.straight(0.0, 40.0, 0.0), osm.straight(0.0, 40.0, -3.0)
    oncoming = osm.straight(40.0, 0.0, 0.0)
    bicycles = osm.straight(0.0, 40.0, -6.0, tags={"subtype": "bicycle_lane"})
    lanes = read(osm, file).lanes
    assert bicycles not in lanes
    assert (lanes[left].left_neighbour, lanes[left].right_neighbour) == (None, right)
    assert (lanes[right].left_neighbour, lanes[right].right_neighbour) == (left, None)
    assert (lanes[oncoming].left_neighbour, lanes[oncoming].right_neighbour) == (None, None)


def test_of_two_lanelets_beyond_a_boundary_the_nearer_is_the_neighbour(osm: Osm, file: Path) -> None:
    left = osm.straight(0.0, 40.0)
    osm.lanelet([(0.0, -3.0), (40.0, -3.0)], [(0.0, -9.0), (40.0, -20.0)])
    nearer = osm.straight(0.0, 40.0, -3.0)
    assert read(osm, file).lanes[left].right_neighbour == nearer


# --- driving side ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("median_m", "is_shown"), [(0.0, True), (2.0, True), (11.9, True), (12.1, False)])
@pytest.mark.parametrize("keeps_left", [False, True])
def test_oncoming_lanes_show_the_driving_side_also_beyond_a_median(
    keeps_left: bool, median_m: float, is_shown: bool, osm: Osm, file: Path
) -> None:
    osm.straight(0.0, 40.0)
    osm.straight(40.0, 0.0, -6.0 - median_m if keeps_left else median_m)
    source = read(osm, file)
    assert source.driving_side == ("left" if keeps_left and is_shown else "right")
    assert any("assumed" in note for note in source.notes) != is_shown


# --- both directions -------------------------------------------------------------------------------------


@pytest.mark.parametrize("one_way", ["no", "false"])
def test_a_wide_two_way_lanelet_is_split_along_its_middle(one_way: str, osm: Osm, file: Path) -> None:
    first = osm.straight(0.0, 40.0, 0.0, 6.0, tags={"one_way": one_way})
    second = osm.straight(40.0, 80.0, 0.0, 6.0, tags={"one_way": one_way})
    source = read(osm, file)
    assert set(source.lanes) == {first, second, f"{first}:back", f"{second}:back"}
    there, back = source.lanes[first], source.lanes[f"{first}:back"]
    assert there.successors == (second,)
    assert source.lanes[f"{second}:back"].successors == (back.id,)
    np.testing.assert_allclose(there.left[:, 1] - ORIGIN_M[1], -3.0, atol=1e-3)
    np.testing.assert_allclose(there.left, back.left[::-1], atol=1e-6)
    np.testing.assert_allclose(back.right[:, 1] - ORIGIN_M[1], 0.0, atol=1e-3)
    assert_as_counted(source, count_lanelet2(file))


def test_where_traffic_keeps_left_the_way_there_is_the_left_half(osm: Osm, file: Path) -> None:
    osm.straight(0.0, 40.0, 50.0)
    osm.straight(40.0, 0.0, 44.0)
    road = osm.straight(0.0, 40.0, 0.0, 6.0, tags={"one_way": "no"})
    source = read(osm, file)
    np.testing.assert_allclose(source.lanes[road].right[:, 1] - ORIGIN_M[1], -3.0, atol=1e-3)
    np.testing.assert_allclose(source.lanes[f"{road}:back"].right[:, 1] - ORIGIN_M[1], -3.0, atol=1e-3)
    assert_as_counted(source, count_lanelet2(file))


@pytest.mark.parametrize(("width_m", "lanes"), [(4.49, 1), (4.51, 2)])
def test_a_narrow_two_way_lanelet_keeps_its_own_direction(width_m: float, lanes: int, osm: Osm, file: Path) -> None:
    osm.straight(0.0, 40.0, 0.0, width_m, tags={"one_way": "no"})
    source = read(osm, file)
    assert len(source.lanes) == lanes
    assert any("narrower than 4.5 m" in note for note in source.notes) == (lanes == 1)
    assert_as_counted(source, count_lanelet2(file))


@pytest.mark.parametrize(("key", "lanes"), [("one_way:vehicle", 2), ("one_way:bicycle", 1)])
def test_two_ways_may_be_open_to_some_only(key: str, lanes: int, osm: Osm, file: Path) -> None:
    osm.straight(0.0, 40.0, 0.0, 6.0, tags={key: "no"})
    assert len(read(osm, file).lanes) == lanes


def test_a_half_widens_to_the_whole_where_only_whole_lanelets_lie_beyond(osm: Osm, file: Path) -> None:
    road = osm.straight(0.0, 40.0, 0.0, 6.0, tags={"one_way": "no"})
    onward = osm.straight(40.0, 80.0, 0.0, 6.0)
    lanes = read(osm, file).lanes
    there, back = lanes[road], lanes[f"{road}:back"]
    assert there.successors == (onward,)
    np.testing.assert_allclose(there.left[-1], lanes[onward].left[0], atol=1e-6)
    np.testing.assert_allclose(there.left[0] - ORIGIN_M, (0.0, -3.0), atol=1e-3)
    at_30 = there.left[np.abs(there.left[:, 0] - ORIGIN_M[0] - 30.0) < 0.5]
    np.testing.assert_allclose(at_30[:, 1] - ORIGIN_M[1], -3.0, atol=0.05)
    np.testing.assert_allclose(back.left[:, 1] - ORIGIN_M[1], -3.0, atol=1e-3)


# --- kinds -----------------------------------------------------------------------------------------------

KINDS: dict[str, tuple[dict[str, str], ...]] = {
    "lane": (
        {"subtype": "road"}, {"subtype": "highway"}, {"subtype": "play_street"}, {"subtype": "exit"}, {"subtype": ""},
        {"participant:vehicle": "yes"}, {"participant:vehicle:car": "yes"},
        {"participant:vehicle:car:electric": "yes"}, {"participant:pedestrian": "no"},
        {"subtype": "bicycle_lane", "participant:vehicle": "yes"},
    ),
    "paved": (
        {"subtype": "bus_lane"}, {"subtype": "bicycle_lane"}, {"subtype": "emergency_lane"},
        {"subtype": "road_shoulder"}, {"participant:vehicle": "no"}, {"participant:vehicle:bus": "yes"},
        {"no_drivable_lane": "yes"},
    ),
    "crosswalk": (
        {"subtype": "crosswalk"}, {"subtype": "crosswalk", "participant:pedestrian": "yes"},
    ),
    "walkway": (
        {"subtype": "walkway"}, {"subtype": "stairs"}, {"subtype": "shared_walkway"},
        {"participant:pedestrian": "yes", "participant:bicycle": "yes"},
    ),
    "other": (
        {"subtype": "rail"},
    ),
}  # fmt: skip


@pytest.mark.parametrize(("expected", "tags"), [(kind, tags) for kind, several in KINDS.items() for tags in several])
def test_tags_tell_what_becomes_of_a_lanelet(expected: str, tags: dict[str, str], osm: Osm, file: Path) -> None:
    osm.straight(0.0, 40.0)
    id_ = osm.straight(0.0, 40.0, -10.0, tags=tags)
    source = read(osm, file)
    assert (id_ in source.lanes) == (expected == "lane")
    left_out = {item.id: item for item in source.left_out}
    assert (id_ in left_out) == (expected != "lane")
    if id_ in left_out:
        polygon = left_out[id_].polygon
        assert (polygon is not None and polygon.area == pytest.approx(120.0, rel=1e-3)) == (expected == "paved")
    assert len(source.crosswalks) == (expected == "crosswalk")
    assert len(source.walkways) == (expected == "walkway")
    assert_as_counted(source, count_lanelet2(file))


def test_a_turn_or_an_intersection_area_tells_what_lies_inside(osm: Osm, file: Path) -> None:
    inside = [
        osm.straight(0.0, 10.0, tags={"turn_direction": "left"}),
        osm.straight(0.0, 10.0, -9.0, tags={"intersection_area": "77"}),
    ]
    outside = [osm.straight(0.0, 10.0, -20.0), osm.straight(0.0, 10.0, -30.0, tags={"intersection_area": "no"})]
    lanes = read(osm, file).lanes
    assert [lanes[id_].in_intersection for id_ in (*inside, *outside)] == [True, True, False, False]


def test_areas_go_where_they_belong(file: Path) -> None:
    osm = crossing()
    hole = osm.way((2.0, 42.0), (3.0, 42.0), (2.0, 43.0), (2.0, 42.0))
    outer = osm.way((0.0, 60.0), (9.0, 60.0), (9.0, 69.0), (0.0, 69.0), (0.0, 60.0))
    island = osm.way((2.0, 62.0), (3.0, 62.0), (3.0, 63.0), (2.0, 63.0), (2.0, 62.0))
    for subtype in ("walkway", "freespace", "vegetation"):
        osm.relation(
            [("way", outer, "outer"), ("way", island, "inner"), ("way", hole, "inner")],
            {"type": "multipolygon", "subtype": subtype},
        )
    osm.relation([("way", osm.way((0.0, 80.0), (9.0, 80.0)), "outer")], {"type": "multipolygon", "subtype": "parking"})
    osm.way((20.0, 60.0), (29.0, 60.0), (29.0, 69.0), area="yes", type="parking_lot")
    source = read(osm, file)
    assert [polygon.area for polygon in source.walkways] == pytest.approx([80.0], rel=1e-3)
    assert [polygon.area for polygon in source.drivable] == pytest.approx([80.0], rel=1e-3)
    assert [polygon.area for polygon in source.carparks] == pytest.approx([50.0, 40.5], rel=1e-3)
    assert "Areas passed over: 1 vegetation." in source.notes
    assert any(note.startswith("1 areas cannot be used") and note.endswith("does not close.") for note in source.notes)


# --- the real map ----------------------------------------------------------------------------------------


def test_the_real_map_has_what_its_readme_says() -> None:
    source = read_lanelet2(example())
    assert len(source.lanes) + len(source.left_out) - sum(":back" in id_ for id_ in source.lanes) == 371
    assert (source.crs, source.driving_side) == ("EPSG:32632", "right")
    own = [lane for lane in source.lanes.values() if ":back" not in lane.id]
    closed = source.reasons["lane closed to cars"]
    assert len(own) + closed == 337 + 8  # roads and motorway lanes
    lights = [line for line in source.stop_lines if line.kind == StopLineKind.TRAFFIC_LIGHT]
    assert len(lights) == 4
    assert sum(bool(lane.lights_at_end) for lane in source.lanes.values()) == 10
    assert len(source.crosswalks) == 8
    assert len(source.carparks) == 19
