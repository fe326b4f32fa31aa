"""The density is held: vehicles enter and leave out of sight, where there is room, and the same in equal runs."""

from __future__ import annotations

from itertools import count

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import LANE_Y, ego_at, stepped, two_way_road, types
from random_drives import audited, random_scenario

from interplan_planners.idm import IdmPlanner
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map, load_roads, maps
from interplan_sumo.scenario.scenario import Density, Scenario, TrafficDemand
from interplan_sumo.simulation.episode import drive
from interplan_sumo.simulation.flow import (
    LEAVING_M,
    OUT_OF_SIGHT_M,
    OWN_REACH_M,
    Changes,
    Flow,
    OnTheRoad,
    draw_arrivals,
)
from interplan_sumo.simulation.idm import acceleration_mps2
from interplan_sumo.simulation.local_demand import LocalDemand, local_demand
from interplan_sumo.simulation.network import read_network
from interplan_sumo.simulation.setup import open_traffic, start_state
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats
from tests.quick import few
from tests.scenes import scene

NETWORK = two_way_road()
DT_S = 0.1
Car = tuple[str, float, float]
"""SUMO lane, position of the front bumper, speed."""


def wanted(density: Density = "high", oncoming: Density = "none") -> LocalDemand:
    return local_demand(NETWORK, TrafficDemand(density, oncoming=oncoming), ("e0", "e1"), ())


def keeper(demand: LocalDemand | None = None, seed: int = 0) -> Flow:
    rng = np.random.default_rng(seed)
    arrivals = draw_arrivals(types("conservative"), rng)
    return Flow(NETWORK, demand or wanted(), (), arrivals, (str(i) for i in count()), 5000.0, rng)


def look(flow: Flow, cars: list[Car], ego: EgoState) -> Changes:
    """What a flow does about cars on a road on which nothing else happens."""
    driver = types("conservative").members[0]
    x_m = np.array([_x_m(lane, at_m) for lane, at_m, _ in cars])
    there = OnTheRoad(
        [f"a{i}" for i in range(len(cars))], [car[0] for car in cars], [car[1] for car in cars],
        np.zeros(len(cars)), np.array([car[2] for car in cars]), [driver] * len(cars), x_m, np.zeros(len(cars)),
    )  # fmt: skip
    return flow.changes(there, ego, (0.0, 0.0), lambda _: True)


def _x_m(lane: str, at_m: float) -> float:
    return float(NETWORK.lanes[lane].plain_line.pose_at(at_m).x_m)


def filled(flow: Flow, ego: EgoState) -> list[Spawn]:
    """Who enters a road on which those that have entered stay where they are."""
    there, found = list[Car](), list[Spawn]()
    for _ in range(60):
        came = [spawn for _, spawn in look(flow, there, ego).entering]
        there += [(spawn.lane, spawn.position_m, spawn.speed_mps) for spawn in came]
        found += came
    return found


def centre_x(spawn: Spawn) -> float:
    return _x_m(spawn.lane, spawn.position_m - spawn.driver.length_m / 2.0)


@pytest.mark.parametrize("density", few(["high", "medium", "low"], 1))
def test_beyond_sight_the_road_is_filled_to_its_density(density: Density) -> None:
    ego = ego_at(750.0, LANE_Y[1])
    counts = [len(filled(keeper(wanted(density), seed), ego)) for seed in range(20)]
    lanes_m = 3 * 2 * (OWN_REACH_M - OUT_OF_SIGHT_M)
    assert np.mean(counts) == pytest.approx(lanes_m / wanted(density).mean_gap_m("e1"), rel=0.15)


def test_nobody_enters_in_sight_nor_far_away_nor_on_roads_where_none_is_wanted() -> None:
    found = [spawn for seed in range(10) for spawn in filled(keeper(seed=seed), ego_at(750.0, LANE_Y[1]))]
    away_m = np.abs([centre_x(spawn) - 750.0 for spawn in found])
    assert OUT_OF_SIGHT_M - 1.0 < away_m.min() < OUT_OF_SIGHT_M + 10.0
    assert away_m.max() <= OWN_REACH_M
    assert {spawn.lane[0] for spawn in found} == {"e"}
    both = filled(keeper(wanted("high", "medium")), ego_at(750.0, LANE_Y[1]))
    assert {spawn.lane[0] for spawn in both} == {"e", "w"}


