"""OpenDRIVE files as maps: what each element of the format becomes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.maps.importers.opendrive.reader import LONGEST_CROSSING_M, read_opendrive
from interplan_sumo.maps.importers.source import SourceMap
from interplan_sumo.world.frame import UNPLACED_CRS, UNPLACED_ORIGIN_M
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import StopLineKind
from tests.maps.opendrive_files import (
    connection,
    crossing,
    cubic,
    geometry,
    lane,
    road,
    section,
    signal,
    to_junction,
    to_road,
    written,
    xodr,
)
from tests.realdata import real


def read(folder: Path, *parts: str, header: str = "<header/>") -> SourceMap:
    return read_opendrive(written(folder, xodr(*parts, header=header)))


def local(xy: Floats) -> list[tuple[float, float]]:
    """First and last point of a line of an unplaced map in the coordinates of its file."""
    return [(round(float(x), 4) + 0.0, round(float(y), 4) + 0.0) for x, y in (xy - UNPLACED_ORIGIN_M)[[0, -1]]]


def links(source: SourceMap) -> set[tuple[str, str]]:
    return {(lane.id, after) for lane in source.lanes.values() for after in lane.successors}


# --- lanes -------------------------------------------------------------------------------------------


def test_lanes_right_of_the_reference_line_run_along_it_and_those_left_of_it_against_it(tmp_path: Path) -> None:
    source = read(tmp_path, road("1", section(lane(1), lane(-1), lane(-2, width=3.0))))
    assert local(source.lanes["1/0/-2"].left) == [(0, -3.5), (100, -3.5)]
    assert local(source.lanes["1/0/-2"].right) == [(0, -6.5), (100, -6.5)]
    assert local(source.lanes["1/0/1"].left) == [(100, 0), (0, 0)]
    assert local(source.lanes["1/0/1"].right) == [(100, 3.5), (0, 3.5)]
    assert (source.lanes["1/0/-1"].right_neighbour, source.lanes["1/0/-1"].left_neighbour) == ("1/0/-2", None)
    assert (source.driving_side, source.crs, source.name) == ("right", UNPLACED_CRS, "town")


def test_left_hand_traffic_turns_both_round(tmp_path: Path) -> None:
    source = read(tmp_path, road("1", section(lane(1), lane(-1), lane(-2)), head='rule="LHT"'))
    assert source.driving_side == "left"
    assert local(source.lanes["1/0/1"].left) == [(0, 3.5), (100, 3.5)]
    assert local(source.lanes["1/0/-1"].right) == [(100, 0), (0, 0)]
    assert source.lanes["1/0/-1"].left_neighbour == "1/0/-2"


def test_offsets_and_widths_are_polynomials_from_their_stations_on(tmp_path: Path) -> None:
    offsets = cubic("laneOffset", "s", (0, 1.0)) + cubic("laneOffset", "s", (40, 1.0, 0.1))
    widths = [(0, 3.0), (20, 3.0, 0.0, 0.002, -1e-5)]
    lane_ = read(tmp_path, road("1", section(lane(-1, width=widths)), offsets=offsets)).lanes["1/0/-1"]
    assert local(lane_.left) == [(0, 1), (100, 7)]
    # Behind 80 m of the second polynomial it is 3 + 0.002 * 6400 - 1e-5 * 512000 = 10.68 m wide.
    assert local(lane_.right) == [(0, -2), (100, -3.68)]
    middle = lane_.left - UNPLACED_ORIGIN_M
    assert np.interp(40.0, middle[:, 0], middle[:, 1]) == pytest.approx(1.0)


def test_borders_stand_in_for_widths(tmp_path: Path) -> None:
    borders = [lane(id_, width=[], inner=cubic("border", "sOffset", (0, t))) for id_, t in ((-1, -3.0), (-2, -7.0))]
    source = read(tmp_path, road("1", section(*borders)))
    assert local(source.lanes["1/0/-2"].right) == [(0, -7), (100, -7)]
    assert local(source.lanes["1/0/-2"].left) == [(0, -3), (100, -3)]


def bordered(id_: int, *row: float) -> str:
    return lane(id_, width=[], inner=cubic("border", "sOffset", (0, *row)))


def test_borders_of_right_lanes_may_lie_to_the_left_of_the_reference_line(tmp_path: Path) -> None:
    middle = cubic("laneOffset", "s", (0, 4.5))
    source = read(tmp_path, road("1", section(bordered(-1, 1.0), bordered(-2, -2.5)), offsets=middle))
    assert local(source.lanes["1/0/-1"].right) == [(0, 1), (100, 1)]
    assert local(source.lanes["1/0/-2"].left) == [(0, 1), (100, 1)]
    assert local(source.lanes["1/0/-2"].right) == [(0, -2.5), (100, -2.5)]


def test_borders_that_are_written_without_a_sign_lie_on_the_side_of_their_lane(tmp_path: Path) -> None:
    opening = bordered(-2, 3.0, 0.04)
    source = read(tmp_path, road("1", section(bordered(1, 3.0), bordered(-1, 3.0), opening)))
    assert local(source.lanes["1/0/-1"].right) == [(0, -3), (45, -3)]
    assert local(source.lanes["1/0/-2:2"].right) == [(45, -4.8), (100, -7)]
    assert local(source.lanes["1/0/1"].right)[1] == (0, 3)


def test_a_lane_is_one_where_it_is_wide_enough_for_a_car(tmp_path: Path) -> None:
    opening = lane(-2, width=[(0, 0.0, 0.09), (40, 3.6)])
    source = read(tmp_path, road("1", section(lane(-1), opening)))
    assert set(source.lanes) == {"1/0/-1", "1/0/-1:2", "1/0/-2:2"}
    assert local(source.lanes["1/0/-2:2"].left)[0] == (20.0, -3.5)
    assert links(source) == {("1/0/-1", "1/0/-1:2")}
    assert source.reasons == {"end of a lane, too narrow for cars": 1}


def test_a_narrow_passage_between_two_lanes_stays(tmp_path: Path) -> None:
    pinch = lane(-1, width=[(0, 3.5), (40, 1.6), (60, 3.5)])
    assert links(read(tmp_path, road("1", section(pinch)))) == {("1/0/-1", "1/0/-1:2"), ("1/0/-1:2", "1/0/-1:3")}


def test_sections_of_one_side_leave_the_other_as_it_is(tmp_path: Path) -> None:
    sections = section(lane(1), lane(-1, after=(-2,))), section(lane(-1), lane(-2), s=60, one_side=True)
    source = read(tmp_path, road("1", *sections))
    assert set(source.lanes) == {"1/0/1", "1/0/-1", "1/1/-1", "1/1/-2"}
    assert local(source.lanes["1/0/1"].left) == [(100, 0), (0, 0)]
    assert links(source) == {("1/0/-1", "1/1/-2")}


@pytest.mark.parametrize("id_", [-1, 1])
def test_a_road_may_have_sections_of_one_side_only(tmp_path: Path, id_: int) -> None:
    sections = section(lane(id_, after=(id_,)), one_side=True), section(lane(id_), s=60, one_side=True)
    source = read(tmp_path, road("1", *sections))
    assert set(source.lanes) == {f"1/0/{id_}", f"1/1/{id_}"}
    assert len(links(source)) == 1


KINDS = ["shoulder", "sidewalk", "parking", "biking", "bus", "none"]


def test_what_is_no_lane_for_cars_is_left_out_with_its_reason(tmp_path: Path) -> None:
    strips = [lane(-2 - k, kind, 2.0) for k, kind in enumerate(KINDS)]
    source = read(tmp_path, road("1", section(lane(-1), *strips)))
    found = {item.reason: item.polygon is not None for item in source.left_out}
    assert found == {
        "shoulder": True, "sidewalk": False, "parking lane": True, "bicycle lane": True, "bus lane": True,
        "strip of no use": False,
    }  # fmt: skip
    assert [round(area.area) for area in (*source.walkways, *source.carparks)] == [200, 200]


@pytest.mark.parametrize("kind", ["driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "slipLane"])
def test_cars_drive_on_lanes_of_many_kinds(tmp_path: Path, kind: str) -> None:
    assert set(read(tmp_path, road("1", section(lane(-1, kind)))).lanes) == {"1/0/-1"}


@pytest.mark.parametrize(
    ("access", "reason"),
    [
        ('<access sOffset="0" rule="allow" restriction="bus"/>', "lane for bus only"),
        ('<access sOffset="0" rule="allow"><restriction type="bus"/></access>', "lane for bus only"),
        ('<access sOffset="0" rule="deny" restriction="passengerCar"/>', "lane closed to cars"),
        ('<access sOffset="0" rule="deny" restriction="truck"/>', None),
        ('<access sOffset="0" rule="allow" restriction="passengerCar"/>', None),
    ],
)
def test_access_closes_lanes(tmp_path: Path, access: str, reason: str | None) -> None:
    source = read(tmp_path, road("1", section(lane(-1), lane(-2, inner=access))))
    assert [item.reason for item in source.left_out] == ([] if reason is None else [reason])


def test_lanes_for_both_directions_are_split_where_there_is_room(tmp_path: Path) -> None:
    wide = read(tmp_path, road("1", section(lane(-1, "bidirectional", 6.0))))
    assert local(wide.lanes["1/0/-1"].left) == [(0, -3), (100, -3)]
    assert local(wide.lanes["1/0/-1:back"].right) == [(100, 0), (0, 0)]
    assert set(read(tmp_path, road("1", section(lane(-1, "bidirectional", 4.9)))).lanes) == {"1/0/-1"}
    between = read(tmp_path, road("1", section(lane(1), lane(-1, "bidirectional"), lane(-2))))
    assert between.reasons == {"lane for turning from both directions": 1}


# --- limits ------------------------------------------------------------------------------------------


def speed(max_: str, unit: str = "m/s") -> str:
    return f'<type s="0" type="town"><speed max="{max_}" unit="{unit}"/></type>'


@pytest.mark.parametrize(
    ("inner", "limit"),
    [
        (speed("25", "mph"), 25 * 0.44704),
        (speed("50", "km/h"), 50 / 3.6),
        (speed("13.9"), 13.9),
        (speed("no limit"), None),
        (speed("undefined"), None),
        (speed("0"), None),
        (speed("20", "furlongs"), None),
        ("", None),
    ],
)
def test_limits_are_those_of_the_road_in_their_unit(tmp_path: Path, inner: str, limit: float | None) -> None:
    assert read(tmp_path, road("1", inner=inner)).lanes["1/0/-1"].speed_limit_mps == (limit and pytest.approx(limit))


def test_the_limit_of_a_lane_overrules_and_cuts_it_where_it_begins(tmp_path: Path) -> None:
    slow = lane(-1, inner='<speed sOffset="60" max="30" unit="km/h"/>')
    source = read(tmp_path, road("1", section(slow), inner=speed("20")))
    limits = {id_: lane_.speed_limit_mps for id_, lane_ in source.lanes.items()}
    assert limits == {"1/0/-1": 20.0, "1/0/-1:2": pytest.approx(30 / 3.6)}
    assert local(source.lanes["1/0/-1:2"].left)[0] == (60, 0)


LIMIT = 'dynamic="no" orientation="{}" value="{}" unit="{}"'


def signed(*signs: str, sections: str = section(lane(1), lane(-1))) -> str:
    """A road with a limit of 50 km/h and signs."""
    return road("1", sections, inner=speed("50", "km/h") + f"<signals>{''.join(signs)}</signals>")


def limits_kmh(source: SourceMap) -> dict[str, int]:
    return {id_: round(3.6 * (lane_.speed_limit_mps or 0.0)) for id_, lane_ in source.lanes.items()}


def test_a_sign_overrules_the_limit_of_the_road_from_where_it_stands_in_its_direction(tmp_path: Path) -> None:
    source = read(tmp_path, signed(signal("a", 20, "274", LIMIT.format("+", "3.0e+01", "km/h"))))
    assert limits_kmh(source) == {"1/0/-1": 50, "1/0/-1:2": 30, "1/0/1": 50, "1/0/1:2": 50}
    assert local(source.lanes["1/0/-1:2"].left)[0] == (20, 0)
    against = read(tmp_path, signed(signal("a", 20, "R2-1", LIMIT.format("-", "25", "mph"))))
    assert limits_kmh(against) == {"1/0/-1": 50, "1/0/-1:2": 50, "1/0/1": 40, "1/0/1:2": 50}


def test_a_sign_holds_up_to_the_next_one_or_to_the_end_of_its_limit(tmp_path: Path) -> None:
    signs = [signal(str(s), s, "274", LIMIT.format("+", limit, "")) for s, limit in ((20, 30), (60, 70))]
    end = signal("end", 80, "278", 'dynamic="no" orientation="none"')
    source = read(tmp_path, signed(*signs, end, sections=section(lane(-1))))
    assert [limits_kmh(source)[f"1/0/-1{piece}"] for piece in ("", ":2", ":3", ":4")] == [50, 30, 70, 50]


def test_of_signs_at_one_place_the_lowest_limit_holds_whatever_their_order(tmp_path: Path) -> None:
    signs = [signal(str(limit), 20, "274", LIMIT.format("+", limit, "km/h")) for limit in (30, 40)]
    signs.append(signal("end", 20, "278", 'dynamic="no" orientation="+"'))
    for order in (signs, signs[::-1]):
        assert limits_kmh(read(tmp_path, signed(*order, sections=section(lane(-1)))))["1/0/-1:2"] == 30


def test_a_sign_that_says_no_direction_holds_in_both(tmp_path: Path) -> None:
    for orientation in ("", "none"):
        both = signal("a", 20, "274", LIMIT.format(orientation, 30, "km/h"))
        assert limits_kmh(read(tmp_path, signed(both))) == {"1/0/-1": 50, "1/0/-1:2": 30, "1/0/1": 30, "1/0/1:2": 50}


def test_a_sign_for_one_lane_leaves_the_others_as_they_are(tmp_path: Path) -> None:
    named = signal("a", 0, "274", LIMIT.format("+", 30, "km/h"), '<validity fromLane="-2" toLane="-2"/>')
    assert limits_kmh(read(tmp_path, signed(named, sections=section(lane(-1), lane(-2))))) == {
        "1/0/-1": 50, "1/0/-2": 30,
    }  # fmt: skip


def test_a_reference_to_a_sign_holds_where_it_stands(tmp_path: Path) -> None:
    origin = signal("a", 0, "274", LIMIT.format("+", 30, "km/h"), '<validity fromLane="0" toLane="0"/>')
    reference = '<signalReference id="a" s="60" t="0" orientation="+"/>'
    source = read(tmp_path, signed(origin, reference, sections=section(lane(-1))))
    assert limits_kmh(source) == {"1/0/-1": 50, "1/0/-1:2": 30}


def test_what_a_file_says_that_a_sign_means_is_its_limit(tmp_path: Path) -> None:
    said = '<semantics><speed type="maximum" value="10" unit="m/s"/></semantics>'
    sign = signal("a", 0, "C14", 'dynamic="no" orientation="+"', said)
    assert limits_kmh(read(tmp_path, signed(sign, sections=section(lane(-1))))) == {"1/0/-1": 36}


@pytest.mark.parametrize("more", ['dynamic="no"', LIMIT.format("+", "-1", "km/h"), 'dynamic="yes" value="30"'])
def test_signs_that_tell_no_limit_are_noted(tmp_path: Path, more: str) -> None:
    source = read(tmp_path, signed(signal("a", 50, "274", more), sections=section(lane(-1))))
    assert limits_kmh(source) == {"1/0/-1": 50}
    assert any(note.startswith("1 signs of speed limits do not tell one") for note in source.notes)


def test_the_limits_of_a_real_file_are_those_of_its_signs() -> None:
    limits = limits_kmh(read_opendrive(real("opendrive", "multi_intersections.xodr")))
    assert {id_: limit for id_, limit in limits.items() if limit} == {"242/0/-1:2": 70, "242/0/1": 50}


# --- links -------------------------------------------------------------------------------------------


def test_roads_join_end_to_start_and_end_to_end(tmp_path: Path) -> None:
    on = geometry(place=(100, 0, 0))
    against = geometry(place=(300, 0, np.pi))
    pair = section(lane(1, before=(1,), after=(-1,)), lane(-1, before=(-1,), after=(1,)))
    source = read(
        tmp_path,
        road("a", section(lane(1, after=(1,)), lane(-1, after=(-1,))), links=("", to_road("b"))),
        road("b", pair, plan=on, links=(to_road("a", "end"), to_road("c", "end"))),
        road("c", section(lane(1), lane(-1)), plan=against, links=("", to_road("b", "end"))),
    )
    assert links(source) == {
        ("a/0/-1", "b/0/-1"), ("b/0/1", "a/0/1"), ("b/0/-1", "c/0/1"), ("c/0/-1", "b/0/1"),
    }  # fmt: skip


def test_a_junction_joins_its_connecting_roads_which_are_the_intersection(tmp_path: Path) -> None:
    source = read(tmp_path, crossing())
    assert links(source) == {
        ("1/0/-1", "13/0/-1"), ("13/0/-1", "3/0/-1"), ("1/0/-1", "14/0/-1"), ("14/0/-1", "4/0/-1"),
    }  # fmt: skip
    assert {id_ for id_, lane_ in source.lanes.items() if lane_.in_intersection} == {"13/0/-1", "14/0/-1"}


@pytest.mark.parametrize(("length", "inside"), [(LONGEST_CROSSING_M, True), (LONGEST_CROSSING_M + 1.0, False)])
def test_a_long_way_through_a_junction_is_a_ramp(tmp_path: Path, length: float, inside: bool) -> None:
    source = read(tmp_path, road("1", plan=geometry(length=length), head='junction="9"'), '<junction id="9"/>')
    assert source.lanes["1/0/-1"].in_intersection is inside


def test_connections_without_lane_links_take_the_lanes_own(tmp_path: Path) -> None:
    bare = crossing().replace('<laneLink from="-1" to="-1"/>', "")
    assert links(read(tmp_path, bare)) == links(read(tmp_path, crossing()))


def test_a_direct_junction_joins_roads_without_ways_between(tmp_path: Path) -> None:
    text = (
        road("1", section(lane(-1), lane(-2)), links=("", to_junction("9"))),
        road("2", plan=geometry(place=(100, 0, 0)), links=(to_junction("9"), "")),
        road("3", plan=geometry(place=(100, -3.5, 0)), links=(to_junction("9"), "")),
        '<junction id="9" type="direct">'
        + connection("1", "2", (-1, -1), key="linkedRoad")
        + connection("1", "3", (-2, -1), key="linkedRoad")
        + "</junction>",
    )
    assert links(read(tmp_path, *text)) == {("1/0/-1", "2/0/-1"), ("1/0/-2", "3/0/-1")}


def test_a_virtual_junction_joins_the_middle_of_its_road(tmp_path: Path) -> None:
    """A driveway that leaves road 1 at 40 m, by way of 7."""
    from_1 = 'elementType="road" elementId="1" elementS="40" elementDir="+"'
    way = road(
        "7", section(lane(-1, before=(-1,), after=(-1,))), plan=geometry('<arc curvature="-0.1"/>', 10, 0, (40, 0, 0)),
        head='junction="9"', links=(from_1, to_road("8")),
    )  # fmt: skip
    drive = road("8", plan=geometry(length=20, place=(48.4147, -4.597, -1)))
    junction = f'<junction id="9" type="virtual" mainRoad="1">{connection("1", "7", (-1, -1))}</junction>'
    source = read(tmp_path, road("1"), way, drive, junction)
    assert links(source) == {("1/0/-1", "1/0/-1:2"), ("1/0/-1", "7/0/-1"), ("7/0/-1", "8/0/-1")}


def test_what_is_too_short_is_passed_over_and_links_lead_on(tmp_path: Path) -> None:
    mid = section(lane(-1, before=(-1,), after=(-1,)), s=50)
    last = section(lane(-1, before=(-1,)), s=50.01)
    source = read(tmp_path, road("1", section(lane(-1, after=(-1,))), mid, last))
    assert links(source) == {("1/0/-1", "1/2/-1")}


def test_links_to_nowhere_and_against_the_traffic_are_told(tmp_path: Path) -> None:
    wrong = road("2", plan=geometry(place=(100, 0, 0)), links=(to_road("1", "end"), ""))
    source = read(tmp_path, road("1", section(lane(1, after=(-1, -7))), links=("", to_road("2"))), wrong)
    assert links(source) == set()
    assert any("1 links lead to roads or lanes that the file lacks" in note for note in source.notes)
    assert any("1 links join lanes that run against each other" in note for note in source.notes)


# --- lights, signs, objects --------------------------------------------------------------------------


def equipped(*signals: str) -> str:
    return f"<signals>{''.join(signals)}</signals>"


def lights(source: SourceMap) -> dict[str, tuple[tuple[str, ...], tuple[str, ...]]]:
    held = {id_: (lane_.lights_at_start, lane_.lights_at_end) for id_, lane_ in source.lanes.items()}
    return {id_: both for id_, both in held.items() if any(both)}


def test_a_light_before_a_junction_holds_at_the_end_of_the_lanes_that_come_to_it(tmp_path: Path) -> None:
    assert lights(read(tmp_path, crossing(west=equipped(signal("s", 98))))) == {"1/0/-1": ((), ("s",))}


def test_a_light_on_a_way_through_the_junction_holds_for_that_way(tmp_path: Path) -> None:
    there = '<validity fromLane="0" toLane="0"/>'
    reference = (
        '<signalReference id="s" s="1" t="0" orientation="-"><validity fromLane="-1" toLane="-1"/></signalReference>'
    )
    parts = crossing(west=equipped(signal("s", 98, inner=there)), ahead=equipped(reference))
    assert lights(read(tmp_path, parts)) == {"13/0/-1": (("s",), ())}


def test_a_light_far_from_any_junction_holds_where_it_stands(tmp_path: Path) -> None:
    source = read(tmp_path, road("1", section(lane(1), lane(-1)), inner=equipped(signal("s", 50))))
    assert lights(source) == {"1/0/-1": ((), ("s",))}
    assert local(source.lanes["1/0/-1"].left)[1] == (50, 0)


@pytest.mark.parametrize(
    ("given", "lit"),
    [
        (signal("s", 98, "1000002"), False),
        (signal("s", 98, "1.000.011"), True),
        (signal("s", 98, more='dynamic="no"'), False),
        (signal("s", 98, "274"), False),
        (signal("s", 98, "", more="", inner='<semantics><priority type="trafficLight"/></semantics>'), True),
        (signal("s", 98, inner='<validity fromLane="-5" toLane="-2"/>'), False),
    ],
)
def test_only_lights_for_cars_are_lights(tmp_path: Path, given: str, lit: bool) -> None:
    assert bool(lights(read(tmp_path, crossing(west=equipped(given))))) is lit


@pytest.mark.parametrize(
    ("kind", "sign"), [("206", StopLineKind.STOP_SIGN), ("205", StopLineKind.YIELD), ("274", None), ("R1-1", 1)]
)
def test_signs_before_a_junction(tmp_path: Path, kind: str, sign: StopLineKind | None) -> None:
    source = read(tmp_path, crossing(west=equipped(signal("s", 95, kind, 'dynamic="no" orientation="+"'))))
    assert source.lanes["1/0/-1"].sign_at_end == sign


def test_a_stop_sign_far_from_the_end_of_its_road_is_noted(tmp_path: Path) -> None:
    def notes(station_m: float) -> list[str]:
        sign = signal("s", station_m, "206", 'dynamic="no" orientation="+"')
        return [note for note in read(tmp_path, crossing(west=equipped(sign))).notes if "yield signs" in note]

    assert notes(59) == ["1 stop and yield signs hold at no end of a road for cars, such as s."]
    assert notes(61) == []


def test_stop_lines_lie_across_the_lanes_and_take_their_kind_from_what_stands_there(tmp_path: Path) -> None:
    line = signal("l", 99, "294", 'dynamic="no" orientation="+"')
    (drawn,) = read(tmp_path, crossing(west=equipped(signal("s", 98), line))).stop_lines
    assert (drawn.kind, drawn.lane_ids) == (StopLineKind.TRAFFIC_LIGHT, ("1/0/-1",))
    assert sorted(local(drawn.points)) == [(99, -3.5), (99, 0)]


BAND = '<object id="m" name="{}" type="roadMark" subtype="{}" s="98" t="-1.75" {} length="0.4" width="3.4"/>'


@pytest.mark.parametrize(("name", "subtype"), [("", "signalLines"), ("Solid Stop Line", "")])
def test_stop_lines_that_are_objects_lie_across_the_lanes_that_they_cover(
    tmp_path: Path, name: str, subtype: str
) -> None:
    objects = f"<objects>{BAND.format(name, subtype, '')}</objects>"
    (drawn,) = read(tmp_path, crossing(west=equipped(signal("s", 95, "206", 'dynamic="no"')) + objects)).stop_lines
    assert (drawn.kind, drawn.lane_ids) == (StopLineKind.STOP_SIGN, ("1/0/-1",))
    assert sorted(local(drawn.points)) == [(98, -3.45), (98, -0.05)]


def test_marks_that_are_no_stop_lines_or_cover_no_lane_of_their_direction_are_none(tmp_path: Path) -> None:
    marks = BAND.format("", "arrowLeft", ""), BAND.format("", "stopLine", 'orientation="-"')
    assert read(tmp_path, crossing(west=f"<objects>{''.join(marks)}</objects>")).stop_lines == ()


def test_a_stop_line_is_drawn_once_where_signal_and_object_tell_of_it(tmp_path: Path) -> None:
    line = equipped(signal("l", 99, "294", 'dynamic="no" orientation="+"'))
    objects = f"<objects>{BAND.format('', 'stopLine', '')}</objects>"
    (drawn,) = read(tmp_path, crossing(west=line + objects)).stop_lines
    assert drawn.id == "l"


def test_crosswalks_and_parking_spaces(tmp_path: Path) -> None:
    corners = "".join(f'<cornerRoad s="{s}" t="{t}"/>' for s, t in ((50, -4), (53, -4), (53, 4), (50, 4)))
    local_corners = "".join(f'<cornerLocal u="{u}" v="{v}"/>' for u, v in ((-2, -1), (2, -1), (2, 1), (-2, 1)))
    objects = (
        '<objects><object id="1" type="crosswalk" s="50" t="0">'
        f"<outlines><outline>{corners}</outline></outlines></object>"
        f'<object id="2" type="crosswalk" s="70" t="0" hdg="1.5708"><outline>{local_corners}</outline></object>'
        '<object id="3" type="parkingSpace" s="10" t="5" length="5" width="2">'
        '<repeat s="10" length="12" distance="6" tStart="5" tEnd="5"/></object>'
        '<object id="4" type="tree" s="10" t="5" length="5" width="2"/></objects>'
    )
    source = read(tmp_path, road("1", inner=objects))
    moved = [np.array(shape.bounds) - [*UNPLACED_ORIGIN_M] * 2 for shape in (*source.crosswalks, *source.carparks)]
    assert np.round(np.array(moved), 3).tolist() == [
        [50, -4, 53, 4], [69, -2, 71, 2], [7.5, 4, 12.5, 6], [13.5, 4, 18.5, 6], [19.5, 4, 24.5, 6],
    ]  # fmt: skip


# --- where it lies -----------------------------------------------------------------------------------


def test_the_georeference_and_the_offset_place_the_map(tmp_path: Path) -> None:
    header = (
        "<header><geoReference><![CDATA[+proj=utm +zone=32 +ellps=WGS84]]></geoReference>"
        '<offset x="692000" y="5337000" z="0" hdg="1.5707963267948966"/></header>'
    )
    source = read(tmp_path, road("1"), header=header)
    assert source.crs == "EPSG:32632"
    assert np.round(source.lanes["1/0/-1"].left[[0, -1]], 3).tolist() == [[692000, 5337000], [692000, 5337100]]


@pytest.mark.parametrize("reference", ["+proj=tmerc +lat_0=0 +lon_0=0", "nonsense", ""])
def test_a_georeference_that_leads_nowhere_is_told(tmp_path: Path, reference: str) -> None:
    source = read(tmp_path, road("1"), header=f"<header><geoReference>{reference}</geoReference></header>")
    assert source.crs == UNPLACED_CRS
    assert any("place that stands in" in note for note in source.notes)


def test_a_namespace_changes_nothing(tmp_path: Path) -> None:
    text = xodr(road("1"), root='OpenDRIVE xmlns="http://code.asam.net/simulation/standard/opendrive_schema"')
    assert set(read_opendrive(written(tmp_path, text)).lanes) == {"1/0/-1"}
