"""CommonRoad files as maps: what each element of the format becomes."""

from __future__ import annotations

import gzip
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pyproj
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.maps.importers.commonroad.count import count_commonroad
from interplan_sumo.maps.importers.commonroad.reader import read_commonroad
from interplan_sumo.maps.importers.commonroad.signs import HIGHEST_LIMIT_MPS, usable_limit_mps
from interplan_sumo.maps.importers.source import SourceMap
from interplan_sumo.world.frame import UNPLACED_CRS, UNPLACED_ORIGIN_M, utm_frame
from interplan_sumo.world.geometry import Floats, Polyline, wrap_angle
from interplan_sumo.world.roads import StopLineKind
from tests.maps.commonroad_files import lanelet, location, points, scenario, sign, written
from tests.maps.source_worlds import assert_as_counted
from tests.realdata import real

UTM = "+proj=utm +zone=32 +ellps=WGS84"
MERCATOR = "EPSG:3857"


def read(folder: Path, *parts: str, **head: str) -> SourceMap:
    return read_commonroad(written(folder, scenario(*parts, **head)))


def local(xy: Floats) -> list[tuple[float, float]]:
    """Points of an unplaced map in the coordinates of its file."""
    return [(round(float(x), 6), round(float(y), 6)) for x, y in xy - UNPLACED_ORIGIN_M]


# --- lanes -------------------------------------------------------------------------------------------


def test_bounds_become_boundaries_in_the_direction_of_travel(tmp_path: Path) -> None:
    source = read(tmp_path, lanelet(7, (50.0, 0.0), 2.0))
    assert local(source.lanes["7"].left) == [(50.0, 2.0), (0.0, 2.0)]
    assert local(source.lanes["7"].right) == [(50.0, 5.5), (0.0, 5.5)]
    assert (source.name, source.format, source.crs) == ("DEU_Test-1_1_T-1", "CommonRoad", UNPLACED_CRS)
    assert any("does not say where it lies" in note for note in source.notes)


def test_only_lanes_of_the_same_direction_are_neighbours_and_that_from_both_sides(tmp_path: Path) -> None:
    middle = '<adjacentLeft ref="3" drivingDir="opposite"/><adjacentRight ref="2" drivingDir="same"/>'
    source = read(tmp_path, lanelet(1, inner=middle), lanelet(2, y=-3.5), lanelet(3, (50, 0), 0.0))
    assert (source.lanes["1"].left_neighbour, source.lanes["1"].right_neighbour) == (None, "2")
    assert (source.lanes["2"].left_neighbour, source.lanes["2"].right_neighbour) == ("1", None)
    assert source.lanes["3"].left_neighbour is None


@pytest.mark.parametrize(("length_m", "swapped"), [(0.3, False), (0.4, True), (9.0, True)])
def test_bounds_clearly_on_the_wrong_sides_are_swapped_and_noted(
    length_m: float, swapped: bool, tmp_path: Path
) -> None:
    """3 m apart: 0.33 m of length make one square metre."""
    left, right = (points([(0, y), (length_m, y)]) for y in (-3, 0))
    bounds = f"<leftBound>{left}</leftBound><rightBound>{right}</rightBound>"
    source = read(tmp_path, f'<lanelet id="1">{bounds}</lanelet>')
    assert local(source.lanes["1"].left)[0] == (0.0, 0.0 if swapped else -3.0)
    assert any("wrong sides" in note for note in source.notes) == swapped


KINDS = {
    "<laneletType>urban</laneletType>": None,
    "<laneletType>highway</laneletType><userOneWay>car</userOneWay><userOneWay>truck</userOneWay>": None,
    "<laneletType>busLane</laneletType>": "bus lane",
    "<laneletType>busLane</laneletType><userOneWay>vehicle</userOneWay>": None,
    "<laneletType>bicycleLane</laneletType>": "bicycle lane",
    "<laneletType>shoulder</laneletType>": "shoulder",
    "<laneletType>sidewalk</laneletType><userOneWay>vehicle</userOneWay>": "sidewalk",
    "<laneletType>crosswalk</laneletType>": "crosswalk",
    "<laneletType>parking</laneletType>": "car park",
    "<userOneWay>pedestrian</userOneWay>": "footway",
    "<userBidirectional>bicycle</userBidirectional><userOneWay>bus</userOneWay>": "lane for bicycle and bus only",
    "<userBidirectional>priorityVehicle</userBidirectional>": None,
}


