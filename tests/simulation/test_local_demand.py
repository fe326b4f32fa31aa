"""Where traffic is wanted, how dense, and on which ways it gets there; who stands where on the lanes."""

from __future__ import annotations

import numpy as np
import pytest
from networks import two_way_road, types

from interplan_sumo.maps.store import find_map, maps
from interplan_sumo.scenario.scenario import TrafficDemand
from interplan_sumo.simulation.lane_chains import way_ahead
from interplan_sumo.simulation.lane_occupancy import LaneOccupancy, Occupant
from interplan_sumo.simulation.local_demand import agent_route, local_demand, opposite_edges
from interplan_sumo.simulation.network import SumoNetwork, read_network

NETWORK = two_way_road()
DRIVER = types("conservative").members[0]


def district(name: str) -> SumoNetwork:
    return read_network(find_map(name).network)


def test_edges_side_by_side_of_opposite_heading_are_opposite() -> None:
    found = opposite_edges(NETWORK)
    assert found == {"e0": {"w0"}, "w0": {"e0"}, "e1": {"w1"}, "w1": {"e1"}}


def test_own_oncoming_and_side_roads_have_densities_of_their_own() -> None:
    demand = local_demand(NETWORK, TrafficDemand("high", oncoming="medium"), ("e0",), ())
    assert demand.largest_gap_m == {"e0": 33.0, "w0": 50.0, "e1": 400.0, "w1": 400.0}
    assert demand.on_own_road == {"e0", "w0"}
    assert demand.mean_gap_m("e0") == 21.5


def test_where_none_is_wanted_nobody_drives_nor_where_one_only_comes_there() -> None:
    demand = local_demand(NETWORK, TrafficDemand("high"), ("e0",), ())  # nobody on w0, which w1 leads to
    assert demand.largest_gap_m.keys() == {"e0", "e1", "w1"}
    assert demand.lanes == {f"{edge}_{lane}" for edge in ("e0", "e1") for lane in range(3)}


@pytest.mark.parametrize("name", sorted(maps()))
def test_routes_lead_on_for_as_long_as_wanted_or_to_the_edge_of_the_map_and_turn_now_and_then(name: str) -> None:
    network = district(name)
    closed = sorted(network.edges)[:5]
    demand = local_demand(network, TrafficDemand("none", oncoming="high"), closed, ())
    rng = np.random.default_rng(0)
    turns = 0
    for lane in sorted(demand.lanes)[::3]:
        route = agent_route(network, demand, lane, 900.0, rng)
        assert not set(route) & set(closed)
        way = way_ahead(network, lane, route, 1e9)
        turns += sum(part.link is not None and part.link.direction in "lr" for part in way)
        last = {each for each in network.edges[route[-1]] if not network.links[each]}
        assert sum(network.lanes[network.edges[edge][0]].length_m for edge in route) >= 900.0 or last
    assert turns > 5


def test_who_is_placed_where_no_traffic_is_wanted_drives_on_to_the_edge_of_the_map() -> None:
    demand = local_demand(NETWORK, TrafficDemand("none", oncoming="none"), ("e0", "e1"), ("w0", "w1"))
    assert not demand.lanes
    assert agent_route(NETWORK, demand, "e0_1", 900.0, np.random.default_rng(0)) == ("e0", "e1")


def test_a_way_ahead_follows_the_route_and_ends_beyond_its_reach() -> None:
    way = way_ahead(NETWORK, "e0_1", ("e0", "e1"), 1e9)
    assert [part.lane.id for part in way if not part.lane.internal] == ["e0_1", "e1_1"]
    assert way[-1].start_m == pytest.approx(NETWORK.lanes["e0_1"].length_m, abs=1.0)
    assert [part.lane.id for part in way_ahead(NETWORK, "e0_1", ("e0", "e1"), 300.0)] == ["e0_1"]


def test_leaders_are_seen_on_the_lanes_ahead_and_followers_on_those_behind() -> None:
    occupied = LaneOccupancy(NETWORK)
    length_m = NETWORK.lanes["e0_1"].length_m
    occupied.add("e1_1", Occupant(30.0, 25.0, 7.0, DRIVER))
    occupied.add("e0_1", Occupant(length_m - 60.0, length_m - 65.0, 9.0, DRIVER))
    way = way_ahead(NETWORK, "e0_1", ("e0", "e1"), 1e9)
    leader = occupied.leader(way, length_m - 10.0)
    assert leader is not None
    assert leader == pytest.approx((35.0, 7.0), abs=0.2)
    assert occupied.leader(way_ahead(NETWORK, "e0_0", ("e0", "e1"), 1e9), 10.0) is None
    ((gap_m, follower),) = occupied.followers("e1_1", 10.0, 5.0)
    assert (gap_m, follower.speed_mps) == (pytest.approx(65.0, abs=0.2), 9.0)
    assert occupied.leaves_room("e1_1", 10.0, 5.0, 9.0)
    assert not occupied.leaves_room("e0_1", length_m - 50.0, 5.0, 0.0)


def test_who_reaches_back_into_the_lane_before_is_on_it_too() -> None:
    occupied = LaneOccupancy(NETWORK)
    occupied.add("e1_1", Occupant(2.0, -3.0, 5.0, DRIVER))
    (cut,) = NETWORK.before["e1_1"]  # a cut is an internal lane of 0.1 m
    assert [len(occupied.on(lane)) for lane in (cut, "e0_1")] == [1, 1]
    occupied.add("e1_0", Occupant(9.0, 4.0, 5.0, DRIVER))
    assert all(not occupied.on(lane) for lane in NETWORK.before["e1_0"])
