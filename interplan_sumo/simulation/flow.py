"""Flow: the density around the ego is held, out of its sight, for as long as an episode lasts.

Twice a second all stretches of road that lie beyond what the ego sees, and from
where traffic can come into sight or keeps that which is in sight from driving
off, are counted. Where there are fewer vehicles than the density wants, one
enters: where the lane has most room, as fast as its gap and all that lies ahead
allow, and never so that anybody has to brake for it; none where the ego's road
holds enough already, be it in a queue. Those that are far away and
go farther leave. Who enters is drawn before the episode: an edge
takes from its place in one ring of drivers, so that egos that drive differently
still meet much the same traffic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import hypot, inf
from typing import Protocol

import numpy as np

from interplan_sumo.scenario.scenario import SMALLEST_GAP_M
from interplan_sumo.simulation.idm import acceleration_mps2, largest_speed_mps
from interplan_sumo.simulation.lane_chains import way_ahead
from interplan_sumo.simulation.lane_occupancy import AHEAD_M, CAR_LENGTH_M, LaneOccupancy, Occupant
from interplan_sumo.simulation.local_demand import LEAST_ROAD_M, LocalDemand, agent_route
from interplan_sumo.simulation.network import NetworkLane, NetworkLink, SumoNetwork
from interplan_sumo.simulation.obstacles import LaneBlockage
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.simulation.start_speed import start_speed_mps
from interplan_sumo.simulation.vehicle_types import VehicleType, VehicleTypes
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats

OUT_OF_SIGHT_M = 110.0
"""No vehicle appears nearer to the ego: a planner sees the centres of boxes within 100 m, and both move in a step."""
OWN_REACH_M, SIDE_REACH_M = 220.0, 180.0
"""How far from the ego roads are kept filled: its own, and others that lead towards it."""
LEAVING_M = 260.0
"""Farther away, who goes farther leaves."""
LOOK_STEPS = 5
"""The roads are looked at twice a second."""
POINT_M = 0.5
"""Connectors shorter than this are no junctions, but cuts."""
POINTS_M = 10.0
"""Distances to the ego are judged at points this far apart along the roads."""
JUNCTION_S = 3.0
"""None enters nearer to a junction: those that yield there have decided without it."""
CHANGING_M = 0.1
"""A car this far from the middle of its lane is changing to another one, and may be on both."""
RING = 160
"""So many drivers are drawn beforehand."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """One in the ring of those who may enter."""

    driver: VehicleType
    share: float
    """Where it enters between the smallest gap and the largest, 0 to 1."""
    route_seed: int


@dataclass(frozen=True, slots=True, eq=False)
class OnTheRoad:
    """All agents at one instant, in SUMO's frame."""

    names: Sequence[str]
    lanes: Sequence[str]
    """'' is nowhere."""
    positions_m: Sequence[float]
    """Of the front bumpers along the lanes."""
    asides_m: Floats
    """How far their bodies are from the middle of their lanes."""
    speeds_mps: Floats
    drivers: Sequence[VehicleType]
    x_m: Floats
    y_m: Floats
    """Of the front bumpers."""


@dataclass(frozen=True, slots=True)
class Changes:
    """Who comes, with its id, and who goes, by SUMO's name."""

    entering: Sequence[tuple[str, Spawn]]
    leaving: Sequence[str]


class Inflow(Protocol):
    """What lets agents in and out while time goes on."""

    @property
    def drivers(self) -> tuple[VehicleType, ...]:
        """Of all who may enter: SUMO must know them before it starts."""
        ...

    def is_due(self) -> bool:
        """Whether to look now; to be asked once per step."""
        ...

    def changes(
        self, agents: OnTheRoad, ego: EgoState, origin_m: tuple[float, float], opens: Callable[[NetworkLink], bool]
    ) -> Changes:
        """Who enters and who leaves with the next step; `opens` tells which links are open."""
        ...


@dataclass(frozen=True, slots=True)
class _Stretch:
    """A part of an edge that is to be kept filled, between two shares of its length."""

    edge: int
    first: float
    last: float


def draw_arrivals(types: VehicleTypes, rng: np.random.Generator) -> tuple[Arrival, ...]:
    """The ring of those who may enter."""
    return tuple(Arrival(types.draw(rng), float(rng.random()), int(rng.integers(2**32))) for _ in range(RING))


