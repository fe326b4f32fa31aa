"""Start places and speeds: the density's gaps, and nobody in danger."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import two_way_road, types

from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.simulation import spawning
from interplan_sumo.simulation.lane_chains import ChainedLane, chain_through, continued_route
from interplan_sumo.simulation.lane_occupancy import LaneOccupancy, Occupant
from interplan_sumo.simulation.light_cycles import SOON_S
from interplan_sumo.simulation.network import opens_freely, read_network
from interplan_sumo.simulation.setup import open_traffic
from interplan_sumo.simulation.spawning import SWITCHING_LINE_M, Spawn
from interplan_sumo.simulation.start_speed import StartAhead, start_speed_mps
from interplan_sumo.simulation.traffic import EgoPresence
from interplan_sumo.simulation.vehicle_types import vehicle_type_file

NETWORK = two_way_road()
EGO_X = 160.0
EGO_LENGTH_M = 5.176
DRIVER = types("conservative").members[0]


def filled(
    chain: list[ChainedLane], closed: list[tuple[float, float]], largest_gap_m: float, behaviour: str,
    ego: list[spawning._Fixed], seed: int,
) -> list[Spawn]:  # fmt: skip
    drawn = spawning._fill(
        chain, (-120.0, 300.0), closed, largest_gap_m, types(behaviour), ego, np.random.default_rng(seed)
    )
    return [Spawn(*each, ()) for each in drawn]


def fill(seed: int, largest_gap_m: float, behaviour: str = "mixed", ego_mps: float | None = 10.0) -> list[Spawn]:
    chain = chain_through(NETWORK, "e0_0", EGO_X / 400.0, set(), 120.0, 300.0)
    ego = [spawning._Fixed(0.0, EGO_LENGTH_M, ego_mps, None, 0.0)] if ego_mps is not None else []
    return filled(chain, [], largest_gap_m, behaviour, ego, seed)


def place(spawn: Spawn) -> tuple[float, float]:
    """Rear and front bumper, x."""
    front = spawn.position_m + (0.0 if spawn.lane.startswith("e0") else 400.0)
    return front - spawn.driver.length_m, front


def test_who_errs_comes_to_a_turn_as_fast_as_its_model_turns_and_others_as_fast_as_the_limit_allows() -> None:
    errs = replace(DRIVER, car_following_model="EIDM")
    turns, straight = (StartAhead(15.0, turns=[(5.0, way)]) for way in "rs")
    assert start_speed_mps(errs, straight) == start_speed_mps(DRIVER, straight) == start_speed_mps(DRIVER, turns)
    assert (start_speed_mps(errs, turns) or 15.0) <= (36.0 + 2.0 * 1.5 * 5.0) ** 0.5


@pytest.mark.parametrize(("largest", "count"), [(33.0, (15, 24)), (50.0, (10, 17)), (100.0, (5, 11))])
def test_the_number_of_cars_follows_the_density(largest: float, count: tuple[int, int]) -> None:
    mean = np.mean([len(fill(seed, largest, ego_mps=None)) for seed in range(30)])
    assert count[0] <= mean <= count[1]  # 420 m of lane less the junction, mean gaps of 21.5, 30 and 55 m


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000))
def test_a_car_is_never_nearer_to_the_ego_than_the_smallest_gap(seed: int) -> None:
    centres = [sum(place(s)) / 2 for s in fill(seed, 33.0)]
    assert min(abs(x - EGO_X) for x in centres) >= 10.0 - 1e-9


def test_a_route_ends_where_the_network_ends() -> None:
    assert continued_route(NETWORK, "e0_1", 5000.0) == ("e0", "e1")
    assert continued_route(NETWORK, "w1_0", 5000.0) == ("w1", "w0")


def test_nobody_starts_within_three_metres_of_an_obstacle_but_just_beyond() -> None:
    chain = chain_through(NETWORK, "e0_0", EGO_X / 400.0, set(), 120.0, 300.0)
    gaps_m: list[float] = []
    for seed in range(400):
        closed = [(70.0, 80.0)]  # along the chain, from the ego on
        for spawn in filled(chain, closed, 33.0, "mixed", [], seed):
            rear_m, front_m = (x - EGO_X for x in place(spawn))
            gaps_m.append(max(70.0 - front_m, rear_m - 80.0))
    assert 3.0 <= min(gaps_m) < 3.2


@pytest.mark.parametrize("line_m", [16.0, 31.0])
def test_the_start_speed_before_a_closed_line_stops_with_one_and_a_half(line_m: float) -> None:
    """A metre before the line, at 1.5 m/s2."""
    speed_mps = start_speed_mps(DRIVER, StartAhead(15.0, line_m))
    assert speed_mps == pytest.approx((2.0 * 1.5 * (line_m - 1.0)) ** 0.5)


def test_the_start_speed_before_a_slower_lane_brakes_mildly_and_does_not_mind_faster_ones() -> None:
    far, near, there = (start_speed_mps(DRIVER, StartAhead(15.0, slower=[(at_m, 6.0)])) for at_m in (200.0, 20.0, 0.0))
    assert far == 15.0
    assert near is not None
    assert 6.0 < near <= (6.0**2 + 2.0 * 1.5 * 20.0) ** 0.5
    assert there == pytest.approx(6.0)
    assert start_speed_mps(DRIVER, StartAhead(15.0, slower=[(5.0, 20.0)])) == 15.0


@pytest.mark.parametrize(("most_mps", "expected"), [(22.0, 22.0), (9.0, 9.0), (None, 15.0)])
def test_a_placed_vehicle_may_be_faster_than_the_limit_and_slower(most_mps: float | None, expected: float) -> None:
    assert start_speed_mps(DRIVER, StartAhead(15.0), most_mps=most_mps) == expected


def test_nobody_starts_behind_a_leader_that_is_too_near_to_stand_behind() -> None:
    assert start_speed_mps(DRIVER, StartAhead(15.0, leader=(DRIVER.min_gap_m, 10.0))) is None
    assert start_speed_mps(DRIVER, StartAhead(15.0, leader=(DRIVER.min_gap_m + 0.5, 10.0))) is not None


def test_who_starts_reaches_nobody_within_three_seconds_on_any_way() -> None:
    """Not even where it does not go."""
    ahead = StartAhead(20.0, leaders=[(36.5, 2.0), (90.0, 20.0)])
    assert start_speed_mps(DRIVER, ahead) == pytest.approx(2.0 + 36.0 / 3.0)
    occupied = LaneOccupancy(NETWORK)
    occupied.add("e1_0", Occupant(30.0, 25.0, 4.0))
    assert occupied.leaders("e0_0", 350.0, 80.0) == [(pytest.approx(75.1), 4.0)]
    assert occupied.leaders("e0_0", 350.0, 45.0) == []


def hardest_braking(name: str, behaviour: str) -> float:
    """Of all who stand there at the start, in the first two seconds, with nobody but them on the road."""
    scenario = find_scenario(name)
    before: dict[str, float] = {}
    hardest = 0.0
    with open_traffic(
        scenario,
        load_roads(scenario.map),
        vehicle_types=vehicle_type_file(behaviour),
        presence=EgoPresence.ABSENT,
        most_agents=1000,
    ) as traffic:
        for _ in range(21):
            now = traffic.observe().actors
            speeds = dict(zip(now.ids, now.speed_mps.tolist(), strict=True))
            hardest = max([hardest, *((before[each] - speeds[each]) / 0.1 for each in before.keys() & speeds.keys())])
            before = speeds
            traffic.advance()
    return hardest


@pytest.mark.parametrize(
    ("name", "behaviour"),
    [("stopping_with_lead/1", "assertive"), ("near_multiple_vehicles/1", "urban"), ("lane_change_htd/2", "assertive")],
)
def test_nobody_brakes_hard_because_of_how_it_started(name: str, behaviour: str) -> None:
    """The first placed one before a turn, at 19 m/s, and braked with 9 m/s2."""
    assert hardest_braking(name, behaviour) <= 3.0


@pytest.mark.parametrize(("lasts_s", "before_m"), [(SOON_S - 0.1, SWITCHING_LINE_M), (SOON_S + 0.1, 1.6)])
def test_one_that_starts_at_a_green_light_about_to_switch_has_room_to_stop_again(
    lasts_s: float, before_m: float
) -> None:
    network = read_network(find_map("one_north").network)
    link = next(
        link
        for ways in network.links.values()
        for link in ways
        if link.light is not None and opens_freely(network.lights, link)
    )
    assert link.light is not None
    lights = network.lights.later(network.lights.phases[link.light[0]][0].duration_s - lasts_s)
    lane = network.lanes[link.from_lane]
    starts = Spawn(lane.id, lane.length_m - 1.6, 0.0, DRIVER, (lane.edge, network.lanes[link.to_lane].edge))
    placed = spawning._up_to_the_line(network, starts, lights)
    assert lane.length_m - placed.position_m == pytest.approx(before_m)