@pytest.mark.parametrize(("inner", "reason"), KINDS.items())
def test_type_and_users_say_whether_a_lanelet_is_for_cars(inner: str, reason: str | None, tmp_path: Path) -> None:
    source = read(tmp_path, lanelet(1), lanelet(2, y=-10.0, inner=inner))
    assert ("2" in source.lanes) == (reason is None)
    assert source.reasons == Counter([reason] if reason else [])
    assert len(source.crosswalks) == (reason == "crosswalk")
    assert len(source.walkways) == (reason in ("sidewalk", "footway"))
    assert len(source.carparks) == (reason == "car park")
    for item in source.left_out:
        assert (item.polygon is None) == (reason in ("crosswalk", "sidewalk", "footway"))


def test_a_lanelet_without_length_is_left_out(tmp_path: Path) -> None:
    source = read(tmp_path, lanelet(1), lanelet(2, (5.0, 5.0)))
    assert source.reasons == {"lanelet without length": 1}


# --- signs, lights, stop lines -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "limit_mps"),
    [
        ("13.4112", 13.4112), ("50kmh", 50 / 3.6), ("25mph", 25 * 0.44704), ("30 km/h", 30 / 3.6),
        ("-1.0", None), ("0", None), ("inf", None), ("", None), ("1.2.3", None), (None, None), ("50 knots", None),
        (str(HIGHEST_LIMIT_MPS), HIGHEST_LIMIT_MPS), (str(HIGHEST_LIMIT_MPS + 0.1), None),
    ],
)  # fmt: skip
def test_a_limit_is_metres_per_second_unless_it_names_a_unit(text: str | None, limit_mps: float | None) -> None:
    assert usable_limit_mps(text) == (None if limit_mps is None else pytest.approx(limit_mps))


@pytest.mark.parametrize("number", ["274", "R2-1"])
def test_the_lowest_of_several_limits_holds(number: str, tmp_path: Path) -> None:
    refs = '<trafficSignRef ref="8"/><trafficSignRef ref="9"/>'
    source = read(tmp_path, lanelet(1, inner=refs), lanelet(2), sign(8, number, "13.9"), sign(9, number, "8.3"))
    assert source.lanes["1"].speed_limit_mps == 8.3
    assert source.lanes["2"].speed_limit_mps is None


def test_in_2018b_the_lanelet_itself_has_the_limit_and_one_that_no_road_has_is_dropped_and_noted(
    tmp_path: Path,
) -> None:
    lanelets = (lanelet(i, inner=f"<speedLimit>{mps}</speedLimit>") for i, mps in ((1, 80), (2, 11.176)))
    source = read(tmp_path, *lanelets, version="2018b")
    assert [lane.speed_limit_mps for lane in source.lanes.values()] == [None, 11.176]
    assert any("1 speed limit could not be used" in note for note in source.notes)


@pytest.mark.parametrize(
    ("number", "kind"),
    [
        ("206", StopLineKind.STOP_SIGN),
        ("R1-1", StopLineKind.STOP_SIGN),
        ("205", StopLineKind.YIELD),
        ("R1-2", StopLineKind.YIELD),
        ("310", None),
    ],
)
def test_a_sign_holds_at_the_end_of_the_last_lanelet_that_names_it(
    number: str, kind: StopLineKind | None, tmp_path: Path
) -> None:
    ref = '<trafficSignRef ref="9"/>'
    source = read(tmp_path, lanelet(1, (0, 9), inner=ref, after=[2]), lanelet(2, (9, 18), inner=ref), sign(9, number))
    assert source.lanes["1"].sign_at_end is None
    assert source.lanes["2"].sign_at_end == kind


