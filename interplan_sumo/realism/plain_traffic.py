"""Plain traffic: SUMO alone on shipped city networks, so that vehicle-type files can be compared without any planner.

Vehicles come in at every end of the network, as a Poisson process, and take shortest ways to other ends, through
lights, turns and queues; who comes when and where, and the order of drivers, depend on the seed only. Nothing but SUMO
moves them, as in a SUMO user's own simulation with --lanechange.duration 3. What is seen of it is what recordings would
see.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from interplan_sumo.maps.store import find_map
from interplan_sumo.realism.tracks import RecordedTraffic, Track
from interplan_sumo.realism.views import RecordedView, looked_at, signalled_junctions
from interplan_sumo.simulation.network import NetworkLane, SumoNetwork, read_network
from interplan_sumo.simulation.sumo import DT_S, Commanding, close_simulation, open_simulation, sumo
from interplan_sumo.simulation.vehicle_types import VehicleType, VehicleTypes
from interplan_sumo.world.geometry import Floats

NETWORKS: Final = ("back_bay", "strip")
"""Of the shipped maps: one-way streets with lights and limits of 11 m/s, and wide avenues, which fill up."""
WARM_UP_S, LASTS_S = 120.0, 60.0
"""Lights come round once in up to 106 s, and queues need that long to be what they are."""
LANE_RATE_HZ: Final = 0.15
"""Vehicles a second that want to come in on each lane: 540 an hour, so that some junctions are at times as full as the
densest recordings."""
ROOM_M: Final = 12.0
"""Of free lane from the end of the network on before somebody comes in."""
ENTRY_S: Final = 3.0
"""Of each track are left out at its beginning: where a vehicle comes in is no driver's doing."""
BRAKING_MPS2: Final = 2.0
"""Nobody comes in faster than it could stop with this behind whoever is ahead."""


@dataclass(frozen=True, slots=True)
class _Arrival:
    """Somebody who wants to come in."""

    step: int
    lane: NetworkLane
    route: tuple[str, ...]
    driver: VehicleType


def plain_traffic(
    types: VehicleTypes, name: str, views: Sequence[RecordedView], seed: int = 0
) -> Iterator[RecordedTraffic]:
    """What recordings would see at the lights of `NETWORKS` of the drivers of a file; TrafficError if SUMO fails."""
    for each in NETWORKS:
        network = read_network(find_map(each).network)
        traffic = traffic_on(network, types, f"{name} {each}", seed)
        yield from looked_at(traffic, signalled_junctions(network), views, seed)


def traffic_on(
    network: SumoNetwork, types: VehicleTypes, name: str, seed: int, *, lane_rate_hz: float = LANE_RATE_HZ,
    fill_s: float = WARM_UP_S,
) -> RecordedTraffic:  # fmt: skip
    """A minute of traffic on a network after `fill_s` to fill it; TrafficError if SUMO fails."""
    rng = np.random.default_rng(seed)
    steps = round((fill_s + LASTS_S) / DT_S)
    arrivals = _arrivals(network, types, steps, rng, lane_rate_hz)
    open_simulation(network.path, types.sumo_document(each.driver for each in arrivals))
    try:
        return RecordedTraffic(name, name, tuple(_driven(arrivals, steps, fill_s)))
    finally:
        close_simulation()


def _arrivals(
    network: SumoNetwork, types: VehicleTypes, steps: int, rng: np.random.Generator, lane_rate_hz: float
) -> list[_Arrival]:
    """In the order of time; the same for all files but for the drivers."""
    ways = _ways(network)
    lanes = [network.lanes[lane] for edge in ways for lane in network.edges[edge]]
    found: list[_Arrival] = []
    for lane in lanes:
        at = 0.0
        while (at := at + rng.exponential(1.0 / lane_rate_hz) / DT_S) < steps:
            routes = [way for way in ways[lane.edge] if _begins(network, lane, way)]
            chosen = int(rng.integers(max(len(routes), 1)))
            driver = types.draw(rng)
            if routes:
                found.append(_Arrival(int(at), lane, routes[chosen], driver))
    return sorted(found, key=lambda each: (each.step, each.lane.id))