class Flow:
    """What keeps the roads of one episode filled."""

    def __init__(
        self,
        network: SumoNetwork,
        demand: LocalDemand,
        blocked: Sequence[LaneBlockage],
        arrivals: Sequence[Arrival],
        tokens: Iterator[str],
        route_m: float,
        rng: np.random.Generator,
    ) -> None:
        """`tokens` are the ids of those who enter, `route_m` is the length of their routes."""
        self.network = network
        self.demand = demand
        self._blocked = blocked
        self._arrivals = arrivals
        self._tokens = tokens
        self._route_m = route_m
        self._edges = [
            edge
            for edge in sorted(demand.largest_gap_m)
            if network.lanes[network.edges[edge][0]].line.length_m >= LEAST_ROAD_M
        ]
        self._lanes = [
            [network.lanes[lane] for lane in network.edges[edge] if lane in demand.lanes] for edge in self._edges
        ]
        number_of = {edge: number for number, edge in enumerate(self._edges)}
        self._edge_of = {id: number_of[lane.edge] for id, lane in network.lanes.items() if lane.edge in number_of}
        self._next = rng.integers(len(arrivals), size=len(self._edges)).tolist()
        self._due = rng.random(len(self._edges)).tolist()  # so much of a vehicle must be missing before one enters
        lines = [network.lanes[network.edges[edge][0]].line.resampled(POINTS_M) for edge in self._edges]
        counts = [len(line.points) for line in lines]
        self._owner = np.repeat(np.arange(len(lines)), counts)
        self._points = np.concatenate([line.points for line in lines])
        shares = [line.arc_m / line.length_m for line in lines]
        self._begin = np.concatenate([np.maximum(0.0, each - each[1] / 2.0) for each in shares])
        self._end = np.concatenate([np.minimum(1.0, each + each[1] / 2.0) for each in shares])
        heading = np.concatenate([line.poses_at(line.arc_m)[:, 2] for line in lines])
        self._forward = np.stack((np.cos(heading), np.sin(heading)), axis=1)
        own = np.array([edge in demand.on_own_road for edge in self._edges])
        self._own = own[self._owner]
        lanes_m = [sum(lane.length_m for lane in lanes) for lanes in self._lanes]
        per_edge = [metres / demand.mean_gap_m(edge) for edge, metres in zip(self._edges, lanes_m, strict=True)]
        self._vehicles = np.array(per_edge)[self._owner] * (self._end - self._begin)
        self._steps = 0
        self._away_m: dict[str, float] = {}
        self._speeds: dict[tuple[str, float, float], float] = {}

    @property
    def drivers(self) -> tuple[VehicleType, ...]:
        """Of all who may enter: SUMO must know them before it starts."""
        return tuple(each.driver for each in self._arrivals)

    def speed_mps(self, driver: VehicleType, lane: NetworkLane) -> float:
        """How fast a driver goes where all gaps are the mean one of a lane's density: so fast it enters at most."""
        gap_m = self.demand.mean_gap_m(lane.edge) - CAR_LENGTH_M
        key = (driver.id, lane.limit_mps, gap_m)
        found = self._speeds.get(key)
        if found is None:
            limit_mps = lane.limit_mps
            desired_mps = min(limit_mps * driver.speed_factor, driver.max_speed_mps)
            found = self._speeds[key] = largest_speed_mps(
                [desired_mps], [lambda mps: acceleration_mps2(driver, mps, limit_mps, gap_m, mps) >= 0.0]
            )
        return found

    def is_due(self) -> bool:
        """Whether to look now; to be asked once per step."""
        self._steps += 1
        return self._steps % LOOK_STEPS == 0

    def changes(
        self, agents: OnTheRoad, ego: EgoState, origin_m: tuple[float, float], opens: Callable[[NetworkLink], bool]
    ) -> Changes:
        """Who enters and who leaves with the next step; `opens` tells which links are open."""
        x_m, y_m = ego.x_m - origin_m[0], ego.y_m - origin_m[1]
        entry = EntrySearch(self, self.occupied(agents), (x_m, y_m), opens)
        missing = self._missing(agents, x_m, y_m)
        here: dict[int, list[float]] = {}
        for lane, position_m in zip(agents.lanes, agents.positions_m, strict=True):
            number = self._edge_of.get(lane)
            if number is not None:
                here.setdefault(number, []).append(position_m / self.network.lanes[lane].length_m)
        entering: list[tuple[str, Spawn]] = []
        for stretch in self._stretches(x_m, y_m):
            count = sum(stretch.first <= share <= stretch.last for share in here.get(stretch.edge, ()))
            lanes = self._lanes[stretch.edge]
            length_m = sum(lane.length_m for lane in lanes) * (stretch.last - stretch.first)
            wanted = length_m / self.demand.mean_gap_m(self._edges[stretch.edge])
            own = self._edges[stretch.edge] in self.demand.on_own_road
            if wanted - count <= self._due[stretch.edge] or (own and missing <= 0.0):
                continue
            found = entry.somewhere(lanes, stretch.first, stretch.last, self._arrival(stretch.edge))
            if self._take(found, stretch.edge, entering) and own:
                missing -= 1.0
        return Changes(entering, self._leaving(agents, x_m, y_m))

    def route_from(self, lane: str, arrival: Arrival) -> tuple[str, ...]:
        """The route of one that enters on a lane."""
        rng = np.random.default_rng(arrival.route_seed)
        return agent_route(self.network, self.demand, lane, self._route_m, rng)

    def _arrival(self, edge: int) -> Arrival:
        return self._arrivals[self._next[edge] % len(self._arrivals)]

    def _take(self, found: Spawn | None, edge: int, entering: list[tuple[str, Spawn]]) -> bool:
        """Let one in, or, where it finds no room, have the next one try at the next look."""
        self._next[edge] += 1
        token = next(self._tokens, None) if found is not None else None
        if found is None or token is None:
            return False
        entering.append((token, found))
        return True

    def _missing(self, agents: OnTheRoad, x_m: float, y_m: float) -> float:
        """How many vehicles fewer than the density wants are on the ego's own road, near and far."""
        away_m = np.hypot(self._points[:, 0] - x_m, self._points[:, 1] - y_m)
        wanted = float(self._vehicles[self._own & (away_m <= OWN_REACH_M)].sum())
        near = np.hypot(agents.x_m - x_m, agents.y_m - y_m) <= OWN_REACH_M
        edges = (self._edge_of.get(agents.lanes[row]) for row in np.flatnonzero(near).tolist())
        return wanted - sum(edge is not None and self._edges[edge] in self.demand.on_own_road for edge in edges)

    def occupied(self, agents: OnTheRoad) -> LaneOccupancy:
        """Who is where on the lanes."""
        occupied = LaneOccupancy(self.network, self._blocked)
        lanes = self.network.lanes
        for lane, position_m, aside_m, speed_mps, driver in zip(
            agents.lanes,
            agents.positions_m,
            agents.asides_m.tolist(),
            agents.speeds_mps.tolist(),
            agents.drivers,
            strict=True,
        ):
            if lane not in lanes:
                continue
            each = Occupant(position_m, position_m - driver.length_m, speed_mps, driver)
            occupied.add(lane, each)
            if aside_m > CHANGING_M:
                edge, index = lanes[lane].edge, lanes[lane].index
                for beside in (f"{edge}_{index - 1}", f"{edge}_{index + 1}"):  # also inside junctions
                    if beside in lanes:
                        occupied.add(beside, each)
        return occupied

    def _stretches(self, x_m: float, y_m: float) -> list[_Stretch]:
        """What is to be kept filled around the ego."""
        dx, dy = x_m - self._points[:, 0], y_m - self._points[:, 1]
        away_m = np.hypot(dx, dy)
        towards = dx * self._forward[:, 0] + dy * self._forward[:, 1] > 0.0
        reached = (self._own & (away_m <= OWN_REACH_M)) | (towards & (away_m <= SIDE_REACH_M))
        rows = np.flatnonzero(reached & (away_m >= OUT_OF_SIGHT_M))
        if len(rows) == 0:
            return []
        cuts = np.flatnonzero((np.diff(rows) > 1) | (np.diff(self._owner[rows]) > 0)) + 1
        firsts, lasts = rows[np.append(0, cuts)], rows[np.append(cuts - 1, len(rows) - 1)]
        edges, first, last = self._owner[firsts].tolist(), self._begin[firsts].tolist(), self._end[lasts].tolist()
        return [_Stretch(*each) for each in zip(edges, first, last, strict=True) if self._lanes[each[0]]]

    def _leaving(self, agents: OnTheRoad, x_m: float, y_m: float) -> list[str]:
        """Those that are far away, and farther than at the last look."""
        away_m = np.hypot(agents.x_m - x_m, agents.y_m - y_m)
        before = self._away_m
        self._away_m = {agents.names[row]: float(away_m[row]) for row in np.flatnonzero(away_m > LEAVING_M).tolist()}
        return [name for name, now_m in self._away_m.items() if name in before and now_m > before[name]]


