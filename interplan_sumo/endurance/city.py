"""A district with its traffic under way: warmed up without an ego, then handed over to the segment that drives in it.

A city that is filled at random is no city yet: nobody waits at a light, nobody
follows. So plain SUMO drives it for two minutes first. Where everybody is then
is a `CityState`; a segment starts from it with its own drivers-to-come, and the
states of a cell are few enough to be kept, and many enough to differ.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import count
from pathlib import Path
from typing import Final

import numpy as np

from interplan_sumo.endurance.demand import CityFlow, city_demand, lane_kilometres
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map
from interplan_sumo.simulation.flow import draw_arrivals
from interplan_sumo.simulation.light_cycles import LightCycles
from interplan_sumo.simulation.local_demand import LocalDemand
from interplan_sumo.simulation.network import SumoNetwork, read_network
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.simulation.sumo import DT_S, Commanding, sumo
from interplan_sumo.simulation.sumo_traffic import NOWHERE_M, SumoTraffic, TrafficSetup
from interplan_sumo.simulation.traffic import EgoPresence
from interplan_sumo.simulation.vehicle_types import VehicleTypes, read_vehicle_types
from interplan_sumo.world.ego import EgoState

WARM_UP_S: Final = 120.0
"""More than a cycle of the lights: queues stand where they will stand."""
STATES: Final = 32
"""Of one cell; segments take turns."""
KEPT: Final = 40
"""Cities that a process remembers."""
FILLING: Final = 30
"""So many vehicles at most are let into an empty city at one look."""
NOBODY: Final = EgoState(0.0, NOWHERE_M, NOWHERE_M, 0.0)
"""An ego that is not there."""


@dataclass(frozen=True, slots=True, eq=False)
class CityState:
    """Where everybody is at one instant."""

    spawns: tuple[Spawn, ...]
    """All but those inside junctions."""
    lights: LightCycles
    """Each at the beginning of the phase that it is in."""


@dataclass(frozen=True)
class City:
    """A district with a number of vehicles of one population of drivers. Equal ones are one to the cache."""

    map: str
    vehicles_per_km: float
    """On a kilometre of one lane."""
    types_path: Path

    @cached_property
    def network(self) -> SumoNetwork:
        return read_network(find_map(self.map).network)

    @cached_property
    def ids(self) -> NetworkIds:
        return NetworkIds.read(find_map(self.map).ids)

    @cached_property
    def types(self) -> VehicleTypes:
        return read_vehicle_types(self.types_path)

    @cached_property
    def demand(self) -> LocalDemand:
        return city_demand(self.network, self.vehicles_per_km)

    @property
    def vehicles(self) -> int:
        """How many are kept on the roads."""
        return round(self.vehicles_per_km * lane_kilometres(self.network, self.demand))

    def flow(self, rng: np.random.Generator, tokens: Iterator[str], *, filling: bool = False) -> CityFlow:
        """What keeps it filled."""
        arrivals = draw_arrivals(self.types, rng)
        most = {"most_per_look": FILLING} if filling else {}
        return CityFlow(self.network, self.demand, self.vehicles, arrivals, tokens, rng, **most)

    def empty(self, rng: np.random.Generator) -> SumoTraffic:
        """Plain SUMO on its network, about to be filled."""
        flow = self.flow(rng, (f"w{number:06d}" for number in count()), filling=True)
        setup = TrafficSetup(
            self.network, self.ids, self.types, NOBODY, (), flow=flow, presence=EgoPresence.ABSENT,
            chance_seed=int(rng.integers(2**32)),
        )  # fmt: skip
        return SumoTraffic(setup)


def step(traffic: SumoTraffic) -> None:
    """One step of a city without an ego."""
    traffic.react(NOBODY)
    traffic.advance()


@lru_cache(maxsize=KEPT)
def city_state(city: City, number: int) -> CityState:
    """The state of that number of a city, after `WARM_UP_S`; TrafficError if SUMO fails."""
    rng = np.random.default_rng((number, *city.map.encode()))
    with city.empty(rng) as traffic:
        for _ in range(round(WARM_UP_S / DT_S)):
            step(traffic)
        return state_of(traffic, city.network)


def state_of(traffic: SumoTraffic, network: SumoNetwork) -> CityState:
    """Everybody on a lane outside junctions, with what is left of their routes, and the lights."""
    spawns: list[Spawn] = []
    agents = traffic.agents
    with Commanding("reading a city"):
        for name in agents.names:
            lane, at = sumo.vehicle.getLaneID(name), sumo.vehicle.getRouteIndex(name)
            if lane not in network.lanes or network.lanes[lane].internal:
                continue
            position_m, speed_mps = sumo.vehicle.getLanePosition(name), max(0.0, sumo.vehicle.getSpeed(name))
            route = agents.routes[name][at:]
            spawns.append(Spawn(lane, position_m, speed_mps, agents.drivers[name], route, drawn=True))
        shown = {light: sumo.trafficlight.getRedYellowGreenState(light) for light in network.lights.phases}
    known = {light: state for light, state in shown.items() if state in network.lights.states(light)}
    return CityState(tuple(spawns), network.lights.beginning(known))