def _begins(network: SumoNetwork, lane: NetworkLane, way: tuple[str, ...]) -> bool:
    """Whether a way can be begun on this lane without changing it."""
    return len(way) > 1 and any(network.lanes[link.to_lane].edge == way[1] for link in network.links.get(lane.id, ()))


def _ways(network: SumoNetwork) -> dict[str, list[tuple[str, ...]]]:
    """Of each edge at which the network begins, the shortest ways, in edges, to all at which it ends."""
    after: dict[str, set[str]] = {edge: set() for edge in network.edges}
    for links in network.links.values():
        for link in links:
            after[network.lanes[link.from_lane].edge].add(network.lanes[link.to_lane].edge)
    reached = set[str]().union(*after.values())
    found: dict[str, list[tuple[str, ...]]] = {}
    for start in sorted(set(after) - reached):
        ways: dict[str, tuple[str, ...]] = {start: (start,)}
        queue = [start]
        for edge in queue:
            for then in sorted(after[edge] - ways.keys()):
                ways[then] = (*ways[edge], then)
                queue.append(then)
        ends = [way for edge, way in ways.items() if not after[edge] and len(way) > 1]
        if ends:
            found[start] = ends
    return found


def _driven(arrivals: list[_Arrival], steps: int, fill_s: float) -> Iterator[Track]:
    seen: dict[str, array[float]] = {}
    waiting: dict[str, list[tuple[int, _Arrival]]] = {}
    due = iter([*enumerate(arrivals), (len(arrivals), None)])
    number, arrival = next(due)
    for step in range(steps):
        while arrival is not None and arrival.step <= step:
            waiting.setdefault(arrival.lane.id, []).append((number, arrival))
            number, arrival = next(due)
        for queue in waiting.values():
            if queue and _comes_in(*queue[0]):
                del queue[0]
        with Commanding("step {} of plain traffic", step):
            sumo.simulationStep()
        if step * DT_S >= fill_s:
            get = sumo.vehicle
            with Commanding("reading plain traffic"):
                for id_ in get.getIDList():
                    x, y = get.getPosition(id_)
                    seen.setdefault(id_, array("d")).extend((step, x, y, get.getAngle(id_), get.getSpeed(id_)))
    for id_, numbers in seen.items():
        driver = arrivals[int(id_)].driver
        rows = np.array(numbers, dtype=np.float64).reshape(-1, 5)
        came_in = rows[0, 0] * DT_S > fill_s + DT_S / 2.0
        rows = rows[round(ENTRY_S / DT_S) if came_in else 0 :]
        if len(rows) > 1:
            yield _track(id_, rows, driver)


def _comes_in(number: int, each: _Arrival) -> bool:
    """Have SUMO insert somebody at the beginning of a lane, if there is room."""
    with Commanding("vehicle.add of a vehicle of type {!r} on lane {}", each.driver.name, each.lane.id):
        ahead = sumo.lane.getLastStepVehicleIDs(each.lane.id)
        limit_mps = min(each.lane.limit_mps * each.driver.speed_factor, each.driver.max_speed_mps)
        if ahead:
            last = min(ahead, key=sumo.vehicle.getLanePosition)
            free_m = sumo.vehicle.getLanePosition(last) - sumo.vehicle.getLength(last) - each.driver.length_m
            if free_m < ROOM_M:
                return False
            leader_mps = sumo.vehicle.getSpeed(last)
            room_m = free_m - each.driver.min_gap_m - each.driver.tau_s * leader_mps
            limit_mps = min(limit_mps, float(np.sqrt(leader_mps**2 + 2.0 * BRAKING_MPS2 * max(room_m, 0.0))))
        sumo.route.add(str(number), each.route)
        sumo.vehicle.add(
            str(number), str(number), each.driver.id, departLane=str(each.lane.index), departPos="base",
            departSpeed=f"{limit_mps:.3f}",
        )  # fmt: skip
    return True


def _track(id_: str, rows: Floats, driver: VehicleType) -> Track:
    step, front_x, front_y, angle_deg, speed_mps = rows.T
    heading_rad = np.pi / 2.0 - np.radians(angle_deg)
    back_m = driver.length_m / 2.0
    return Track(
        id_, "vehicle", DT_S * step, front_x - back_m * np.cos(heading_rad), front_y - back_m * np.sin(heading_rad),
        heading_rad, speed_mps, driver.length_m, driver.width_m,
    )  # fmt: skip