def test_a_road_that_is_full_enough_is_left_alone() -> None:
    cars = [(f"e1_{lane}", float(at_m), 8.0) for lane in range(3) for at_m in range(5, 1095, 20)]
    assert look(keeper(), cars, ego_at(750.0, LANE_Y[1])).entering == []
    assert look(keeper(), cars[::2], ego_at(750.0, LANE_Y[1])).entering != []


def test_a_queue_in_sight_is_not_made_longer_from_behind() -> None:
    queue = [(f"e0_{lane}", 370.0 - 7.0 * k, 0.0) for lane in range(3) for k in range(15)]
    assert look(keeper(wanted("low")), queue[:9], ego_at(380.0, LANE_Y[1])).entering != []
    assert look(keeper(wanted("low")), queue, ego_at(380.0, LANE_Y[1])).entering == []


def test_equal_draws_are_equal_and_others_are_others() -> None:
    ego = ego_at(750.0, LANE_Y[1])
    assert filled(keeper(seed=3), ego) == filled(keeper(seed=3), ego)
    assert filled(keeper(seed=3), ego) != filled(keeper(seed=4), ego)


def test_those_that_are_far_away_leave_when_they_go_farther() -> None:
    flow, ego = keeper(), ego_at(450.0, LANE_Y[1])
    near, far = LEAVING_M - 40.0, LEAVING_M + 60.0  # e1 begins at 400 m
    assert look(flow, [("e1_0", near, 8.0), ("e1_0", far, 8.0), ("e1_1", far, 8.0)], ego).leaving == []
    assert look(flow, [("e1_0", near + 4.0, 8.0), ("e1_0", far + 4.0, 8.0), ("e1_1", far, 0.0)], ego).leaving == ["a1"]


@pytest.mark.parametrize(("ego_x", "enter"), [(100.0, False), (130.0, True)])
def test_where_the_map_begins_none_enters_in_sight_of_the_ego(ego_x: float, enter: bool) -> None:
    found = [centre_x(spawn) for _, spawn in look(keeper(), [], ego_at(ego_x, LANE_Y[1])).entering]
    assert any(x_m < ego_x for x_m in found) is enter
    assert all(abs(x_m - ego_x) >= OUT_OF_SIGHT_M for x_m in found)


def test_a_car_that_is_changing_lane_is_on_both() -> None:
    flow, ego = keeper(), ego_at(750.0, LANE_Y[1])
    car = [("e1_1", 500.0, 10.0)]
    assert len(flow.occupied(_one(car, 0.0)).on("e1_0")) == 0
    assert len(flow.occupied(_one(car, 0.3)).on("e1_0")) == 1
    inside = flow.occupied(_one([(":B_1_1", 0.1, 10.0)], 0.3))
    assert [len(inside.on(lane)) for lane in (":B_1_0", "e0_0")] == [1, 1]
    assert look(flow, car, ego).entering


def _one(car: list[Car], aside_m: float) -> OnTheRoad:
    driver = types("conservative").members[0]
    return OnTheRoad(
        ["a"], [car[0][0]], [car[0][1]], np.array([aside_m]), np.array([8.0]), [driver], np.zeros(1), np.zeros(1)
    )


@settings(max_examples=50, deadline=None)
@given(cars=st.lists(st.tuples(st.floats(20.0, 340.0), st.floats(0.0, 15.0)), max_size=8), seed=st.integers(0, 100))
def test_every_entry_starts_as_the_rules_of_the_start_demand(cars: list[tuple[float, float]], seed: int) -> None:
    cars = [car for i, car in enumerate(sorted(cars)) if i == 0 or car[0] - sorted(cars)[i - 1][0] > 5.0]
    there = [("e0_0", at_m, speed) for at_m, speed in cars]
    found = [spawn for _, spawn in look(keeper(seed=seed), there, ego_at(560.0, LANE_Y[1])).entering]
    for spawn in (each for each in found if each.lane == "e0_0"):
        driver, limit_mps = spawn.driver, NETWORK.lanes["e0_0"].limit_mps
        ahead = min((car for car in cars if car[0] > spawn.position_m), default=None)
        behind = max((car for car in cars if car[0] <= spawn.position_m), default=None)
        if ahead is not None:
            gap_m = ahead[0] - driver.length_m - spawn.position_m
            assert gap_m > 0.4
            assert (spawn.speed_mps - ahead[1]) * 3.0 <= gap_m
            assert acceleration_mps2(driver, spawn.speed_mps, limit_mps, gap_m, ahead[1]) > -3.0
        if behind is not None:
            gap_m = spawn.position_m - driver.length_m - behind[0]
            assert gap_m > 0.4
            assert (behind[1] - spawn.speed_mps) * 3.0 <= gap_m
            assert acceleration_mps2(driver, behind[1], limit_mps, gap_m, spawn.speed_mps) > -3.0


