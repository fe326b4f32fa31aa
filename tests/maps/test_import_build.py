"""A foreign map in nuPlan's terms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.errors import MapError
from interplan_sumo.maps.check import check_map
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.maps.importers.build import build
from interplan_sumo.maps.importers.fidelity import compare, count_of
from interplan_sumo.maps.importers.record import ImportRecord, read_record
from interplan_sumo.maps.importers.source import LeftOut, SourceCount, SourceMap, SourceStopLine
from interplan_sumo.maps.rules import schema_problems
from interplan_sumo.maps.store import MapFiles
from interplan_sumo.maps.to_sumo import convert
from interplan_sumo.world.roads import IntersectionKind, Roads, StopLineKind, Turn
from tests.maps.source_worlds import (
    WIDTH_M,
    crossing,
    fork,
    junction_with_flags,
    lane,
    line,
    linked,
    neighbours,
    road_of_two,
    straight,
    world,
)

WORLDS = {
    "a road of two lanes": road_of_two(),
    "a fork": fork(),
    "a crossing": crossing(),
    "an intersection with flags": junction_with_flags(),
}


def lane_from(roads: Roads, origins: object, source_id: str) -> str:
    """The lane (not connector) of the map that holds a lane of the file."""
    (found,) = (k for k, rows in origins.items() if k in roads.lanes and source_id in {r.source_id for r in rows})  # type: ignore[attr-defined]
    return found


def record_of(source: SourceMap) -> tuple[Roads, ImportRecord]:
    made = build(source)
    return made.roads, ImportRecord("tiny", "0", "hand", made.origins, made.left_out, made.notes)


@pytest.mark.parametrize("source", WORLDS.values(), ids=WORLDS)
def test_nothing_is_lost_nuplan_can_use_it_and_its_network_follows_it(source: SourceMap, tmp_path: Path) -> None:
    roads, record = record_of(source)
    assert compare(roads, record, source, None).problems == ()
    files = MapFiles("tiny", "1.0", tmp_path)
    write_map(roads, files.gpkg)
    roads = read_map(files.gpkg, "tiny")
    convert(roads, files.folder)
    assert check_map(files, roads).problems == ()  # nuPlan's rules among them


def test_parallel_lanes_are_one_roadblock_from_left_to_right() -> None:
    made = build(road_of_two())
    (block,) = made.roads.roadblocks.values()
    left, right = (made.roads.lanes[id_] for id_ in block.lane_ids)
    assert [o.source_id for o in made.origins[left.id]] == ["a1", "a2"]
    assert made.roads.right_of(left.id) is right
    assert left.polygon.area == pytest.approx(120.0 * WIDTH_M, rel=1e-6)


def test_connectors_of_an_intersection_join_the_lanes_of_the_file() -> None:
    made = build(junction_with_flags())
    roads = made.roads
    before = lane_from(roads, made.origins, "in")
    ways = {roads.connectors[c].turn: roads.connectors[c] for c in roads.outgoing(before)}
    assert set(ways) == {Turn.STRAIGHT, Turn.RIGHT}
    assert ways[Turn.STRAIGHT].to_lane_id == lane_from(roads, made.origins, "out")
    assert ways[Turn.RIGHT].to_lane_id == lane_from(roads, made.origins, "side")
    assert [o.source_id for o in made.origins[ways[Turn.RIGHT].id]] == ["turn"]
    assert ways[Turn.RIGHT].speed_limit_mps == 8.0
    (place,) = roads.intersections
    assert place.kind is IntersectionKind.LANE_BRANCH
    assert {roads.roadblocks[c.roadblock_id].intersection_id for c in ways.values()} == {place.id}


def test_streets_that_cross_meet_in_one_intersection() -> None:
    roads = build(crossing()).roads
    (place,) = roads.intersections
    assert place.kind is IntersectionKind.DEFAULT
    assert len(roads.connectors) == 2
    assert all(place.polygon.buffer(0.1).contains(c.polygon) for c in roads.connectors.values())


def test_a_gap_is_drawn_over_with_a_curve() -> None:
    lanes = linked([straight("a", 0, 50), lane("b", ((70.0, 12.0), (70.0, 60.0)))], [("a", "b")])
    roads = build(world(lanes)).roads
    (way,) = roads.connectors.values()
    assert way.turn is Turn.LEFT
    assert way.centerline.length_m > 20.0
    headings = way.centerline.segment_heading_rad
    assert headings[0] == pytest.approx(0.0, abs=0.1)
    assert headings[-1] == pytest.approx(np.pi / 2.0, abs=0.1)


@pytest.mark.parametrize(("gap_m", "kept"), [(79.0, True), (81.0, False)])
def test_no_way_is_drawn_over_a_wide_gap(gap_m: float, kept: bool) -> None:
    lanes = linked([straight("a", 0, 50), straight("b", 50 + gap_m, 200)], [("a", "b")])
    made = build(world(lanes))
    assert bool(made.roads.connectors) == kept
    told = [note for note in made.notes if "the link from a to b is left out" in note]
    assert bool(told) != kept


def test_a_link_to_a_lane_that_leads_back_from_the_same_place_is_no_way() -> None:
    """It would lead out and straight back by decimetres."""
    lanes = linked(
        [straight("a", 0.0, 50.0), straight("b", 50.0, 0.0), straight("c", 50.0, 100.0)], [("a", "b"), ("a", "c")]
    )
    made = build(world(lanes))
    assert len(made.roads.lanes) == 3
    (way,) = made.roads.connectors.values()
    assert way.to_lane_id == lane_from(made.roads, made.origins, "c")


def test_a_light_at_the_end_of_a_lane_holds_for_all_that_leave_it() -> None:
    source = junction_with_flags()
    lit = replace(source, lanes={**source.lanes, "in": replace(source.lanes["in"], lights_at_end=("7",))})
    roads, record = record_of(lit)
    lines = {c.stop_line_ids for c in roads.connectors.values()}
    assert len(lines) == 1
    ((name,),) = lines
    stop = roads.stop_lines[name]
    assert stop.kind is StopLineKind.TRAFFIC_LIGHT
    assert stop.polygon.intersects(shapely.Point(*line((50.0, 0.0))[0]))
    assert roads.intersections[0].kind is IntersectionKind.TRAFFIC_LIGHT
    assert compare(roads, record, lit, None).problems == ()


def test_a_light_at_the_start_of_a_lane_in_an_intersection_holds_for_that_way_only() -> None:
    source = junction_with_flags()
    lit = replace(source, lanes={**source.lanes, "turn": replace(source.lanes["turn"], lights_at_start=("7",))})
    roads = build(lit).roads
    assert {c.turn: c.has_traffic_light for c in roads.connectors.values()} == {Turn.STRAIGHT: False, Turn.RIGHT: True}


@pytest.mark.parametrize("kind", [StopLineKind.STOP_SIGN, StopLineKind.YIELD])
@pytest.mark.parametrize("by_line", [True, False])
def test_signs_stand_at_the_end_of_their_lane(kind: StopLineKind, by_line: bool) -> None:
    source = junction_with_flags()
    if by_line:
        drawn = SourceStopLine("s", line((49.0, 1.7), (49.0, -1.7)), kind, ("in",))
        source = replace(source, stop_lines=(drawn,))
    else:
        source = replace(source, lanes={**source.lanes, "in": replace(source.lanes["in"], sign_at_end=kind)})
    roads = build(source).roads
    (stop,) = roads.stop_lines.values()
    assert stop.kind is kind
    assert stop.polygon.intersects(shapely.Point(*line((50.0, 0.0))[0]))
    assert not any(c.has_traffic_light for c in roads.connectors.values())


def test_a_stop_line_of_a_crossing_is_kept_as_it_is_drawn() -> None:
    drawn = SourceStopLine("s", line((30.0, 1.7), (30.0, -1.7)), StopLineKind.PEDESTRIAN_CROSSING)
    (stop,) = build(replace(fork(), stop_lines=(drawn,))).roads.stop_lines.values()
    assert stop.kind is StopLineKind.PEDESTRIAN_CROSSING
    assert stop.polygon.area == pytest.approx(3.4 * 0.5)


def test_what_is_no_lane_for_cars_stays_drivable_and_is_told() -> None:
    strip = shapely.Polygon(line((0, -4), (0, -2), (50, -2), (50, -4)))
    made = build(replace(fork(), left_out=(LeftOut("9", "bicycle lane", strip), LeftOut("8", "rail"))))
    assert made.left_out == {"bicycle lane": ("9",), "rail": ("8",)}
    assert made.roads.drivable(line((25, -3))).all()


def test_an_overlap_that_nobody_reaches_is_told() -> None:
    inside = [
        straight("a", 0, 15, in_intersection=True),
        straight("b", 15, 30, in_intersection=True, speed_limit_mps=5.0),
    ]
    lanes = linked([*inside, straight("far", 100, 150)], [("a", "b"), ("b", "a")])
    made = build(world(lanes))
    assert [note for note in made.notes if note.startswith("lane a: 15.0 m of it are left out")]


def test_a_way_that_a_shorter_one_makes_needless_is_told() -> None:
    """SUMO knows one way from a lane to another."""
    there = lane("round", ((100, 0), (110, 2), (120, 2), (130, 0)), in_intersection=True)
    lanes = [straight("in", 0, 100), straight("on", 100, 130, in_intersection=True), there, straight("out", 130, 230)]
    links = [("in", "on"), ("on", "out"), ("in", "round"), ("round", "out")]
    built = build(world(linked(lanes, links)))
    assert len(built.roads.connectors) == 1
    (said,) = (note for note in built.notes if "round" in note)
    assert said.endswith("m of it are left out: a shorter way joins the same two lanes")


def test_a_map_without_lanes_is_refused() -> None:
    with pytest.raises(MapError, match="no lane for cars"):
        build(world({}))


@given(st.floats(-0.5, 0.5), st.floats(2.6, 4.5), st.integers(1, 4), st.floats(30.0, 200.0))
@settings(max_examples=25)
def test_any_bent_road_of_parallel_lanes_keeps_the_rules(
    turn_rad: float, width_m: float, count: int, radius_m: float
) -> None:
    """Lanes drawn each on its own: neighbours whose boundaries have vertices at different places."""
    sign = -1.0 if turn_rad < 0.0 else 1.0
    lanes = []
    for k in range(count):
        radius = radius_m + sign * k * width_m
        angles = np.linspace(0.0, turn_rad, 9 + 2 * k)
        middle = [(radius * np.sin(abs(a)), sign * (radius_m - radius * np.cos(a))) for a in angles]
        lanes.append(
            lane(str(k), middle if abs(turn_rad) > 1e-3 else [(0.0, -k * width_m), (50.0, -k * width_m)], width_m)
        )
    source = world(neighbours(linked(lanes, []), *map(str, range(count))))
    roads, record = record_of(source)
    assert schema_problems(roads) == []
    assert compare(roads, record, source, None).problems == ()


# --- the check finds what is lost --------------------------------------------------------------


def changed(source: SourceMap, **lanes: Mapping[str, Any]) -> SourceMap:
    """The file with some of its lanes as another reader might have found them."""
    more = {id_: replace(source.lanes[id_], **changes) for id_, changes in lanes.items()}
    return replace(source, lanes={**source.lanes, **more})


def found_wrong(source: SourceMap, count: SourceCount | None = None) -> set[tuple[str, str, str]]:
    """Kind, layer and id of what differs between a file and the map of the junction with flags."""
    roads, record = record_of(junction_with_flags())
    return {(each.kind, each.layer, each.id) for each in compare(roads, record, source, count).problems}


def test_the_check_sees_a_lost_lane_link_light_limit_and_crosswalk() -> None:
    source = junction_with_flags()
    told = changed(source, turn={"speed_limit_mps": 7.0})
    told = changed(told, **{"in": {"lights_at_end": ("red",)}})
    honest = count_of(source)
    more = replace(
        honest,
        lane_length_m={**honest.lane_length_m, "lost": 30.0},
        links=honest.links | {("in", "side")},
        crosswalks=1,
        left_out=2,
    )
    file = record_of(source)[1].file
    assert found_wrong(told, more) == {
        ("missing", "lane", "lost"),
        ("missing", "link", "in to side"),
        ("light", "lane", "in"),
        ("limit", "lane", "turn"),
        ("count", "file", file),
        ("length", "file", file),
    }


def test_the_check_sees_what_the_file_does_not_have() -> None:
    source = junction_with_flags()
    honest = count_of(source)
    lengths = {id_: length_m for id_, length_m in honest.lane_length_m.items() if id_ != "side"}
    less = replace(honest, lane_length_m=lengths, links=honest.links - {("in", "turn")})
    problems = found_wrong(changed(source, out={"speed_limit_mps": None}), less)
    assert {("extra", "lane", "side"), ("extra", "link", "in to turn"), ("limit", "lane", "out")} <= problems


@pytest.mark.parametrize(("off_m", "told"), [(2.6, False), (3.0, True)])
def test_the_check_measures_the_length_of_all_lanes(off_m: float, told: bool) -> None:
    """187 m, of which 1.5 % may differ."""
    source = junction_with_flags()
    honest = count_of(source)
    other = replace(honest, lane_length_m={**honest.lane_length_m, "in": honest.lane_length_m["in"] + off_m})
    assert bool(found_wrong(source, other)) == told


@pytest.mark.parametrize(("off_m", "told"), [(5.3, 0), (5.6, 1), (7.9, 1), (8.3, 2)])
def test_the_check_measures_the_length_of_every_lane(off_m: float, told: int) -> None:
    """Lanes of 50 and 60 m, of which 12 % may differ; together they are as long as ever."""
    source = junction_with_flags()
    honest = count_of(source)
    lengths = honest.lane_length_m
    moved = {**lengths, "in": lengths["in"] - off_m, "out": lengths["out"] + off_m}
    found = found_wrong(source, replace(honest, lane_length_m=moved))
    assert len(found) == told
    assert {kind for kind, _, _ in found} <= {"length"}


def test_the_record_survives_its_file(tmp_path: Path) -> None:
    _, record = record_of(fork())
    record.write(tmp_path)
    assert read_record(tmp_path) == record
    assert read_record(tmp_path / "elsewhere") is None


@pytest.mark.parametrize("text", ["{", "[]", '{"version": 2}', '{"version": 1, "origins": 3}', "[" * 100000])
def test_a_damaged_record_is_one_clear_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "import.json").write_text(text)
    with pytest.raises(MapError, match=r"import\.json .*import the map again"):
        read_record(tmp_path)