def intersection(*ways: tuple[int, int]) -> str:
    incoming = "".join(
        f'<incoming id="9{i}"><incomingLanelet ref="{way_in}"/><successorsStraight ref="{through}"/></incoming>'
        for i, (way_in, through) in enumerate(ways)
    )
    return f'<intersection id="900">{incoming}</intersection>'


@pytest.mark.parametrize(("gap_m", "kept"), [(9.0, True), (11.0, False)])
def test_links_between_lanelets_that_lie_apart_are_left_out_and_told(gap_m: float, kept: bool, tmp_path: Path) -> None:
    ahead = lanelet(2, (50.0 + gap_m, 120.0), before=(1,))
    source = read_commonroad(written(tmp_path, scenario(lanelet(1, after=(2, 3)), ahead, lanelet(3, (50.0, 90.0)))))
    assert source.lanes["1"].successors == (("2", "3") if kept else ("3",))
    assert source.lanes["2"].predecessors == (("1",) if kept else ())
    told = "1 link between lanelets that lie apart, such as 1 and 2 (11 m): not kept."
    assert (told in source.notes) != kept


def test_a_sign_named_before_and_within_an_intersection_holds_before_it(tmp_path: Path) -> None:
    ref = '<trafficSignRef ref="9"/>'
    lanelets = lanelet(1, (0, 9), inner=ref, after=[2]), lanelet(2, (9, 18), inner=ref, after=[3]), lanelet(3, (18, 27))
    source = read(tmp_path, *lanelets, sign(9, "206"), intersection((1, 2)))
    assert [lane.sign_at_end for lane in source.lanes.values()] == [StopLineKind.STOP_SIGN, None, None]


def test_lanelets_that_lead_on_from_an_incoming_one_lie_in_the_intersection(tmp_path: Path) -> None:
    lanelets = (lanelet(i, (10.0 * i, 10.0 * i + 10.0), after=[i + 1]) for i in range(1, 6))
    source = read(tmp_path, *lanelets, intersection((1, 2), (2, 3), (3, 4)))
    # 2 and 3 lead through one intersection and to the next: they are lanes between two of them.
    assert [id_ for id_, lane in source.lanes.items() if lane.in_intersection] == ["4"]


def test_a_lanelet_may_be_typed_as_intersection(tmp_path: Path) -> None:
    assert read(tmp_path, lanelet(1, inner="<laneletType>intersection</laneletType>")).lanes["1"].in_intersection


def test_a_light_holds_at_the_end_before_an_intersection_and_at_the_start_within(tmp_path: Path) -> None:
    ref = '<trafficLightRef ref="70"/>'
    source = read(
        tmp_path,
        lanelet(1, (0, 10), inner=ref, after=[2]),
        lanelet(2, (10, 20), inner=ref, after=[3]),
        lanelet(3, (20, 30), inner=ref),
        '<trafficLight id="70"/>',
        intersection((2, 3)),
    )
    assert [lane.lights_at_end for lane in source.lanes.values()] == [(), ("70",), ()]
    assert [lane.lights_at_start for lane in source.lanes.values()] == [(), (), ("70",)]


def test_a_light_out_of_service_is_none(tmp_path: Path) -> None:
    dark = '<trafficLight id="70"><active>false</active></trafficLight>'
    assert read(tmp_path, lanelet(1, inner='<trafficLightRef ref="70"/>'), dark).lanes["1"].lights_at_end == ()


def test_a_stop_line_without_points_lies_at_the_end_of_its_lanelet(tmp_path: Path) -> None:
    inner = '<stopLine><lineMarking>solid</lineMarking><trafficLightRef ref="70"/></stopLine>'
    source = read(tmp_path, lanelet(1, inner=inner))
    (line,) = source.stop_lines
    assert local(line.points) == [(50.0, 0.0), (50.0, -3.5)]
    assert (line.kind, line.lane_ids) == (StopLineKind.TRAFFIC_LIGHT, ("1",))
    assert source.lanes["1"].lights_at_end == ("70",)


