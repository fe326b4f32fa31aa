"""A small SUMO network for the tests: three lanes eastward, one lane westward, 1500 m, cut at 400 m.

tests/data/two_way_road.net.xml was made by netconvert from three nodes and
four edges. Lanes e0_0, e0_1, e0_2 (kerb to middle, centre lines at y = -8.75,
-5.25, -1.75), then e1_*; the other way w1_0, w0_0 at y = 1.75.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from interplan_sumo.simulation.network import SumoNetwork, plain_ids, read_network
from interplan_sumo.simulation.replayed import ReplayedTraffic
from interplan_sumo.simulation.setup import opaque_ids
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.simulation.sumo_traffic import SumoTraffic, TrafficSetup
from interplan_sumo.simulation.traffic import EgoPresence
from interplan_sumo.simulation.vehicle_types import VehicleTypes, read_vehicle_types, vehicle_type_file
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState

NETWORK_FILE = Path(__file__).parent / "data" / "two_way_road.net.xml"
LANE_Y = (-8.75, -5.25, -1.75)
WESTWARD_Y = 1.75


def two_way_road() -> SumoNetwork:
    return read_network(NETWORK_FILE)


def types(behaviour: str) -> VehicleTypes:
    return read_vehicle_types(vehicle_type_file(behaviour))


def ego_at(x_m: float, y_m: float, speed_mps: float = 8.0, time_s: float = 0.0, heading_rad: float = 0.0) -> EgoState:
    return EgoState(time_s, x_m, y_m, heading_rad, vx_mps=speed_mps)


def agent(
    behaviour: VehicleTypes, lane: str, position_m: float, speed_mps: float, route: tuple[str, ...] = ("e0", "e1")
) -> Spawn:
    return Spawn(lane, position_m, speed_mps, behaviour.members[0], route)


def traffic(
    behaviour: VehicleTypes, spawns: tuple[Spawn, ...], ego: EgoState, presence: EgoPresence = EgoPresence.DRIVES
) -> SumoTraffic:
    network = two_way_road()
    tokens = opaque_ids(len(spawns), np.random.default_rng(0))
    setup = TrafficSetup(network, plain_ids(network), behaviour, ego, ("e0", "e1"), presence=presence)
    return SumoTraffic(replace(setup, spawns=spawns, tokens=tokens))


def stepped(run: SumoTraffic | ReplayedTraffic, drive: Callable[[int], EgoState], steps: int) -> Iterator[Actors]:
    """The actors at each step of an ego's drive; the traffic moves on once they have been looked at."""
    for step in range(steps):
        yield run.observe().actors
        run.react(drive(step))
        run.place_ego(drive(step + 1))
        run.advance()
