"""SUMO networks as maps: lanes, ways through junctions, signs, lights, places."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import numpy as np
import pyproj
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.maps.importers.lines import beside
from interplan_sumo.maps.importers.source import SourceMap
from interplan_sumo.maps.importers.sumo.count import count_sumo_network
from interplan_sumo.maps.importers.sumo.reader import read_sumo_network
from interplan_sumo.world.frame import UNPLACED_CRS, UNPLACED_ORIGIN_M
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import StopLineKind
from tests.maps.source_worlds import assert_as_counted
from tests.maps.sumo_nets import by_hand, crossroads, edge, lane, made, node, written
from tests.realdata import real


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> SourceMap:
    return read_sumo_network(crossroads(tmp_path_factory.mktemp("plain")))


def local(xy: Floats) -> list[tuple[float, float]]:
    """Points of an unplaced map in the coordinates of its file."""
    return [(round(float(x), 3), round(float(y), 3)) for x, y in xy - UNPLACED_ORIGIN_M]


# --- lanes -------------------------------------------------------------------------------------------


def test_boundaries_run_half_a_width_beside_the_shape(plain: SourceMap) -> None:
    assert local(plain.lanes["wc_0"].right) == [(-100.0, -6.4), (-7.2, -6.4)]
    assert local(plain.lanes["wc_0"].left) == [(-100.0, -3.2), (-7.2, -3.2)]


def test_lane_0_lies_at_the_kerb_and_neighbours_share_their_boundary(plain: SourceMap) -> None:
    kerb, inner = plain.lanes["wc_0"], plain.lanes["wc_1"]
    assert (kerb.left_neighbour, kerb.right_neighbour) == ("wc_1", None)
    assert (inner.left_neighbour, inner.right_neighbour) == (None, "wc_0")
    np.testing.assert_array_equal(kerb.left, inner.right)


def test_where_traffic_keeps_left_the_kerb_is_on_the_left(tmp_path: Path) -> None:
    source = read_sumo_network(crossroads(tmp_path, "priority", "--lefthand"))
    kerb, inner = source.lanes["wc_0"], source.lanes["wc_1"]
    assert source.driving_side == "left"
    assert (kerb.left_neighbour, kerb.right_neighbour) == (None, "wc_1")
    np.testing.assert_array_equal(kerb.right, inner.left)
    assert local(kerb.left)[0] == (-100.0, 6.4)
    assert_as_counted(source, count_sumo_network(tmp_path / "made.net.xml"))


def test_neighbours_of_different_width_meet_where_both_end(tmp_path: Path) -> None:
    lanes = '<lane index="0" width="2.5"/><lane index="1" width="4.5"/>'
    path = made(tmp_path, [node("a", 0, 0), node("b", 90, 0)], [edge("ab", "a", "b", 2, inner=lanes)])
    source = read_sumo_network(path)
    kerb, inner = source.lanes["ab_0"], source.lanes["ab_1"]
    np.testing.assert_array_equal(kerb.left, inner.right)
    assert kerb.left[0, 1] - kerb.right[0, 1] == pytest.approx(2.5, abs=1e-3)
    assert inner.left[0, 1] - inner.right[0, 1] == pytest.approx(4.5, abs=1e-3)


def test_lanes_drawn_apart_keep_their_own_boundaries(tmp_path: Path) -> None:
    for gap, shared in ((0.49, True), (0.51, False)):
        lanes = lane("e_0", "0,0 50,0") + lane("e_1", f"0,{3.2 + gap} 50,{3.2 + gap}", 1)
        source = read_sumo_network(written(tmp_path, by_hand(f'<edge id="e">{lanes}</edge>')))
        assert np.array_equal(source.lanes["e_0"].left, source.lanes["e_1"].right) == shared
        assert source.lanes["e_0"].left_neighbour == "e_1"


PERMISSIONS = {
    'allow="passenger bus"': None,
    'allow="all"': None,
    'disallow="tram rail bicycle"': None,
    'allow="bus taxi bicycle"': "bus lane",
    'allow="bicycle"': "bicycle lane",
    'allow="pedestrian"': "sidewalk",
    'allow="tram"': "tram lane",
    'allow="rail rail_urban"': "railway",
    'allow="ship"': "waterway or runway",
    'allow="delivery bicycle pedestrian"': "lane for bicycle and delivery and pedestrian only",
    'disallow="all"': "closed lane",
    'disallow="passenger"': "bus lane",
    'allow="private emergency authority truck"': "lane for other vehicles",
}


@pytest.mark.parametrize(("permission", "reason"), PERMISSIONS.items())
def test_permissions_say_whether_a_lane_is_for_cars(permission: str, reason: str | None, tmp_path: Path) -> None:
    lanes = lane("e_0", "0,0 50,0", 0, permission) + lane("e_1", "0,3.2 50,3.2", 1)
    source = read_sumo_network(path := written(tmp_path, by_hand(f'<edge id="e">{lanes}</edge>')))
    assert ("e_0" in source.lanes) == (reason is None)
    assert source.lanes["e_1"].right_neighbour == ("e_0" if reason is None else None)
    assert source.reasons == Counter([reason] if reason else [])
    assert len(source.walkways) == (reason == "sidewalk")
    for item in source.left_out:
        assert (item.polygon is None) == (reason in ("sidewalk", "railway", "waterway or runway"))
    assert_as_counted(source, count_sumo_network(path))


def test_a_tram_beside_cars_runs_on_the_road_and_one_alone_does_not(tmp_path: Path) -> None:
    lanes = lane("r_0", "0,9 50,9", 0, 'allow="tram"'), lane("e_0", "0,0 50,0")
    source = read_sumo_network(
        written(tmp_path, by_hand(f'<edge id="r">{lanes[0]}</edge>', f'<edge id="e">{lanes[1]}</edge>'))
    )
    assert [item.polygon for item in source.left_out] == [None]


# --- ways through junctions --------------------------------------------------------------------------


def test_every_connection_is_one_lane_named_after_its_first_part(plain: SourceMap, tmp_path: Path) -> None:
    inside = {id_: one for id_, one in plain.lanes.items() if one.in_intersection}
    assert len(inside) == 14
    left_turn = inside[":c_6_0"]  # from the east to the south, over two internal lanes
    assert (left_turn.predecessors, left_turn.successors) == (("ec_1",), ("cs_0",))
    middle = (left_turn.left[[0, -1]] + left_turn.right[[0, -1]]) / 2.0
    assert local(middle) == [(7.2, 1.6), (-1.6, -10.4)]
    assert plain.lanes["ec_1"].successors == (":c_4_1", ":c_6_0")
    assert plain.lanes["cs_0"].predecessors == (":c_6_0", ":c_1_0", ":c_10_0")
    assert left_turn.speed_limit_mps == pytest.approx(8.67, abs=0.01)
    assert any("lower where a turn is tight" in note for note in plain.notes)
    assert_as_counted(plain, count_sumo_network(crossroads(tmp_path)))


def test_without_internal_lanes_lanes_follow_directly(tmp_path: Path) -> None:
    path = crossroads(tmp_path, "traffic_light", "--no-internal-links")
    source = read_sumo_network(path)
    assert not any(one.in_intersection for one in source.lanes.values())
    assert source.lanes["ec_1"].successors == ("cw_1", "cs_0")
    assert source.lanes["ec_1"].lights_at_end == ("c/5", "c/6")
    assert any("no lanes within junctions" in note for note in source.notes)
    assert_as_counted(source, count_sumo_network(path))


@pytest.mark.parametrize(
    ("way", "successors", "reasons"),
    [
        (lane(":j_0_0", "50,0 50,0"), ("b_0",), {}),
        (lane(":j_0_0", "50,0 50.01,0"), ("b_0",), {}),
        (lane(":j_0_0", "50,0 60,0", allow="bus"), (), {"way through a junction closed to cars": 1}),
    ],
    ids=["without length", "of a centimetre", "closed to cars"],
)
def test_a_way_without_length_is_a_direct_link_and_one_that_cars_may_not_take_is_none(
    way: str, successors: tuple[str, ...], reasons: dict[str, int], tmp_path: Path
) -> None:
    text = by_hand(
        f'<edge id=":j_0" function="internal">{way}</edge>',
        f'<edge id="a">{lane("a_0", "0,0 50,0")}</edge><edge id="b">{lane("b_0", "50,0 90,0")}</edge>',
        '<connection from="a" to="b" fromLane="0" toLane="0" via=":j_0_0" dir="s" state="M"/>',
        '<connection from=":j_0" to="b" fromLane="0" toLane="0" dir="s" state="M"/>',
    )
    source = read_sumo_network(path := written(tmp_path, text))
    assert list(source.lanes) == ["a_0", "b_0"]
    assert source.lanes["a_0"].successors == successors
    assert source.reasons == reasons
    if successors:
        assert_as_counted(source, count_sumo_network(path))


def test_a_light_holds_at_the_start_of_a_way(tmp_path: Path) -> None:
    source = read_sumo_network(path := crossroads(tmp_path, "traffic_light"))
    assert source.lanes[":c_7_0"].lights_at_start == ("c/7",)
    assert all(one.sign_at_end is None and not one.lights_at_end for one in source.lanes.values())
    assert_as_counted(source, count_sumo_network(path))


@pytest.mark.parametrize(
    ("type_", "kind", "lanes"),
    [
        ("priority", StopLineKind.YIELD, {"sc_0", "nc_0"}),
        ("priority_stop", StopLineKind.STOP_SIGN, {"sc_0", "nc_0"}),
        ("allway_stop", StopLineKind.STOP_SIGN, {"sc_0", "nc_0", "ec_0", "ec_1", "wc_0", "wc_1"}),
        ("right_before_left", None, set()),
        ("zipper", None, set()),
    ],
)
def test_a_sign_stands_where_every_way_must_give_way(
    type_: str, kind: StopLineKind | None, lanes: set[str], tmp_path: Path
) -> None:
    """Not on the main road, though its left turns must let oncoming traffic pass."""
    source = read_sumo_network(crossroads(tmp_path, type_))
    signs = {id_: one.sign_at_end for id_, one in source.lanes.items() if one.sign_at_end is not None}
    assert signs == dict.fromkeys(lanes, kind)


def test_turning_round_at_a_dead_end_needs_no_sign(tmp_path: Path) -> None:
    edges = [edge("ab", "a", "b"), edge("ba", "b", "a")]
    source = read_sumo_network(path := made(tmp_path, [node("a", 0, 0), node("b", 60, 0)], edges))
    (way,) = source.lanes["ab_0"].successors
    assert source.lanes[way].successors == ("ba_0",)
    assert source.lanes["ab_0"].sign_at_end is None
    assert_as_counted(source, count_sumo_network(path))  # a lane that turns on the spot


def test_crossings_walkways_and_paved_junctions_are_drawn(tmp_path: Path) -> None:
    text = by_hand(
        f'<edge id=":j_c0" function="crossing">{lane(":j_c0_0", "50,-5 50,5", width="4")}</edge>',
        f'<edge id=":j_c1" function="crossing">{lane(":j_c1_0", "60,-5 60,5", outlineShape="58,-5 62,-5 62,5")}</edge>',
        f'<edge id=":j_w0" function="walkingarea">{lane(":j_w0_0", "48,5 52,5 52,9 48,9")}</edge>',
        f'<edge id="a">{lane("a_0", "0,0 50,0")}</edge>',
        '<junction id="j" type="priority" incLanes="a_0" intLanes="" shape="50,-5 60,-5 60,5 50,5"/>',
        '<junction id="r" type="rail_signal" incLanes="r_0" intLanes="" shape="0,50 9,50 9,59"/>',
        '<junction id="d" type="dead_end" incLanes="a_0" intLanes="" shape="0,1 0,-1"/>',
    )
    source = read_sumo_network(written(tmp_path, text))
    assert [shape.area for shape in source.crosswalks] == pytest.approx([40.0, 20.0])
    assert [shape.area for shape in source.walkways] == pytest.approx([16.0])
    assert [shape.area for shape in source.drivable] == pytest.approx([100.0])


@pytest.mark.parametrize(
    ("outline", "area"),
    [
        ("48,-5 52,-5 52,5 48,5", 40),
        ("52,-5 55,-5 55,5 52,5", 40),
        ("48,-5 58,-5 58,5 48,5", 40),
        ("48,-6 52,-6 52,5 48,5", 44),
    ],
)
def test_an_outline_beside_or_far_round_its_crossing_is_not_taken(tmp_path: Path, outline: str, area: float) -> None:
    text = by_hand(
        f'<edge id=":j_c0" function="crossing">{lane(":j_c0_0", "50,-5 50,5", width="4", outlineShape=outline)}</edge>',
        f'<edge id="a">{lane("a_0", "0,0 50,0")}</edge>',
    )
    assert [shape.area for shape in read_sumo_network(written(tmp_path, text)).crosswalks] == pytest.approx([area])


def test_where_people_walk_a_junction_is_not_for_cars(tmp_path: Path) -> None:
    text = by_hand(
        f'<edge id=":j_w0" function="walkingarea">{lane(":j_w0_0", "57,2 60,2 60,5 57,5")}</edge>',
        f'<edge id="a">{lane("a_0", "0,0 50,0")}</edge>',
        '<junction id="j" type="priority" incLanes="a_0" intLanes="" shape="50,-5 60,-5 60,5 50,5"/>',
    )
    assert [shape.area for shape in read_sumo_network(written(tmp_path, text)).drivable] == pytest.approx([91.0])


def test_a_real_footpath_network_counts_alike(tmp_path: Path) -> None:
    options = ("--sidewalks.guess", "--sidewalks.guess.max-speed=20", "--bikelanes.guess", "--walkingareas")
    source = read_sumo_network(path := crossroads(tmp_path, "priority", *options, "--bikelanes.guess.max-speed=20"))
    assert source.reasons == {"sidewalk": 8, "bicycle lane": 8}
    assert_as_counted(source, count_sumo_network(path))


# --- places ------------------------------------------------------------------------------------------

MUNICH = [node("a", 11.580, 48.140), node("b", 11.583, 48.141), node("d", 11.586, 48.1405)]
SAO_PAULO = [node("a", -46.600, -23.500), node("b", -46.603, -23.501), node("d", -46.606, -23.5005)]
STREET = [edge("ab", "a", "b", 2), edge("bd", "b", "d", 2), edge("db", "d", "b"), edge("ba", "b", "a")]


@pytest.mark.parametrize(
    ("nodes", "options", "crs"),
    [
        (MUNICH, ("--proj.utm",), "EPSG:32632"),
        (MUNICH, ("--proj", "+proj=tmerc +lat_0=48.14 +lon_0=11.58 +datum=WGS84"), "EPSG:32632"),
        (MUNICH, ("--proj", "+proj=merc +datum=WGS84"), "EPSG:32632"),
        (SAO_PAULO, ("--proj.utm",), "EPSG:32723"),
    ],
)
def test_a_projection_leads_to_utm_metres_where_the_street_is(
    nodes: list[str], options: tuple[str, ...], crs: str, tmp_path: Path
) -> None:
    path = made(tmp_path, nodes, STREET, *options)
    source = read_sumo_network(path)
    assert source.crs == crs
    to_degrees = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    start = source.lanes["ab_1"].left[0]
    wanted = (11.58, 48.14) if nodes is MUNICH else (-46.6, -23.5)
    assert math.dist(start, to_degrees.transform(*wanted, direction="INVERSE")) < 5.0
    assert_as_counted(source, count_sumo_network(path))


def test_a_network_without_projection_stands_in(plain: SourceMap) -> None:
    assert plain.crs == UNPLACED_CRS
    assert any("does not say where it lies" in note for note in plain.notes)


def test_a_projection_that_cannot_be_used_is_noted(tmp_path: Path) -> None:
    place = '<location netOffset="0,0" projParameter="+proj=nonsense"/>'
    source = read_sumo_network(
        written(tmp_path, by_hand(f'<edge id="e">{lane("e_0", "0,0 9,0")}</edge>', location=place))
    )
    assert source.crs == UNPLACED_CRS
    assert any("projection cannot be used" in note for note in source.notes)


def test_a_gzipped_network_is_the_same(plain: SourceMap, tmp_path: Path) -> None:
    source = read_sumo_network(crossroads(tmp_path, name="zipped.net.xml.gz"))
    assert source.name == "zipped"
    assert source.lanes.keys() == plain.lanes.keys()


# --- boundaries of bends -----------------------------------------------------------------------------


def test_a_corner_is_mitred() -> None:
    corner = np.array([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0)])
    np.testing.assert_allclose(beside(corner, 2.0), [(0, 2), (8, 2), (8, 10)])
    np.testing.assert_allclose(beside(corner, -2.0), [(0, -2), (12, -2), (12, 10)])


def test_inside_a_turn_tighter_than_the_lane_the_boundary_comes_nearer() -> None:
    angle = np.linspace(0.0, math.pi, 19)
    turn = np.stack((np.cos(angle), np.sin(angle)), axis=1)  # to the left, radius 1 m
    inner = shapely.LineString(beside(turn, 1.6))
    assert inner.is_simple
    assert inner.length > 0.1
    assert shapely.LineString(beside(turn, -1.6)).length > shapely.LineString(turn).length


def test_a_fold_within_a_sharp_bend_is_cut_out() -> None:
    bend = np.array([(0.0, 0.0), (20.0, 0.0), (20.5, 0.3), (20.5, 1.0), (20.0, 20.0)])
    inner = beside(bend, 1.6)
    assert shapely.LineString(inner).is_simple
    assert np.hypot(*(inner[[0, -1]] - beside(bend, 0.001)[[0, -1]]).T) == pytest.approx([1.6, 1.6], abs=0.1)


@settings(max_examples=50)
@given(
    st.lists(st.tuples(st.floats(0.5, 30.0), st.floats(-2.5, 2.5)), min_size=1, max_size=8),
    st.sampled_from([-2.0, -1.6, 0.5, 1.6]),
)
def test_no_boundary_crosses_itself_or_strays(steps: list[tuple[float, float]], left_m: float) -> None:
    heading = np.cumsum([turn for _, turn in steps])
    way = np.array([length for length, _ in steps])[:, None] * np.stack((np.cos(heading), np.sin(heading)), axis=1)
    middle = np.concatenate(([(0.0, 0.0)], np.cumsum(way, axis=0)))
    line, along = shapely.LineString(beside(middle, left_m)), shapely.LineString(middle)
    if not along.is_simple:
        return
    assert line.is_simple
    assert line.length > 0.0
    assert shapely.hausdorff_distance(line, along) < 4.0 * abs(left_m) + max(length for length, _ in steps)


# --- the real network --------------------------------------------------------------------------------


def test_the_real_network_has_what_sumo_s_library_finds_in_it() -> None:
    path = real("sumo_nets", "ngsim_lankershim.net.xml")
    source = read_sumo_network(path)
    on_edges = [id_ for id_, one in source.lanes.items() if not one.in_intersection]
    assert len(on_edges) == 98
    assert len({id_.rpartition("_")[0] for id_ in on_edges}) == 34
    assert len(source.lanes) == 198
    count = count_sumo_network(path)
    assert sum(count.lane_length_m[id_] for id_ in on_edges) == pytest.approx(2900.0, abs=100.0)
    for id_, one in source.lanes.items():
        assert shapely.Polygon(np.concatenate((one.left, one.right[::-1]))).is_valid, id_
