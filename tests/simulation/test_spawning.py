"""Start places and speeds: the density's gaps, and nobody in danger."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import two_way_road, types

from interplan_sumo.simulation import spawning
from interplan_sumo.simulation.idm import acceleration_mps2
from interplan_sumo.simulation.lane_chains import chain_through, continued_route
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.simulation.vehicle_types import VehicleType

NETWORK = two_way_road()
EGO_X = 160.0
EGO_LENGTH_M = 5.176


def fill(seed: int, largest_gap_m: float, behaviour: str = "mixed", ego_mps: float | None = 10.0) -> list[Spawn]:
    chain = chain_through(NETWORK, "e0_0", EGO_X / 400.0, set(), 120.0, 300.0)
    ego = [spawning._Fixed(0.0, EGO_LENGTH_M, ego_mps, None, 0.0)] if ego_mps is not None else []
    rng = np.random.default_rng(seed)
    return spawning._fill(NETWORK, chain, (-120.0, 300.0), [], largest_gap_m, types(behaviour), ego, rng)[0]


def place(spawn: Spawn) -> tuple[float, float]:
    """Rear and front bumper, x."""
    front = spawn.position_m + (0.0 if spawn.lane.startswith("e0") else 400.0)
    return front - spawn.driver.length_m, front


@settings(max_examples=60)
@given(seed=st.integers(0, 10_000), largest=st.sampled_from([33.0, 50.0, 100.0]), ego_mps=st.floats(0.0, 15.0))
def test_nobody_overlaps_hits_another_within_three_seconds_or_brakes_hard_at_once(
    seed: int, largest: float, ego_mps: float
) -> None:
    cars: list[tuple[float, float, float, VehicleType | None]] = [
        (*place(s), s.speed_mps, s.driver) for s in fill(seed, largest, ego_mps=ego_mps)
    ]
    cars.append((EGO_X - EGO_LENGTH_M / 2, EGO_X + EGO_LENGTH_M / 2, ego_mps, None))
    cars.sort(key=lambda car: car[0])
    for follower, leader in pairwise(cars):
        gap_m = leader[0] - follower[1]
        assert gap_m > 0.4
        assert (follower[2] - leader[2]) * 3.0 <= gap_m
        if follower[3] is not None:
            assert acceleration_mps2(follower[3], follower[2], 15.0, gap_m, leader[2]) > -3.0


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
