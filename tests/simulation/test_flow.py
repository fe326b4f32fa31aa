"""Vehicles that keep entering: at the density, where there is room, out of sight, and the same in equal runs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import LANE_Y, ego_at, stepped, two_way_road, types
from random_drives import audited, random_scenario

from interplan_planners.idm import IdmPlanner
from interplan_sumo.maps.store import load_roads, maps
from interplan_sumo.scenario.scenario import LARGEST_GAP_M, SMALLEST_GAP_M, Scenario
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.simulation import flow
from interplan_sumo.simulation.agent_registry import AgentRegistry
from interplan_sumo.simulation.episode import drive
from interplan_sumo.simulation.flow import (
    EDGE_CLEAR_M,
    OUT_OF_SIGHT_M,
    RETRY_STEPS,
    Flow,
    Inflow,
    draw_arrivals,
)
from interplan_sumo.simulation.idm import acceleration_mps2
from interplan_sumo.simulation.lane_chains import chain_through
from interplan_sumo.simulation.network import NetworkLink
from interplan_sumo.simulation.setup import open_traffic, start_state
from interplan_sumo.simulation.spawning import FilledLane, Spawn
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoState

NETWORK = two_way_road()
DT_S = 0.1
BEGIN_X = 200.0
"""Where lane 0 is filled from, on a road that begins at x = 0."""
FAR_AWAY = ego_at(1400.0, LANE_Y[0], 0.0)


def opens(_: NetworkLink) -> bool:
    return True


def filled(begin_x: float = BEGIN_X, next_x: float = BEGIN_X - 5.0, largest_gap_m: float = 33.0) -> FilledLane:
    """Lane 0, of which the part from `begin_x` on is filled; the next vehicle would have stood at `next_x`."""
    chain = chain_through(NETWORK, "e0_0", 0.0, set(), 0.0, 1500.0)
    return FilledLane(chain, begin_x, next_x, largest_gap_m)


def inflow(lane: FilledLane | None = None, seed: int = 0) -> Inflow:
    lane = lane or filled()
    arrivals, speed_mps = draw_arrivals(lane, types("conservative"), 30.0, np.random.default_rng(seed))
    taken = {stretch.lane.id for stretch in lane.chain}
    return Inflow(NETWORK, lane, (), arrivals, speed_mps, DT_S, taken)


def registry(cars: list[tuple[float, float, float]] | None = None) -> AgentRegistry:
    """Conservative drivers: (x of the front bumper, y, speed), heading east."""
    found = AgentRegistry(Path("conservative.xml"), Actors.none(), None, (0.0, 0.0), DT_S)
    names = [f"a{i}" for i in range(len(cars or ()))]
    for name in names:
        found.add(name, name, types("conservative").members[0], ("e0", "e1"))
    found.enter(names)
    rows = cars or []
    found.kinematics.move([row[:2] for row in rows], [90.0] * len(rows), [row[2] for row in rows])
    return found


def entries(queue: Inflow, steps: int, ego: EgoState = FAR_AWAY, others: AgentRegistry | None = None) -> list[Spawn]:
    """Who drives in within some steps onto a road on which nothing else happens."""
    here = others or registry()
    flow = Flow([queue], [str(i) for i in range(1000)])
    found = (flow.entry(here, ego, PACIFICA, (0.0, 0.0), opens) for _ in range(steps))
    return [each[1] for each in found if each is not None]


def centre_m(spawn: Spawn) -> float:
    return spawn.position_m - spawn.driver.length_m / 2.0


@pytest.mark.parametrize("density", ["low", "medium", "high"])
def test_as_many_come_as_the_density_wants(density: str) -> None:
    lane = filled(largest_gap_m=LARGEST_GAP_M[density])
    counts = [len(entries(inflow(lane, seed), 300)) for seed in range(20)]
    _, speed_mps = draw_arrivals(lane, types("conservative"), 30.0, np.random.default_rng(0))
    mean_gap_m = (SMALLEST_GAP_M + LARGEST_GAP_M[density]) / 2.0
    assert np.mean(counts) == pytest.approx(30.0 * speed_mps / mean_gap_m, rel=0.1)


def test_they_drive_in_where_the_filled_lane_begins() -> None:
    places = [centre_m(each) for each in entries(inflow(), 300)]
    assert min(places) >= BEGIN_X - 1e-6
    assert max(places) <= BEGIN_X + 15.0 * RETRY_STEPS * DT_S  # as far as the queue goes between two looks


def test_a_queue_draws_all_it_needs_beforehand_and_equal_draws_are_equal() -> None:
    first, second = entries(inflow(seed=3), 300), entries(inflow(seed=3), 300)
    assert first == second
    assert first != entries(inflow(seed=4), 300)


def test_where_no_room_is_none_enters_until_there_is() -> None:
    queue = inflow()
    assert entries(queue, 100, others=registry([(BEGIN_X + 1.0, LANE_Y[0], 0.0)])) == []
    assert entries(queue, 100, others=registry([(BEGIN_X + 1.0, LANE_Y[1], 0.0)])) != []  # on the next lane


def test_a_car_that_is_changing_into_the_lane_is_on_it() -> None:
    here = registry([(BEGIN_X + 1.0, LANE_Y[1] - 0.3, 10.0)])
    here.kinematics.heading_rad = np.array([-0.1])
    assert entries(inflow(), 6, others=here) == []


def test_a_car_that_the_ego_comes_near_enters_before_the_ego_could_see_it_appear() -> None:
    ego = ego_at(BEGIN_X - 10.0, LANE_Y[0], 0.0)  # where the filled lane begins, the ego would see everybody appear
    found = entries(inflow(), 300, ego)
    assert found
    assert all(abs(centre_m(each) - ego.x_m) >= OUT_OF_SIGHT_M for each in found)


def test_at_the_edge_of_the_map_vehicles_may_come_into_sight_but_not_right_before_the_ego() -> None:
    lane = filled(begin_x=0.0, next_x=-5.0)
    seen = entries(inflow(lane), 30, ego_at(EDGE_CLEAR_M + 20.0, LANE_Y[0], 8.0))
    assert seen
    assert centre_m(seen[0]) < 15.0
    assert entries(inflow(lane), 30, ego_at(EDGE_CLEAR_M - 5.0, LANE_Y[0], 8.0)) == []


def test_beyond_the_edge_of_the_map_nothing_appears_in_sight_where_the_map_begins_nearby() -> None:
    """The lane is filled from 60 m on, in sight of the ego at 100 m: only the first metres of the map are left."""
    found = entries(inflow(filled(begin_x=60.0, next_x=55.0)), 30, ego_at(100.0, LANE_Y[0], 0.0))
    assert found
    assert all(centre_m(each) < 18.0 for each in found)


def test_a_queue_comes_at_the_limit_of_the_lane_where_it_drives_in() -> None:
    lane = filled(largest_gap_m=200.0)
    first = replace(lane.chain[0], lane=replace(lane.chain[0].lane, limit_mps=8.0))
    slow = replace(lane, chain=[first, *lane.chain[1:]])
    _, speed_mps = draw_arrivals(slow, types("conservative"), 30.0, np.random.default_rng(0))
    assert 7.5 < speed_mps <= 8.0


@pytest.mark.parametrize(("gap_m", "may"), [(5.1, True), (4.9, False)])
def test_a_vehicle_enters_at_least_five_metres_ahead_of_the_next_one_behind(gap_m: float, may: bool) -> None:
    assert flow._may_follow(None, 5.0, 15.0, gap_m, 5.0) == may


CAR = st.tuples(st.floats(120.0, 330.0), st.floats(0.0, 15.0))


@settings(max_examples=150)
@given(cars=st.lists(CAR, min_size=1, max_size=4), seed=st.integers(0, 100))
def test_every_entry_starts_as_the_rules_of_the_start_demand(cars: list[tuple[float, float]], seed: int) -> None:
    found = entries(inflow(seed=seed), 30, others=registry([(x, LANE_Y[0], speed) for x, speed in cars]))
    if not found:
        return
    driver, front_m, speed_mps = found[0].driver, found[0].position_m, found[0].speed_mps
    rear_m = front_m - driver.length_m
    limit_mps = NETWORK.lanes["e0_0"].limit_mps
    moved = [(x + DT_S * other_mps, other_mps) for x, other_mps in cars]
    ahead = min((car for car in moved if car[0] > centre_m(found[0])), default=None)
    behind = max((car for car in moved if car[0] <= centre_m(found[0])), default=None)
    if ahead is not None:
        gap_m = ahead[0] - driver.length_m - front_m
        assert gap_m > 0.4
        assert (speed_mps - ahead[1]) * 3.0 <= gap_m
        assert acceleration_mps2(driver, speed_mps, limit_mps, gap_m, ahead[1]) > -3.0
    if behind is not None:
        gap_m = rear_m - behind[0]
        assert gap_m > 0.4
        assert (behind[1] - speed_mps) * 3.0 <= gap_m
        assert acceleration_mps2(driver, behind[1], limit_mps, gap_m, speed_mps) > -3.0


# --- on the maps -------------------------------------------------------------------------------

HTD = find_scenario("lane_change_htd/0")
FLOWING = replace(HTD, id="test/flow", traffic=replace(HTD.traffic, flow=True, oncoming="medium"))


def test_with_flow_the_start_is_the_same_and_more_come_with_ids_of_their_own() -> None:
    roads = load_roads(FLOWING.map)
    still = replace(FLOWING, traffic=replace(FLOWING.traffic, flow=False))
    ego = start_state(FLOWING, roads)
    with open_traffic(still, roads) as traffic:
        before = traffic.observe().actors
    with open_traffic(FLOWING, roads) as traffic:
        first, *_, later = stepped(traffic, lambda _: ego, 200)
        known = traffic.behaviours
    assert first.ids == before.ids
    assert np.array_equal(first.x_m, before.x_m)
    came = sorted(set(known) - set(first.ids))
    assert len(came) >= 10
    assert set(later.ids) <= set(known)
    assert all(len(token) == 4 and int(token, 16) >= 0 for token in came)
    assert list(known)[len(first.ids) :] != came  # not in order of their coming
    assert set(known.values()) == {"conservative", "assertive"}


def test_equal_drives_with_flow_are_equal_and_their_behaviours_are_recorded() -> None:
    first, second = (drive(FLOWING, IdmPlanner()).trace for _ in range(2))
    assert first is not None
    assert second is not None
    assert first.hash() == second.hash()
    actors = first.actors
    assert len(set(actors.ids)) > len(actors.at(0))
    assert set(actors.behaviour) == {"conservative", "assertive"}


def flowing(number: int) -> Scenario:
    name = sorted(maps())[number % 4]
    scenario = random_scenario(name, np.random.default_rng(number), number, obstacles=number % 2 == 0)
    return replace(scenario, traffic=replace(scenario.traffic, flow=True))


@pytest.mark.parametrize("number", [*range(1, 5), *(pytest.param(k, marks=pytest.mark.slow) for k in range(5, 60))])
def test_no_vehicle_appears_in_sight_or_in_anothers_way(number: int) -> None:
    audit = audited(flowing(number), seed=number, steps=200, wild=False)
    assert audit.faults == []
    assert audit.entered > 0 or number > 4


@pytest.mark.slow
@pytest.mark.parametrize("number", range(40))
def test_a_reckless_ego_amid_flow_upsets_nobody_else(number: int) -> None:
    first, second = (audited(flowing(number), seed=number, steps=300) for _ in range(2))
    assert first.faults == []
    assert first.hash == second.hash
