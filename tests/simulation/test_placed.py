"""Vehicles that a scenario places: exactly there, exactly so fast, of that kind, and the others leave them room."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import hypot

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import stepped, two_way_road, types
from random_drives import overlapping

from interplan_sumo.errors import ScenarioError, VehicleTypeError
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.scenario.scenario import LanePosition, PlacedVehicle, Scenario, TrafficDemand, VehicleKind
from interplan_sumo.simulation import spawning
from interplan_sumo.simulation.idm import acceleration_mps2
from interplan_sumo.simulation.lane_chains import chain_through
from interplan_sumo.simulation.network import read_network
from interplan_sumo.simulation.setup import open_traffic, start_state
from interplan_sumo.simulation.vehicle_types import VehicleType, vehicle_type_file
from interplan_sumo.world.actors import Actors
from tests.quick import DISTRICTS
from tests.scenes import scene

LTD = scene("lane_change_ltd/0")
URBAN = vehicle_type_file("urban")
EMPTY = replace(LTD, id="test/placed", traffic=TrafficDemand("none"))


def start(scenario: Scenario, *, steps: int = 0) -> Actors:
    with open_traffic(scenario, load_roads(LTD.map), vehicle_types=URBAN) as traffic:
        ego = start_state(scenario, load_roads(LTD.map))
        *_, actors = stepped(traffic, lambda _: ego, steps + 1)
        return actors


def placed(*vehicles: PlacedVehicle, scenario: Scenario = EMPTY) -> Scenario:
    return replace(scenario, vehicles=vehicles)


LENGTH_M: dict[VehicleKind, float] = {"car": 4.6, "truck": 8.0, "bus": 12.0, "motorcycle": 2.2}


@pytest.mark.parametrize("kind", ["car", "truck", "bus", "motorcycle"])
def test_a_vehicle_starts_with_its_centre_where_it_is_placed_at_its_speed_and_drives_on(kind: VehicleKind) -> None:
    scenario = placed(PlacedVehicle(LanePosition("402031", 100.0), 7.25, kind))
    first, later = start(scenario), start(scenario, steps=20)
    pose = LanePosition("402031", 100.0).pose(load_roads(LTD.map))
    assert len(first) == 1
    assert first.length_m[0] == pytest.approx(LENGTH_M[kind])
    assert (first.x_m[0], first.y_m[0]) == pytest.approx((pose.x_m, pose.y_m), abs=0.005)
    assert first.heading_rad[0] == pytest.approx(pose.heading_rad, abs=1e-3)
    assert first.speed_mps[0] == pytest.approx(7.25, abs=1e-9)
    assert hypot(later.x_m[0] - first.x_m[0], later.y_m[0] - first.y_m[0]) > 14.5


def test_a_vehicle_may_be_placed_anywhere_on_any_lane_of_a_map() -> None:
    """Also where a lane is cut into several edges for SUMO, and far from all lanes that a density would fill."""
    roads, files = load_roads(LTD.map), find_map(LTD.map)
    network, ids = read_network(files.network), NetworkIds.read(files.ids)
    cut = next(lane for lane, pieces in ids.pieces.items() if len(pieces) > 1 and lane in roads.lanes)
    rng = np.random.default_rng(0)
    places = [LanePosition(cut, piece.end_m) for piece in ids.pieces[cut][:-1]]
    for lane in rng.choice(sorted(roads.lanes), 30, replace=False).tolist():
        places.append(LanePosition(lane, float(rng.uniform(3.0, roads[lane].centerline.length_m - 3.0))))
    assert any(network.lanes[ids.sumo_place(each.lane, each.arc_m)[0]].index > 0 for each in places)
    actors = start(placed(*(PlacedVehicle(place, 5.0) for place in places)))
    assert len(actors) == len(places)
    assert actors.speed_mps.max() == pytest.approx(5.0, abs=1e-9)
    assert np.sum(actors.speed_mps < 4.99) <= 4  # right before red lights and junctions
    for pose in (place.pose(roads) for place in places):
        assert np.hypot(actors.x_m - pose.x_m, actors.y_m - pose.y_m).min() < 0.1  # in bends it cuts in


@pytest.mark.parametrize("over_mps", [-0.5, 5.0])
def test_a_vehicle_may_start_faster_than_the_limit_and_then_keeps_it(over_mps: float) -> None:
    limit_mps = load_roads(LTD.map)["402031"].speed_limit_mps
    assert limit_mps is not None
    scenario = placed(PlacedVehicle(LanePosition("402031", 60.0), limit_mps + over_mps))
    ego = start_state(scenario, load_roads(LTD.map))
    with open_traffic(scenario, load_roads(LTD.map), vehicle_types=URBAN) as traffic:
        speeds = [float(actors.speed_mps[0]) for actors in stepped(traffic, lambda _: ego, 61)]
    assert speeds[0] == pytest.approx(limit_mps + over_mps, abs=1e-6)
    if over_mps > 0.0:
        assert speeds[0] > speeds[1] > speeds[2]
    assert speeds[60] < limit_mps + 0.6 * max(0.0, over_mps)


def test_equal_seeds_give_equal_drivers() -> None:
    scenario = placed(*(PlacedVehicle(LanePosition("402031", 60.0 + 30.0 * i), 8.0) for i in range(4)))
    with open_traffic(scenario, load_roads(LTD.map), seed=1) as traffic:
        first = dict(traffic.behaviours)
    with open_traffic(scenario, load_roads(LTD.map), seed=1) as traffic:
        assert dict(traffic.behaviours) == first
    assert set(first.values()) <= {"conservative", "assertive"}


def test_a_file_without_the_kind_is_refused_by_name() -> None:
    scenario = placed(PlacedVehicle(LanePosition("402031", 100.0), 5.0, "bus"))
    with pytest.raises(
        VehicleTypeError, match=r'mixed\.xml: no vType that .traffic. stands for is a bus \(vClass="bus"'
    ):
        open_traffic(scenario, load_roads(LTD.map))


@pytest.mark.parametrize(
    ("vehicle", "message"),
    [
        (PlacedVehicle(LanePosition("402031", 1.0), 5.0), r"vehicles\[0\] .* reaches beyond lane 402031"),
        (PlacedVehicle(LanePosition("402031", 100.0), 58.0), r"vehicles\[0\]\.speed_mps is 58, its type .* reaches 55"),
    ],
)
def test_a_vehicle_that_cannot_start_there_is_refused(vehicle: PlacedVehicle, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        open_traffic(placed(vehicle), load_roads(LTD.map))


def test_a_vehicle_cannot_be_placed_inside_a_junction() -> None:
    connector = sorted(load_roads(LTD.map).connectors)[0]
    place = LanePosition(connector, load_roads(LTD.map)[connector].centerline.length_m / 2.0)
    with pytest.raises(ScenarioError, match="inside a junction"):
        open_traffic(placed(PlacedVehicle(place, 5.0)), load_roads(LTD.map))


NETWORK = two_way_road()
LIMIT_MPS = NETWORK.lanes["e0_0"].limit_mps
EGO_X, EGO_LENGTH_M = 160.0, 5.176
FIXED = st.lists(
    st.tuples(st.floats(-110.0, 230.0), st.floats(0.0, 15.0), st.sampled_from([2.2, 4.6, 12.0])), max_size=4
)


@settings(max_examples=60)
@given(seed=st.integers(0, 10_000), largest=st.sampled_from([33.0, 50.0, 100.0]), cars=FIXED)
def test_drawn_traffic_leaves_room_around_placed_vehicles(
    seed: int, largest: float, cars: list[tuple[float, float, float]]
) -> None:
    driver = types("urban").members[0]
    cars = [car for i, car in enumerate(sorted(cars)) if i == 0 or car[0] - sorted(cars)[i - 1][0] > 15.0]
    fixed = [
        spawning._Fixed(centre_m, length_m, speed_mps, replace(driver, length_m=length_m), LIMIT_MPS)
        for centre_m, speed_mps, length_m in cars
        if abs(centre_m) > 20.0
    ]
    fixed.append(spawning._Fixed(0.0, EGO_LENGTH_M, 8.0, None, 0.0))
    fixed.sort(key=lambda each: -each.centre_m)
    chain = chain_through(NETWORK, "e0_0", EGO_X / 400.0, set(), 120.0, 300.0)
    rng = np.random.default_rng(seed)
    drawn = spawning._fill(chain, (-120.0, 300.0), [], largest, types("urban"), fixed, rng)
    line: list[tuple[float, float, float, VehicleType | None, bool]] = []  # rear, front, speed, driver, drawn
    for lane, position_m, speed_mps, driver in drawn:
        front_m = position_m + (0.0 if lane.startswith("e0") else 400.1) - EGO_X
        line.append((front_m - driver.length_m, front_m, speed_mps, driver, True))
    for each in fixed:
        half_m = each.length_m / 2.0
        line.append((each.centre_m - half_m, each.centre_m + half_m, each.speed_mps, each.driver, False))
    line.sort(key=lambda car: car[0])
    for follower, leader in pairwise(line):
        if not (follower[4] or leader[4]):
            continue  # two that are placed are the scenario's affair
        gap_m = leader[0] - follower[1]
        assert gap_m > 0.4
        assert (follower[2] - leader[2]) * 3.0 <= gap_m
        if follower[3] is not None:
            assert acceleration_mps2(follower[3], follower[2], LIMIT_MPS, gap_m, leader[2]) > -3.0


@pytest.mark.parametrize("name", DISTRICTS)
def test_amid_dense_traffic_nobody_overlaps_a_placed_vehicle(name: str) -> None:
    roads = load_roads(name)
    lane = next(each for each in roads.lanes.values() if each.centerline.length_m > 150.0)
    block = roads.roadblocks[lane.roadblock_id].lane_ids
    vehicles = tuple(PlacedVehicle(LanePosition(each, 100.0 + 7.0 * i), 6.0) for i, each in enumerate(block))
    scenario = Scenario(
        "test/0", "test", name, LanePosition(lane.id, 50.0), 8.0, LanePosition(lane.id, 140.0), (lane.roadblock_id,),
        TrafficDemand("high", "mixed", "high"), vehicles=vehicles,
    )  # fmt: skip
    for seed in range(3):
        with open_traffic(scenario, roads, seed=seed) as traffic:
            actors = traffic.observe().actors
        assert len(actors) > len(vehicles)
        assert overlapping(actors) == []
        for vehicle in vehicles:
            pose = vehicle.place.pose(roads)
            nearest = int(np.argmin(np.hypot(actors.x_m - pose.x_m, actors.y_m - pose.y_m)))
            assert actors.speed_mps[nearest] == pytest.approx(6.0, abs=1e-9)
