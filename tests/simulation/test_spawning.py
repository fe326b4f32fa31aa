"""Start places and speeds: the density's gaps, and nobody in danger."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from networks import two_way_road, types

from interplan_sumo.simulation import spawning
from interplan_sumo.simulation.lane_chains import chain_through, continued_route
from interplan_sumo.simulation.spawning import Spawn

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
        rng = np.random.default_rng(seed)
        closed = [(70.0, 80.0)]  # along the chain, from the ego on
        for spawn in spawning._fill(NETWORK, chain, (-120.0, 300.0), closed, 33.0, types("mixed"), [], rng)[0]:
            rear_m, front_m = (x - EGO_X for x in place(spawn))
            gaps_m.append(max(70.0 - front_m, rear_m - 80.0))
    assert 3.0 <= min(gaps_m) < 3.2


@pytest.mark.parametrize("line_m", [16.0, 31.0])
def test_the_start_speed_before_a_closed_line_stops_with_one_and_a_half(line_m: float) -> None:
    """A metre before the line, at 1.5 m/s2."""
    speed_mps = spawning.start_speed_mps(types("conservative").members[0], 15.0, line_m, None)
    assert speed_mps == pytest.approx((2.0 * 1.5 * (line_m - 1.0)) ** 0.5)