# --- on the maps -------------------------------------------------------------------------------

HTD = scene("lane_change_htd/0")


def counted(scenario: Scenario) -> tuple[float, float]:
    """Vehicles within 100 m of an ego that drives as IDM: at the start, and from second 5 on."""
    trace = drive(scenario, IdmPlanner()).trace
    assert trace is not None
    away_m = np.hypot(
        trace.actors.x_m - trace.ego.x_m[trace.actors.frame], trace.actors.y_m - trace.ego.y_m[trace.actors.frame]
    )
    within = np.bincount(trace.actors.frame[away_m <= 100.0], minlength=len(trace))
    return float(within[0]), float(within[50:].mean())


@pytest.mark.parametrize("name", few(["lane_change_ltd/6", "lane_change_mtd/5", "lane_change_htd/4"], 1))
def test_the_density_around_the_ego_is_held(name: str) -> None:
    first, later = counted(scene(name))
    assert later == pytest.approx(first, rel=0.3)


def ends(name: str, *, begins: bool) -> Floats:
    """(N, 2) where the lanes of a map begin, or end, at its edge."""
    files = find_map(name)
    network, ids = read_network(files.network), NetworkIds.read(files.ids)
    lanes = [lane for lane in network.lanes.values() if not lane.internal]
    found = [
        lane.line.points[0 if begins else -1]
        for lane in lanes
        if not (network.incoming.get(lane.id) if begins else network.links[lane.id])
    ]
    return np.array(found) + ids.origin_m


@pytest.mark.parametrize("name", few(["lane_change_mtd/9", "lane_change_htd/1"], 1))
def test_nobody_appears_or_vanishes_in_sight_but_where_the_map_ends(name: str) -> None:
    scenario = scene(name)
    trace = drive(scenario, IdmPlanner()).trace
    assert trace is not None
    came, went = list[float](), list[float]()
    for k in range(1, len(trace)):
        before, now = trace.actors.at(k - 1), trace.actors.at(k)
        for some, others, found, edge in ((now, before, came, True), (before, now, went, False)):
            limits = ends(scenario.map, begins=edge) if some.ids != others.ids else None
            for row in (row for row, each in enumerate(some.ids) if each not in set(others.ids)):
                assert limits is not None
                place = np.array((some.x_m[row], some.y_m[row]))
                if np.hypot(*(limits - place).T).min() > 25.0:
                    found.append(float(np.hypot(*(place - (trace.ego.x_m[k], trace.ego.y_m[k])))))
    assert len(came) >= 10
    assert min(came) >= 100.0
    assert min(went, default=LEAVING_M) >= 100.0
    assert min(came) < 150.0


@pytest.mark.slow
def test_the_twins_of_a_drive_are_equal_and_newcomers_have_ids_of_their_own() -> None:
    first, second = (drive(HTD, IdmPlanner()).trace for _ in range(2))
    assert first is not None
    assert second is not None
    assert first.hash() == second.hash()
    known = list(dict.fromkeys(first.actors.ids))
    assert len(known) - len(first.actors.at(0)) >= 10
    assert all(len(token) == 4 and int(token, 16) >= 0 for token in known)
    assert set(first.actors.behaviour) == {"conservative", "assertive"}


def test_for_measurements_the_traffic_is_cut_short_and_nobody_comes_later() -> None:
    roads = load_roads(HTD.map)
    ego = start_state(HTD, roads)
    with open_traffic(HTD, roads, most_agents=12) as traffic:
        *_, last = stepped(traffic, lambda _: ego, 60)
        assert len(traffic.behaviours) == 12
        assert len(last) <= 12


def flowing(number: int) -> Scenario:
    name = sorted(maps())[number % 4]
    return random_scenario(name, np.random.default_rng(number), number, obstacles=number % 2 == 0)


@pytest.mark.parametrize("number", few(range(1, 60), 1, 4))
def test_no_vehicle_appears_in_sight_or_in_anothers_way(number: int) -> None:
    audit = audited(flowing(number), seed=number, steps=200, wild=False)
    assert audit.faults == []
    assert audit.entered > 0 or number > 4