@pytest.mark.parametrize(
    ("inner", "kind"),
    [
        ('<trafficSignRef ref="9"/>', StopLineKind.STOP_SIGN),
        ('<trafficSignRef ref="10"/>', StopLineKind.YIELD),
        ("", StopLineKind.UNKNOWN),
    ],
)
def test_a_stop_line_is_of_the_kind_of_its_sign(inner: str, kind: StopLineKind, tmp_path: Path) -> None:
    line = f"<stopLine>{points([(48, 0), (48, -3.5)])}<lineMarking>solid</lineMarking>{inner}</stopLine>"
    source = read(tmp_path, lanelet(1, inner=line), sign(9, "206"), sign(10, "205"))
    assert local(source.stop_lines[0].points) == [(48.0, 0.0), (48.0, -3.5)]
    assert source.stop_lines[0].kind == kind
    assert source.lanes["1"].sign_at_end == (None if kind == StopLineKind.UNKNOWN else kind)


# --- the side and the place --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("inner", "name", "side", "notes"),
    [
        ('<adjacentLeft ref="2" drivingDir="opposite"/>', "GBR_Test-1", "right", 0),
        ('<adjacentRight ref="2" drivingDir="opposite"/>', "DEU_Test-1", "left", 0),
        ("", "GBR_Test-1", "left", 0),
        ("", "C-SGP_Test-1", "left", 0),
        ("", "DEU_Test-1", "right", 1),
    ],
)
def test_the_side_is_that_of_oncoming_lanelets_else_the_country_s(
    inner: str, name: str, side: str, notes: int, tmp_path: Path
) -> None:
    source = read(tmp_path, lanelet(1, inner=inner), lanelet(2, (50, 0), 0.0), name=name)
    assert source.driving_side == side
    assert sum("keep right" in note for note in source.notes) == notes


def test_mercator_s_metres_are_stretched_and_come_out_as_metres_of_the_ground(tmp_path: Path) -> None:
    to_mercator = pyproj.Transformer.from_crs("EPSG:4326", MERCATOR, always_xy=True)
    shift = to_mercator.transform(11.58, 48.14)
    source = read(tmp_path, location(MERCATOR, shift), lanelet(1, (0.0, 1000.0)))
    left = source.lanes["1"].left
    assert source.crs == "EPSG:32632"
    assert Polyline(left).length_m == pytest.approx(1000.0 * math.cos(math.radians(48.14)), rel=2e-3)
    back = pyproj.Transformer.from_crs(source.crs, "EPSG:4326", always_xy=True).transform(*left[0])
    assert back == pytest.approx((11.58, 48.14), abs=1e-7)


def test_points_are_scaled_then_turned_then_shifted(tmp_path: Path) -> None:
    place = location(UTM, (690_000.0, 5_335_000.0), turn=math.pi / 2.0, scale=2.0)
    source = read(tmp_path, place, lanelet(1))
    assert source.crs == "EPSG:32632"
    np.testing.assert_allclose(source.lanes["1"].left, [(690_000.0, 5_335_000.0), (690_000.0, 5_335_100.0)], atol=1e-6)
    assert any("scaled" in note for note in source.notes)


@pytest.mark.parametrize(
    ("reference", "shift"),
    [
        ("somewhere", (0.0, 0.0)),
        ("EPSG:4326", (0.0, 0.0)),
        ("EPSG:2263", (300_000.0, 60_000.0)),  # feet
        (UTM, (0.0, 0.0)),  # 500 km outside the zone: nobody filled the shift in
        (MERCATOR, (0.0, 0.0)),  # the sea at 0, 0
        (MERCATOR, (0.0, 3e7)),  # the pole
    ],
)
def test_a_reference_that_cannot_be_true_is_noted_and_not_used(
    reference: str, shift: tuple[float, float], tmp_path: Path
) -> None:
    source = read(tmp_path, location(reference, shift), lanelet(1))
    assert source.crs == UNPLACED_CRS
    assert any("georeference cannot be used" in note for note in source.notes)


