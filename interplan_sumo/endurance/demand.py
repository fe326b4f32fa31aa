"""Demand of a city that never empties: so many vehicles are on its roads, whoever leaves at the map's edge is replaced.

Density is held, not inflow: below the district's saturation traffic flows
however the lights fall, and no demand in excess of what the roads can carry
piles up before them. Vehicles come in at the map's edges and inside it, where
people get into their cars, out of the ego's sight; each has its whole route when
it enters, through the lane on which it enters, so that none has to force its way
into another lane. Nobody leaves but at the map's edges.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np

from interplan_sumo.scenario.scenario import SMALLEST_GAP_M, TrafficDemand
from interplan_sumo.simulation.flow import Arrival, Changes, EntrySearch, Flow, OnTheRoad
from interplan_sumo.simulation.local_demand import LocalDemand, agent_route, local_demand
from interplan_sumo.simulation.network import NetworkLane, NetworkLink, SumoNetwork
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.world.ego import EgoState

ROUTE_M: Final = 20_000.0
"""Routes that meet no edge of the map go on for longer than a segment lasts."""
AT_THE_EDGE: Final = 0.5
"""So many of those who come begin at the map's edge, the others inside."""
ROOM_M: Final = 25.0
"""Lanes shorter than this are none to begin on."""
TRIES: Final = 3
"""So many places are looked at for each vehicle that is missing, and then at the next look again."""
ROUTES: Final = 6
"""So many routes are drawn for one that enters until one passes no road twice."""
MOST_PER_LOOK: Final = 4
"""So many come at once."""


def city_demand(network: SumoNetwork, vehicles_per_km: float) -> LocalDemand:
    """Traffic of one density on all roads; `vehicles_per_km` are those on a kilometre of one lane."""
    every = local_demand(network, TrafficDemand("low"), network.edges, ())
    largest_m = max(2.0 * 1000.0 / vehicles_per_km - SMALLEST_GAP_M, SMALLEST_GAP_M + 1.0)
    return replace(every, largest_gap_m=dict.fromkeys(every.largest_gap_m, largest_m))


def lane_kilometres(network: SumoNetwork, demand: LocalDemand) -> float:
    """Of the lanes that can be driven on for good, without junctions."""
    return sum(network.lanes[lane].length_m for lane in demand.lanes) / 1000.0


class CityFlow(Flow):
    """Keeps a number of vehicles on the roads of a district."""

    def __init__(
        self,
        network: SumoNetwork,
        demand: LocalDemand,
        vehicles: int,
        arrivals: Sequence[Arrival],
        tokens: Iterator[str],
        rng: np.random.Generator,
        most_per_look: int = MOST_PER_LOOK,
    ) -> None:
        """`tokens` are the ids of those who enter; what is drawn comes from `rng`."""
        super().__init__(network, demand, (), arrivals, tokens, ROUTE_M, rng)
        self.vehicles = vehicles
        self._rng = rng
        self._most_per_look = most_per_look
        lanes = [network.lanes[lane] for lane in sorted(demand.lanes)]
        self._inside = [lane for lane in lanes if lane.length_m >= ROOM_M]
        self._edge = [lane for lane in self._inside if not network.incoming.get(lane.id)]

    @cached_property
    def _upto_m(self) -> np.ndarray:
        return np.cumsum([lane.length_m for lane in self._inside])

    def changes(
        self, agents: OnTheRoad, ego: EgoState, origin_m: tuple[float, float], opens: Callable[[NetworkLink], bool]
    ) -> Changes:
        """Those who replace whoever has left; nobody is taken away."""
        missing = min(self.vehicles - len(agents.names), self._most_per_look)
        if missing <= 0 or not self._inside:
            return Changes((), ())
        entry = EntrySearch(self, self.occupied(agents), (ego.x_m - origin_m[0], ego.y_m - origin_m[1]), opens)
        entering: list[tuple[str, Spawn]] = []
        for _ in range(missing * TRIES):
            lane = self._drawn_lane()
            seed, which = int(self._rng.integers(2**32)), int(self._rng.integers(len(self._arrivals)))
            arrival = replace(self._arrivals[which], share=float(self._rng.random()), route_seed=seed)
            found = entry.somewhere([lane], 0.0, 1.0, arrival)
            token = next(self._tokens, None) if found is not None else None
            if found is not None and token is not None:
                entering.append((token, found))
                if len(entering) == missing:
                    break
        return Changes(entering, ())

    def _drawn_lane(self) -> NetworkLane:
        if self._edge and float(self._rng.random()) < AT_THE_EDGE:
            return self._edge[int(self._rng.integers(len(self._edge)))]
        row = int(np.searchsorted(self._upto_m, self._rng.random() * self._upto_m[-1], side="right"))
        return self._inside[min(row, len(self._inside) - 1)]

    def route_from(self, lane: str, arrival: Arrival) -> tuple[str, ...]:
        """From a lane to the map's edge, without changing lane; of several the one that passes fewest roads twice."""
        found: list[tuple[str, ...]] = []
        for number in range(ROUTES):
            rng = np.random.default_rng((arrival.route_seed, number))
            found.append(agent_route(self.network, self.demand, lane, ROUTE_M, rng))
            if _repeats(found[-1]) == 0:
                return found[-1]
        return min(found, key=_repeats)


def _repeats(route: tuple[str, ...]) -> int:
    return len(route) - len(set(route))
