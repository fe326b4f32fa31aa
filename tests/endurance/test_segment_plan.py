"""Trips through a district: long, known beforehand, and never twice on one road."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.endurance.segment_plan import RUN_OUT_M, SEGMENT_M, START_LANE_M, drawn_scenario
from interplan_sumo.errors import InputError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.route import route_centerline, start_arc_m
from interplan_sumo.tiny_worlds import straight_road
from interplan_sumo.world.roads import Roads


@pytest.fixture(scope="module")
def roads() -> Roads:
    return load_roads("strip")


def test_a_trip_passes_no_road_twice_and_needs_no_lane_change(roads: Roads) -> None:
    for seed in range(8):
        trip = drawn_scenario(f"endure/{seed}", roads, np.random.default_rng(seed))
        trip.check(roads)
        assert len(set(trip.route)) == len(trip.route)
        assert roads[trip.start.lane].centerline.length_m >= START_LANE_M
        ahead_m = route_centerline(roads, trip).length_m - start_arc_m(roads, trip)
        assert 700.0 <= ahead_m <= SEGMENT_M + RUN_OUT_M + 700.0


def test_equal_seeds_give_equal_trips_and_others_other_ones(roads: Roads) -> None:
    one, again, other = (drawn_scenario("endure/0", roads, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert one == again
    assert one.route != other.route


def test_a_map_without_a_way_is_refused() -> None:
    with pytest.raises(InputError, match=r"no way of 250 m|no lane that leads on"):
        drawn_scenario("endure/0", straight_road(length_m=120.0), np.random.default_rng(0))
