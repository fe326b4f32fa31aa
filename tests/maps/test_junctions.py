"""Who belongs together, whose paths meet, and who goes first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from interplan_sumo.maps.junctions import (
    Junction,
    Movement,
    Sign,
    end_port,
    junction,
    junction_groups,
    lane_signs,
    start_port,
)
from interplan_sumo.world.roads import Roads, StopLineKind
from tests.maps.road_worlds import Ways, beside, crossing, small_roads, straight


def only_junction(roads: Roads) -> Junction:
    _, members = junction_groups(roads)
    (found,) = members.values()
    return junction(roads, found, lane_signs(roads))


def row(meeting: Junction, start: str, end: str) -> int:
    """The row of the way from roadblock to roadblock, each with one lane."""
    names = [(c.from_lane_id, c.to_lane_id) for c in meeting.connectors]
    return names.index((f"{start}0", f"{end}0"))


def test_the_ways_of_a_crossing_share_a_node_and_loose_ends_have_their_own() -> None:
    nodes, members = junction_groups(crossing())
    assert set(members) == {"I900"}
    assert nodes[end_port("11")] == nodes[start_port("21")] == "I900"
    assert nodes[start_port("11")] == "11.in"
    assert nodes[end_port("21")] == "21.out"


def test_paths_that_cross_belong_together_even_without_an_intersection() -> None:
    groups = {
        "1": [straight((-50, 0), (-10, 0))], "2": [straight((10, 0), (50, 0))],
        "3": [straight((0, -50), (0, -10))], "4": [straight((0, 10), (0, 50))],
        "5": [straight((-50, 90), (-10, 90))], "6": [straight((10, 90), (50, 90))],
    }  # fmt: skip
    ways = [Ways("1", "2"), Ways("3", "4"), Ways("5", "6")]
    nodes, members = junction_groups(small_roads(groups, ways, intersection=None))
    assert nodes[end_port("1")] == nodes[end_port("3")] != nodes[end_port("5")]
    assert sorted(map(len, members.values())) == [1, 2]


@pytest.mark.parametrize("side", ["right", "left"])
def test_turns_are_named_by_the_driving_side(side: str) -> None:
    meeting = only_junction(crossing(side=side))  # type: ignore[arg-type]
    assert meeting.movements[row(meeting, "13", "21")] is Movement.STRAIGHT  # from south to north
    left, right = row(meeting, "13", "24"), row(meeting, "13", "22")
    far, near = (left, right) if side == "right" else (right, left)
    assert meeting.movements[far] is Movement.FAR_TURN
    assert meeting.movements[near] is Movement.NEAR_TURN


def test_facing_approaches_are_found() -> None:
    meeting = only_junction(crossing(arms="NES"))
    blocks = [a.block_ids for a in meeting.approaches]
    north, east, south = (blocks.index((b,)) for b in ("11", "12", "13"))
    assert meeting.opposite == {north: south, south: north}
    assert east not in meeting.opposite


def test_paths_conflict_where_they_cross_or_merge_and_not_where_they_part() -> None:
    meeting = only_junction(crossing())
    south_north, east_west = row(meeting, "13", "21"), row(meeting, "12", "24")
    south_east, north_south = row(meeting, "13", "22"), row(meeting, "11", "23")
    west_north = row(meeting, "14", "21")
    assert meeting.conflicts[south_north, east_west]  # crossing
    assert meeting.conflicts[south_north, west_north]  # merging
    assert not meeting.conflicts[south_north, south_east]  # parting
    assert not meeting.conflicts[south_north, north_south]  # passing
    assert (meeting.conflicts == meeting.conflicts.T).all()


def test_of_two_in_conflict_exactly_one_yields() -> None:
    for roads in (crossing(), crossing(lit=True), crossing(signs={"12": StopLineKind.YIELD})):
        meeting = only_junction(roads)
        assert (meeting.yields ^ meeting.yields.T == meeting.conflicts).all()


def test_the_faster_road_goes_first() -> None:
    meeting = only_junction(crossing(limits={"12": 19.0, "14": 19.0}))
    assert meeting.yields[row(meeting, "13", "21"), row(meeting, "12", "24")]
    assert meeting.yields[row(meeting, "13", "21"), row(meeting, "12", "23")], "even its turn across"


def test_a_road_that_ends_yields_to_the_one_that_goes_on() -> None:
    meeting = only_junction(crossing(arms="NES", limits={"12": 25.0}))
    assert meeting.yields[row(meeting, "12", "23"), row(meeting, "11", "23")]
    assert meeting.yields[row(meeting, "12", "23"), row(meeting, "13", "21")]


def test_signs_outrank_speed() -> None:
    signs = {"12": StopLineKind.STOP_SIGN, "14": StopLineKind.STOP_SIGN}
    meeting = only_junction(crossing(signs=signs, limits={"12": 25.0, "14": 25.0}))
    assert meeting.yields[row(meeting, "12", "24"), row(meeting, "13", "21")]
    assert [a.sign for a in meeting.approaches].count(Sign.STOP) == 2
    assert not meeting.all_way_stop


def test_stop_signs_on_every_approach_make_an_all_way_stop() -> None:
    meeting = only_junction(crossing(signs={f"1{k}": StopLineKind.STOP_SIGN for k in range(1, 5)}))
    assert meeting.all_way_stop
    assert (meeting.yields == meeting.conflicts).all()


def test_lines_for_pedestrians_or_lights_are_no_signs() -> None:
    kinds = (StopLineKind.PEDESTRIAN_CROSSING, StopLineKind.TRAFFIC_LIGHT, StopLineKind.UNKNOWN)
    for kind in kinds:
        assert lane_signs(crossing(signs={"12": kind})) == {}


def test_a_turn_across_yields_to_oncoming_traffic_on_the_same_road() -> None:
    for roads in (crossing(), crossing(lit=True)):
        meeting = only_junction(roads)
        assert meeting.yields[row(meeting, "13", "24"), row(meeting, "11", "23")]
        assert meeting.yields[row(meeting, "13", "24"), row(meeting, "11", "24")]


def test_a_way_past_the_light_yields_to_those_under_it() -> None:
    roads = crossing(lit=True)
    slip = next(c for c in roads.connectors.values() if (c.from_lane_id, c.to_lane_id) == ("130", "220"))
    connectors = {**roads.connectors, slip.id: replace(slip, stop_line_ids=())}
    meeting = only_junction(replace(roads, connectors=connectors))
    assert meeting.yields[row(meeting, "13", "22"), row(meeting, "14", "22")]
    assert row(meeting, "13", "22") not in meeting.lit


def test_a_lane_that_ends_gives_way_to_the_one_that_goes_on() -> None:
    groups = {
        "1": [beside(straight((0, 0), (80, 0)), 3.5 * k) for k in range(2)],
        "2": [straight((120, 0), (200, 0))],
    }
    meeting = only_junction(small_roads(groups, [Ways("1", "2", ((0, 0), (1, 0)))], intersection=None))
    assert np.flatnonzero(meeting.yields.any(axis=1)).tolist() == [1]
