"""The rules in Lanelet2 files: speed limits, lights, signs and stop lines, and at which lanes they hold."""

from __future__ import annotations

from pathlib import Path

import pytest

from interplan_sumo.maps.importers.lanelet2.count import count_lanelet2
from interplan_sumo.maps.importers.lanelet2.limits import sign_mps, speed_mps
from interplan_sumo.world.roads import StopLineKind
from tests.maps.lanelet2_files import Osm, read
from tests.maps.source_worlds import assert_as_counted

KMH = 1.0 / 3.6


# --- speed limits ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "mps"),
    [
        ("50", 50 * KMH),
        ("50 km/h", 50 * KMH),
        ("50km/h", 50 * KMH),
        ("50.00", 50 * KMH),
        ("13,9 m/s", 13.9),
        ("30 mph", 30 * 0.44704),
        ("8.3 mps", 8.3),
        ("0", None),
        ("-5", None),
        ("walk", None),
        ("50 knots", None),
        ("", None),
    ],
)
def test_speeds_with_and_without_a_unit(text: str, mps: float | None) -> None:
    assert speed_mps(text) == pytest.approx(mps)


@pytest.mark.parametrize(
    ("sign", "kmh"),
    [("de274-60", 60), ("DE274-60", 60), ("de274.1", 30), ("de274_1", 30), ("de274.1-20", 20), ("de310", 50),
     ("de325.1", 7), ("speed_limit_40", 40), ("30 km/h", 30), ("de205", None), ("de274", None), ("de274.2-20", None),
     ("stop", None)],
)  # fmt: skip
def test_signs_that_set_a_limit(sign: str, kmh: float | None) -> None:
    assert sign_mps(sign) == (None if kmh is None else pytest.approx(kmh * KMH))


LIMITS = {
    "a tag": ({"speed_limit": "40"}, {}, 40),
    "a tag for cars": ({"speed_limit": "40", "speed_limit:vehicle:car": "60"}, {}, 60),
    "a rule": ({"speed_limit": "40"}, {"sign_type": "70 km/h"}, 70),
    "a sign": ({"speed_limit": "40"}, {"sign": "de274-20"}, 20),
    "a rule without a speed": ({"speed_limit": "40"}, {"sign_type": "de205"}, 40),
    "a town": ({"location": "urban"}, {}, 50),
    "nothing": ({}, {}, 50),
    "the country": ({"location": "nonurban"}, {}, 100),
    "a motorway": ({"subtype": "highway", "location": "nonurban"}, {}, 130),
    "a play street": ({"subtype": "play_street"}, {}, 7),
    "another country": ({"region": "us"}, {}, None),
    "a tag that is none": ({"speed_limit": "fast"}, {}, 50),
}


@pytest.mark.parametrize("name", LIMITS)
def test_speed_limits_come_from_rules_then_tags_then_the_law(name: str, file: Path) -> None:
    tags, rule, kmh = LIMITS[name]
    osm = Osm()
    rules: list[int] = []
    if rule:
        sign = osm.way((0.0, 5.0), (0.0, 6.0), type="traffic_sign", subtype=rule.get("sign", ""))
        rules = [osm.rule("speed_limit", ("way", sign, "refers"), sign_type=rule.get("sign_type", ""))]
    lane = osm.straight(0.0, 40.0, tags=tags, rules=rules)
    source = read(osm, file)
    found = source.lanes[lane].speed_limit_mps
    assert found == (None if kmh is None else pytest.approx(kmh * KMH))
    assert_as_counted(source, count_lanelet2(file))
    assert any("'fast'" in note for note in source.notes) == (name == "a tag that is none")


def test_a_note_tells_where_the_limits_come_from(osm: Osm, file: Path) -> None:
    osm.straight(0.0, 40.0, tags={"speed_limit": "30"})
    osm.straight(0.0, 40.0, -9.0)
    osm.straight(0.0, 40.0, -19.0, tags={"region": "jp"})
    assert any(
        note.startswith("Speed limits: 1 lanelets have one in the file, 1 the one that") and note.endswith("1 none.")
        for note in read(osm, file).notes
    )


# --- lights, signs and stop lines ------------------------------------------------------------------------


