"""Long vehicles wait for whom their rear would touch in a turn."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

from interplan_sumo.simulation.agent_registry import AgentSnapshot
from interplan_sumo.simulation.long_vehicles import LongVehicles
from interplan_sumo.simulation.network import NetworkLane, SumoNetwork
from interplan_sumo.simulation.vehicle_types import VehicleType
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Polyline

RADIUS_M = 12.0
AHEAD_M = 20.0
"""Straight on, then a quarter of a circle to the left."""
BUS = VehicleType("bus", length_m=12.0, width_m=2.55, decel_mps2=2.0)
CAR = VehicleType("car", length_m=4.6, width_m=1.85)
FAR = EgoState(0.0, 500.0, 500.0, 0.0)
Place = tuple[VehicleType, float, float, float]
"""Of the front bumper: x, y, heading."""


def turn() -> SumoNetwork:
    angle = np.linspace(0.0, pi / 2.0, 31)
    bend = np.stack((AHEAD_M + RADIUS_M * np.sin(angle), RADIUS_M * (1.0 - np.cos(angle))), axis=1)
    line = Polyline(np.concatenate(([(0.0, 0.0)], bend)))
    lane = NetworkLane("l_0", "l", 0, line, line.length_m, 3.5, 13.9, internal=False)
    return SumoNetwork(Path("none"), {lane.id: lane}, {}, {})


def in_the_turn(driver: VehicleType, angle_rad: float, turned_rad: float) -> tuple[Place, float]:
    """A vehicle whose front is in the bend, its body `turned_rad` less than the lane there; and its lane position."""
    x, y = AHEAD_M + RADIUS_M * np.sin(angle_rad), RADIUS_M * (1.0 - np.cos(angle_rad))
    return (driver, float(x), float(y), angle_rad - turned_rad), AHEAD_M + RADIUS_M * angle_rad


def waiting(
    places: Sequence[Place], positions_m: Sequence[float], ego: EgoState = FAR, speed_mps: ArrayLike = 2.0
) -> list[int]:
    names = tuple(f"a{i}" for i in range(len(places)))
    x, y, heading = np.array([place[1:] for place in places]).T
    at = dict(zip(names, positions_m, strict=True))
    rows = {name: row for row, name in enumerate(names)}
    now = AgentSnapshot(
        names, rows, x, y, heading, np.broadcast_to(np.asarray(speed_mps, dtype=np.float64), x.shape), {}, frozenset(),
        lambda asked: ["l_0" for _ in asked], lambda asked: [at[name] for name in asked], lambda _: (),
    )  # fmt: skip

    def corridors(_: AgentSnapshot, asked: Sequence[str]) -> list[tuple[str, dict[str, float]]]:
        return [("l_0", {"l_0": 0.0}) for _ in asked]

    drivers = {name: place[0] for name, place in zip(names, places, strict=True)}
    return LongVehicles(turn(), drivers, PACIFICA, (0.0, 0.0)).waiting(now, ego, corridors)


INSIDE: Place = (CAR, 24.0, 4.0, 0.2)
"""Beside the lane on the inside of the bend."""


@pytest.mark.parametrize(("driver", "waits"), [(BUS, [0]), (CAR, [])])
def test_a_bus_waits_for_a_car_on_the_inside_of_the_turn_where_a_car_goes_on(
    driver: VehicleType, waits: list[int]
) -> None:
    place, position_m = in_the_turn(driver, 0.6, 0.4)
    assert waiting([place, INSIDE], [position_m, 0.0]) == waits


def test_it_waits_for_the_ego_as_well_and_while_it_stands() -> None:
    place, position_m = in_the_turn(BUS, 0.6, 0.4)
    inside = EgoState(0.0, 21.5, 3.5, 0.2)
    assert waiting([place], [position_m]) == []
    assert waiting([place], [position_m], inside) == [0]
    nearer: Place = (CAR, 31.0, 4.8, 0.2)
    assert waiting([place, INSIDE], [position_m, 0.0], speed_mps=0.0) == []  # for half a metre it could go on
    assert waiting([place, nearer], [position_m, 0.0], speed_mps=0.0) == [0]


def test_on_the_outside_and_before_the_turn_nobody_is_waited_for() -> None:
    place, position_m = in_the_turn(BUS, 0.6, 0.4)
    outside: Place = (CAR, 30.0, 0.0, 0.3)
    assert waiting([place, outside], [position_m, 0.0]) == []
    straight: Place = (BUS, 14.0, 0.0, 0.0)
    assert waiting([straight, (CAR, 14.0, 2.6, 0.0)], [14.0, 0.0]) == []


def test_of_two_that_wait_for_one_another_one_goes_first() -> None:
    place, position_m = in_the_turn(BUS, 0.6, 0.4)
    beside: Place = (BUS, place[1] - 2.4, place[2] + 2.8, place[3])
    assert len(waiting([place, beside], [position_m, position_m])) <= 1


def on_the_bend(driver: VehicleType, position_m: float, left_m: float, turned_rad: float = 0.0) -> Place:
    """A vehicle so far beside the middle of the lane, its body `turned_rad` less than the lane there."""
    there = turn().lanes["l_0"].plain_line.pose_at(position_m)
    x, y = there.x_m - left_m * np.sin(there.heading_rad), there.y_m + left_m * np.cos(there.heading_rad)
    return driver, float(x), float(y), there.heading_rad - turned_rad


@pytest.mark.parametrize(("behind_m", "left_m", "waits"), [(6.0, 3.0, [0]), (14.0, 3.0, []), (6.0, 5.0, [])])
def test_it_foresees_that_a_car_beside_it_comes_along_on_the_inside(
    behind_m: float, left_m: float, waits: list[int]
) -> None:
    bus, beside = on_the_bend(BUS, 22.0, 0.0, 0.1), on_the_bend(CAR, 22.0 - behind_m, left_m)
    assert waiting([bus, beside], [22.0, 22.0 - behind_m], speed_mps=6.0) == waits


@pytest.mark.parametrize(("ahead_mps", "waits"), [(6.0, []), (0.0, [0])])
def test_it_follows_a_car_ahead_and_brakes_for_one_that_stands_there(ahead_mps: float, waits: list[int]) -> None:
    bus, ahead = on_the_bend(BUS, 22.0, 0.0, 0.1), on_the_bend(CAR, 32.0, 0.0)
    assert waiting([bus, ahead], [22.0, 32.0], speed_mps=(6.0, ahead_mps)) == waits
