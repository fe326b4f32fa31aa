"""An event cut out of a trip: the same seconds, as a trace from 0 s on and as a scenario on the trip's way."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.endurance.cut_out import GOAL_M, NEAR_M, cut_scenario, cut_trace, window
from interplan_sumo.endurance.trip_way import TripWay
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.tiny_worlds import cars, drive_along, straight_road
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import Trace

FIRST, END = 100, 251


@pytest.fixture(scope="module")
def roads() -> Roads:
    return straight_road(length_m=600.0, cuts_m=((200.0, 220.0),))


@pytest.fixture(scope="module")
def trace(roads: Roads) -> Trace:
    """30 s at 8 m/s from 10 m on; one stands at 250 m, and one far away."""
    line = next(iter(roads.lanes.values())).centerline
    there = cars((250.0, 3.0, 0.0, 0.0), (250.0 + 5.0 * NEAR_M, 3.0, 0.0, 0.0))
    whole = type(line)(np.array(((0.0, 0.0), (600.0, 0.0))))
    return drive_along(whole, *([8.0] * 301), start_m=10.0, actors=there)


def trip_of(roads: Roads) -> Scenario:
    first, second = sorted(roads.lanes, key=lambda lane: float(roads.lanes[lane].centerline.points[0, 0]))
    (connector,) = roads.connectors
    blocks = tuple(roads[lane].roadblock_id for lane in (first, connector, second))
    return Scenario(
        "endure/tiny-0", "endure", roads.name, LanePosition(first, 10.0), 8.0, LanePosition(second, 370.0), blocks
    )


def test_the_cut_begins_ten_seconds_before_the_event_and_earlier_where_that_is_inside_a_junction(
    roads: Roads, trace: Trace
) -> None:
    assert window(trace, 200, roads) == (100, 251)
    assert window(trace, 290, roads) == (190, 301)
    inside = round((210.0 - 10.0) / 0.8)
    first, _ = window(trace, inside + 100, roads)
    assert first < inside
    assert trace.ego.x_m[first] < 200.0 <= trace.ego.x_m[first + 1]


def test_the_trace_is_that_of_the_trip_with_another_clock(trace: Trace) -> None:
    cut = cut_trace(trace, FIRST, END)
    assert len(cut) == END - FIRST
    assert cut.ego.time_us[[0, -1]].tolist() == [0, 15_000_000]
    assert cut.ego.x_m[0] == trace.ego.x_m[FIRST]
    assert cut.actors.at(3).ids == trace.actors.at(FIRST + 3).ids
    assert cut.plans[0].time_s[0] == pytest.approx(0.0)
    assert cut.hash() == cut_trace(trace, FIRST, END).hash() != cut_trace(trace, FIRST + 1, END).hash()


def test_the_scenario_goes_on_along_the_trip_s_way_among_those_who_were_near(roads: Roads, trace: Trace) -> None:
    found = cut_scenario("endure/tiny-0.0", trip_of(roads), roads, trace, FIRST, END)
    assert found is not None
    assert found.start.pose(roads).x_m == pytest.approx(trace.ego.x_m[FIRST], abs=0.01)
    assert found.start_speed_mps == pytest.approx(8.0)
    assert found.duration_s == 15.0
    assert found.goal.pose(roads).x_m == pytest.approx(trace.ego.x_m[FIRST] + GOAL_M, abs=0.5)
    assert [track.x_m[0] for track in found.replayed] == [250.0]
    assert found.past is not None


def test_an_ego_on_its_own_is_cut_out_as_well(roads: Roads, trace: Trace) -> None:
    found = cut_scenario("endure/tiny-0.0", trip_of(roads), roads, trace, 0, 50)
    assert found is not None
    assert found.replayed == ()


def test_places_along_a_way_are_those_of_its_lanes(roads: Roads) -> None:
    way = TripWay(trip_of(roads), roads)
    at = way.at(210.0)
    assert at is not None
    assert at.lane in roads.connectors
    assert at.arc_m == pytest.approx(10.0)
    assert way.at(601.0) is None