def junction(line_m: float | None, rule: str = "traffic_light", inside_tags: dict[str, str] | None = None) -> Osm:
    """Lanelets 2 and 3 lead into lanelet 4, which names a rule, with its line across x = `line_m`."""
    osm = Osm(next_id=1)
    osm.straight(0.0, 20.0)
    members = [("way", osm.way((50.0, 1.0), (50.0, 2.0), type="traffic_light"), "refers")]
    if line_m is not None:
        members.append(("way", osm.way((line_m, 0.0), (line_m, -3.0), type="stop_line"), "ref_line"))
    light = osm.relation(members, {"type": "regulatory_element", "subtype": rule}, id_=900)
    osm.straight(20.0, 40.0, rules=[light], tags=inside_tags)
    return osm


@pytest.mark.parametrize(
    ("line_m", "tags", "at_start"),
    [
        (20.0, {}, True),
        (40.0, {}, False),
        (29.0, {}, True),
        (31.0, {}, False),
        (None, {}, False),
        (None, {"turn_direction": "left"}, True),
        (40.0, {"turn_direction": "left"}, False),
    ],
)
def test_a_light_holds_at_the_end_where_its_stop_line_is(
    line_m: float | None, tags: dict[str, str], at_start: bool, file: Path
) -> None:
    source = read(junction(line_m, inside_tags=tags), file)
    lane = source.lanes["3"]
    assert lane.lights_at_start == (("10002",) if at_start else ())
    assert lane.lights_at_end == (() if at_start else ("10002",))
    if line_m is not None:
        (line,) = source.stop_lines
        assert (line.kind, line.lane_ids) == (StopLineKind.TRAFFIC_LIGHT, ("2" if at_start else "3",))
    assert_as_counted(source, count_lanelet2(file))


def test_a_stop_line_at_the_start_of_an_intersection_lane_names_that_lane(file: Path) -> None:
    source = read(junction(20.0, inside_tags={"turn_direction": "left"}), file)
    assert source.stop_lines[0].lane_ids == ("3",)


def test_a_light_at_the_start_of_a_split_lanelet_holds_for_the_way_back(osm: Osm, file: Path) -> None:
    line = osm.way((0.0, 0.0), (0.0, -3.0))
    light = osm.rule("traffic_light", ("way", osm.way((-9.0, 0.0), (-9.0, 1.0)), "refers"), ("way", line, "ref_line"))
    road = osm.straight(0.0, 40.0, 0.0, 6.0, tags={"one_way": "no"}, rules=[light])
    source = read(osm, file)
    assert source.lanes[f"{road}:back"].lights_at_end
    assert not source.lanes[road].lights_at_end
    assert_as_counted(source, count_lanelet2(file))


def test_a_light_without_lamps_still_is_one(osm: Osm, file: Path) -> None:
    light = osm.rule("traffic_light")
    lane = osm.straight(0.0, 40.0, rules=[light])
    assert read(osm, file).lanes[lane].lights_at_end == (str(light),)


@pytest.mark.parametrize(
    ("subtype", "sign", "line", "kind"),
    [
        ("right_of_way", None, {}, StopLineKind.YIELD),
        ("right_of_way", "de205", {}, StopLineKind.YIELD),
        ("right_of_way", "de206", {}, StopLineKind.STOP_SIGN),
        ("right_of_way", None, {"subtype": "stop_sign"}, StopLineKind.STOP_SIGN),
        ("all_way_stop", None, {}, StopLineKind.STOP_SIGN),
        ("traffic_sign", "stop_sign", {}, StopLineKind.STOP_SIGN),
        ("traffic_sign", "de205", {}, StopLineKind.YIELD),
        ("traffic_sign", "no_parking", {}, None),
    ],
)
def test_signs_hold_at_the_end_of_the_lanes_that_wait(
    subtype: str, sign: str | None, line: dict[str, str], kind: StopLineKind | None, file: Path
) -> None:
    osm = Osm(next_id=1)
    members = [("way", osm.way((40.0, 0.0), (40.0, -3.0), type="stop_line", **line), "ref_line")]
    if sign is not None:
        members.append(("way", osm.way((40.0, 3.0), (40.0, 4.0), type="traffic_sign", subtype=sign), "refers"))
    members.append(("relation", 2, "yield"))
    rule = osm.relation(members, {"type": "regulatory_element", "subtype": subtype}, id_=900)
    waiting = osm.straight(0.0, 40.0, rules=[rule])
    other = osm.straight(0.0, 40.0, -30.0, rules=[rule] if subtype != "traffic_sign" else [])
    source = read(osm, file)
    assert source.lanes[waiting].sign_at_end == kind
    assert source.lanes[other].sign_at_end is None
    (stop,) = source.stop_lines
    assert stop.kind == (StopLineKind.UNKNOWN if kind is None else kind)
    assert stop.lane_ids == (() if kind is None else (waiting,))