class EntrySearch:
    """One look for room, among all who are there and those who have been let in."""

    def __init__(
        self, flow: Flow, occupied: LaneOccupancy, ego_m: tuple[float, float], opens: Callable[[NetworkLink], bool]
    ) -> None:
        self._flow = flow
        self._occupied = occupied
        self._ego_m = ego_m
        self._opens = opens

    def somewhere(self, lanes: Sequence[NetworkLane], first: float, last: float, arrival: Arrival) -> Spawn | None:
        """An entry between two shares of the length of some lanes, where there is most room."""
        rooms = [self._room(lane, first * lane.length_m, last * lane.length_m, arrival) for lane in lanes]
        for _, number, centre_m in sorted(((-room_m, i, at_m) for i, (room_m, at_m) in enumerate(rooms))):
            if centre_m is not None:
                found = self._start(lanes[number], centre_m, arrival)
                if found is not None:
                    return found
        return None

    def _gap_m(self, lane: NetworkLane, arrival: Arrival) -> float:
        """From centre to centre, for cars."""
        return SMALLEST_GAP_M + arrival.share * (self._flow.demand.largest_gap_m[lane.edge] - SMALLEST_GAP_M)

    def _room(self, lane: NetworkLane, first_m: float, last_m: float, arrival: Arrival) -> tuple[float, float | None]:
        """The longest stretch where the centre of one can be, and where it would be there."""
        half_m = arrival.driver.length_m / 2.0
        longer_m = max(0.0, half_m - CAR_LENGTH_M / 2.0)
        first_m, last_m = max(first_m, half_m), min(last_m, lane.length_m - half_m)
        gap_m = self._gap_m(lane, arrival) + longer_m
        behind: float | None = None
        best: tuple[float, float | None] = (-inf, None)
        for each in (*self._occupied.on(lane.id), None):
            ahead = each.rear_m + CAR_LENGTH_M / 2.0 if each is not None else None
            low_m = first_m if behind is None else max(first_m, behind + SMALLEST_GAP_M + longer_m)
            high_m = last_m if ahead is None else min(last_m, ahead - SMALLEST_GAP_M - longer_m)
            if high_m - low_m > max(best[0], 0.0):
                if behind is None and ahead is not None and ahead - gap_m <= high_m:
                    at_m = max(low_m, ahead - gap_m)
                elif ahead is None and behind is not None and behind + gap_m >= low_m:
                    at_m = min(high_m, behind + gap_m)
                else:
                    at_m = low_m + arrival.share * (high_m - low_m)
                best = (high_m - low_m, at_m)
            behind = each.front_m - CAR_LENGTH_M / 2.0 if each is not None else None
        return best

    def _start(self, lane: NetworkLane, centre_m: float, arrival: Arrival) -> Spawn | None:
        """The start of one with its centre at a place; None if it would be seen to appear, or if no speed is safe."""
        driver, network = arrival.driver, self._flow.network
        pose = lane.plain_line.pose_at(lane.arc_of(centre_m))
        if hypot(pose.x_m - self._ego_m[0], pose.y_m - self._ego_m[1]) < OUT_OF_SIGHT_M:
            return None
        front_m = centre_m + driver.length_m / 2.0
        route = self._flow.route_from(lane.id, arrival)
        way = way_ahead(network, lane.id, route, front_m + AHEAD_M)
        ahead = self._occupied.ahead_of(way, front_m, self._opens)
        if ahead.line_m is not None and ahead.line_m < CAR_LENGTH_M:
            return None
        flowing_mps = self._flow.speed_mps(driver, lane)
        speed_mps = start_speed_mps(driver, ahead, most_mps=flowing_mps)
        if speed_mps is None or not self._occupied.leaves_room(lane.id, front_m, driver.length_m, speed_mps):
            return None
        crossing = next((part for part in way if part.lane.internal and part.lane.line.length_m > POINT_M), None)
        if crossing is not None and crossing.start_m - front_m < JUNCTION_S * speed_mps:
            return None
        self._occupied.add(lane.id, Occupant(front_m, front_m - driver.length_m, speed_mps, driver))
        return Spawn(lane.id, front_m, speed_mps, driver, route, drawn=True)