@settings(max_examples=15)  # making a transformer takes long
@given(
    st.floats(-179.0, 179.0), st.floats(-80.0, 80.0), st.floats(-math.pi, math.pi), st.sampled_from([MERCATOR, "local"])
)
def test_a_frame_turns_headings_and_vectors_as_it_turns_points(
    longitude: float, latitude: float, heading: float, system: str
) -> None:
    """The way to a point 1 m ahead, moved as points are, is the vector moved as vectors are."""
    if max(abs(longitude), abs(latitude)) < 0.1:
        return
    reference = f"+proj=tmerc +lat_0={latitude} +lon_0={longitude} +datum=WGS84" if system == "local" else system
    origin = pyproj.Transformer.from_crs("EPSG:4326", reference, always_xy=True).transform(longitude, latitude)
    frame = utm_frame(reference, origin)
    xy, ahead = np.array([origin]), np.array([[math.cos(heading), math.sin(heading)]])
    moved = frame.vectors(xy, 20.0 * ahead)
    np.testing.assert_allclose(moved, 20.0 * (frame.points(xy + ahead) - frame.points(xy)), atol=1e-6)
    found = frame.headings(xy, np.array([heading]))
    assert abs(wrap_angle(found[0] - math.atan2(moved[0, 1], moved[0, 0]))) < 1e-6
    stretch = 1.0 if system == "local" else math.cos(math.radians(latitude))
    assert math.hypot(*moved[0]) == pytest.approx(20.0 * stretch, rel=8e-3)


def test_a_utm_zone_counted_on_below_the_equator_becomes_the_southern_one() -> None:
    north = utm_frame("+proj=utm +zone=23 +datum=WGS84", (300_000.0, -2_000_000.0))
    assert north.crs == "EPSG:32723"
    assert north.points(np.array([(300_000.0, -2_000_000.0)])).tolist() == [[300_000.0, 8_000_000.0]]


def test_a_gzipped_file_is_read_as_well(tmp_path: Path) -> None:
    path = tmp_path / "scenario.xml.gz"
    path.write_bytes(gzip.compress(scenario(lanelet(1)).encode()))
    assert list(read_commonroad(path).lanes) == ["1"]
    assert list(count_commonroad(path).lane_length_m) == ["1"]


# --- a second reading --------------------------------------------------------------------------------


@pytest.mark.parametrize(("reference", "lonlat"), [("", (0.0, 0.0)), (UTM, (11.58, 48.14)), (MERCATOR, (-58.4, -34.6))])
def test_a_second_reading_counts_the_same(reference: str, lonlat: tuple[float, float], tmp_path: Path) -> None:
    ref = '<trafficLightRef ref="70"/><trafficSignRef ref="8"/>'
    place = ""
    if reference:
        to_metres = pyproj.Transformer.from_crs("EPSG:4326", reference, always_xy=True)
        place = location(reference, to_metres.transform(*lonlat), 0.3, 1.5)
    text = scenario(
        place,
        lanelet(1, (0, 50), inner=ref, after=[2]),
        lanelet(2, (50, 100), inner=ref, before=[98]),
        lanelet(3, (100, 120), before=[2], after=[99], inner="<speedLimit>5.5</speedLimit>" + ref),
        lanelet(4, y=-9.0, inner="<laneletType>crosswalk</laneletType>", after=[3]),
        lanelet(5, y=-19.0, inner="<laneletType>busLane</laneletType>"),
        sign(8, "274", "30kmh"),
        intersection((2, 3)),
    )
    path = written(tmp_path, text)
    source, count = read_commonroad(path), count_commonroad(path)
    assert_as_counted(source, count)
    assert (len(count.links), count.leaving) == (2, 2)


# --- the real scenario -------------------------------------------------------------------------------


def test_the_real_scenario_has_what_commonroad_io_finds_in_it() -> None:
    """Figures of commonroad-io 2026.1 for the version 2018b of this scenario."""
    file = real("commonroad", "USA_Lanker-1_1_T-1.xml")
    lankershim, count = read_commonroad(file), count_commonroad(file)
    assert len(lankershim.lanes) == 91
    assert len(count.links) == 84
    assert sum(count.lane_length_m.values()) == pytest.approx(1689.40, abs=1.0)
    assert Counter(lane.speed_limit_mps for lane in lankershim.lanes.values()) == {13.4112: 74, 11.176: 17}  # mph
    assert lankershim.driving_side == "right"
