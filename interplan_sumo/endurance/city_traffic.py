"""The traffic of a segment: a district under way, with the ego in it and rare events staged around it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from interplan_sumo.endurance.city import City, CityState, city_state
from interplan_sumo.endurance.staged import Staging
from interplan_sumo.endurance.trip_way import TripWay
from interplan_sumo.scenario.route import route_lanes
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.lane_chains import ego_sumo_route, way_ahead
from interplan_sumo.simulation.lane_occupancy import LaneOccupancy, Occupant
from interplan_sumo.simulation.network import opens_freely
from interplan_sumo.simulation.setup import opaque_ids, shuffled_ids, start_state
from interplan_sumo.simulation.spawning import Spawn, settled
from interplan_sumo.simulation.start_speed import start_speed_mps
from interplan_sumo.simulation.sumo_traffic import SumoTraffic, TrafficSetup
from interplan_sumo.simulation.traffic import Traffic, TrafficState
from interplan_sumo.simulation.vehicle_types import VehicleType
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.roads import Roads

AROUND_M: Final = 150.0
"""Who is farther from the ego is neither told nor written down: planners see 100 m."""
CLEAR_M: Final = (25.0, 10.0)
"""Nobody is so near behind and ahead of the ego when it begins."""
LOOK_AHEAD_M: Final = 150.0


def open_trip(
    scenario: Scenario, roads: Roads, city: City, state: int, rng: np.random.Generator, shape: EgoShape
) -> tuple[Scenario, SumoTraffic, Staging]:
    """SUMO with a trip's traffic at its start; the scenario comes back with a start speed that suits it.

    TrafficError if SUMO fails.
    """
    network, ids = city.network, city.ids
    now = city_state(city, state)
    ego_route = ego_sumo_route(network, ids, route_lanes(roads, scenario))
    lane, fraction = ids.sumo_place(scenario.start.lane, scenario.start.arc_m)
    front_m = fraction * network.lanes[lane].length_m + shape.length_m / 2.0
    spawns = _out_of_its_way(now, lane, front_m, shape.length_m)
    speed_mps = _start_speed_mps(city, now, spawns, (lane, front_m), ego_route)
    occupied = LaneOccupancy(network)
    occupied.add(lane, Occupant(front_m, front_m - shape.length_m, speed_mps))
    # Who stands in a queue stands where SUMO has put it, however short the gap: it is none to be left out.
    kept = settled(network, [replace(each, drawn=False) for each in spawns], occupied, now.lights)
    spawns = [replace(each, drawn=True) for each in kept]
    scenario = replace(scenario, start_speed_mps=round(speed_mps, 2))
    tokens = opaque_ids(len(spawns), rng)
    names = shuffled_ids(rng, tokens)
    staging = Staging(TripWay(scenario, roads), network, ids, names, shape)
    setup = TrafficSetup(
        network, ids, city.types, start_state(scenario, roads), ego_route, shape, tuple(spawns), tokens,
        crowd=staging.people, flow=city.flow(rng, names), lights=now.lights, chance_seed=int(rng.integers(2**32)),
        acts=staging.most_mps, runs_red=staging.runs_red,
    )  # fmt: skip
    return scenario, SumoTraffic(setup), staging


def _out_of_its_way(state: CityState, lane: str, front_m: float, length_m: float) -> list[Spawn]:
    """All but those too near to where the ego begins."""
    behind_m, ahead_m = front_m - length_m - CLEAR_M[0], front_m + CLEAR_M[1]
    return [
        each
        for each in state.spawns
        if each.lane != lane or each.position_m < behind_m or each.position_m - each.driver.length_m > ahead_m
    ]


def _start_speed_mps(
    city: City, state: CityState, spawns: list[Spawn], at: tuple[str, float], ego_route: tuple[str, ...]
) -> float:
    """As fast as an ordinary driver would begin there."""
    network, (lane, front_m) = city.network, at
    occupied = LaneOccupancy(network)
    for each in spawns:
        rear_m = each.position_m - each.driver.length_m
        occupied.add(each.lane, Occupant(each.position_m, rear_m, each.speed_mps, each.driver))
    way = way_ahead(network, lane, ego_route, front_m + LOOK_AHEAD_M)
    ahead = occupied.ahead_of(way, front_m, partial(opens_freely, state.lights))
    return start_speed_mps(VehicleType("ego"), ahead) or 0.0


class NearTraffic:
    """A district's traffic as far as the ego is concerned."""

    def __init__(self, traffic: Traffic, ego: EgoState) -> None:
        self._traffic = traffic
        self._ego = ego

    @property
    def behaviours(self) -> Mapping[str, str]:
        return self._traffic.behaviours

    @property
    def heights_m(self) -> Mapping[str, float]:
        return self._traffic.heights_m

    def observe(self) -> TrafficState:
        """The scene within `AROUND_M` of the ego."""
        scene = self._traffic.observe()
        there = scene.actors.within(self._ego.x_m, self._ego.y_m, AROUND_M)
        told = frozenset(there.ids)
        without = {name: value for name, value in (scene.ax_without_ego or {}).items() if name in told}
        return TrafficState(there, scene.signals, without)

    def react(self, ego: EgoState) -> None:
        self._ego = ego
        self._traffic.react(ego)

    def place_ego(self, ego: EgoState) -> None:
        self._ego = ego
        self._traffic.place_ego(ego)

    def advance(self) -> None:
        self._traffic.advance()

    def close(self) -> None:
        self._traffic.close()