def test_a_sign_at_the_start_of_a_lanelet_holds_for_those_that_lead_to_it(file: Path) -> None:
    osm = junction(20.0, rule="all_way_stop")
    osm.members[900].append(("relation", 3, "yield"))
    source = read(osm, file)
    assert source.lanes["2"].sign_at_end == StopLineKind.STOP_SIGN
    assert source.lanes["3"].sign_at_end is None


def test_a_sign_beside_a_light_counts_only_while_that_is_out(file: Path) -> None:
    osm = junction(20.0)
    osm.rule("right_of_way", ("relation", 2, "yield"), fallback="yes")
    source = read(osm, file)
    assert source.lanes["2"].sign_at_end is None
    assert any("1 lanes have a sign that counts only while" in note for note in source.notes)


def test_stop_lines_that_no_rule_names_are_kept(osm: Osm, file: Path) -> None:
    osm.straight(0.0, 40.0)
    line = osm.way((30.0, 0.0), (30.0, -3.0), type="stop_line")
    (stop,) = read(osm, file).stop_lines
    assert (stop.id, stop.kind, stop.lane_ids) == (str(line), StopLineKind.UNKNOWN, ())


def test_lanes_wait_at_a_crosswalk_that_they_name(osm: Osm, file: Path) -> None:
    line = osm.way((30.0, 0.0), (30.0, -3.0), type="stop_line")
    walk = osm.lanelet([(32.0, 0.0), (32.0, -3.0)], [(31.0, 0.0), (31.0, -3.0)], tags={"subtype": "crosswalk"})
    rule = osm.rule("crosswalk", ("relation", int(walk), "refers"), ("way", line, "ref_line"))
    lane = osm.straight(0.0, 40.0, rules=[rule])
    source = read(osm, file)
    (stop,) = source.stop_lines
    assert (stop.kind, stop.lane_ids) == (StopLineKind.PEDESTRIAN_CROSSING, (lane,))
    assert len(source.crosswalks) == 1


def test_right_of_way_says_who_yields_to_whom(file: Path) -> None:
    osm = Osm(next_id=1)
    waiting, behind = osm.straight(0.0, 40.0), osm.straight(40.0, 60.0)
    going, on = osm.straight(0.0, 40.0, -30.0), osm.straight(40.0, 60.0, -30.0)
    members = ("relation", int(waiting), "yield"), ("relation", int(going), "right_of_way")
    osm.rule("right_of_way", *members)
    (junction,) = read(osm, file).junctions
    assert [way.lanes for way in junction.ways] == [(waiting, behind), (going, on)]
    assert (junction.yields, junction.foes) == ({(0, 1)}, None)


def test_lanelets_that_elements_make_yield_to_each_other_are_left_to_geometry_and_a_note_says_so(file: Path) -> None:
    osm = Osm(next_id=1)
    one, _ = osm.straight(0.0, 40.0), osm.straight(40.0, 60.0)
    other, _ = osm.straight(0.0, 40.0, -30.0), osm.straight(40.0, 60.0, -30.0)
    third, _ = osm.straight(0.0, 40.0, -60.0), osm.straight(40.0, 60.0, -60.0)
    for waiting, going in (((one, third), other), ((other,), one)):
        members = [("relation", int(id_), "yield") for id_ in waiting]
        osm.rule("right_of_way", *members, ("relation", int(going), "right_of_way"))
    source = read(osm, file)
    (junction,) = source.junctions
    assert {tuple(junction.ways[k].lanes[0] for k in pair) for pair in junction.yields} == {(third, other)}
    said = "1 pair of lanelets yield to each other by right_of_way elements"
    assert f"{said}, such as {one} and {other}: signs and geometry decide there." in source.notes
