"""From a scenario to its running traffic and the ego's first state."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain, count, islice
from pathlib import Path

import numpy as np

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map
from interplan_sumo.scenario.route import route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.flow import Flow, draw_arrivals
from interplan_sumo.simulation.lights import LoggedLights
from interplan_sumo.simulation.network import read_network
from interplan_sumo.simulation.obstacles import blockages, blocked_by, standing_actors, standing_heights_m
from interplan_sumo.simulation.pedestrians import Crowd
from interplan_sumo.simulation.replayed import ReplayedTraffic
from interplan_sumo.simulation.spawning import AHEAD_M, BEHIND_M, StagedScenario, populate
from interplan_sumo.simulation.sumo import DT_S as STEP_S
from interplan_sumo.simulation.sumo_traffic import SumoTraffic, TrafficSetup
from interplan_sumo.simulation.traffic import EgoPresence
from interplan_sumo.simulation.vehicle_types import read_vehicle_types, vehicle_type_file
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.roads import Roads


def start_state(scenario: Scenario, roads: Roads) -> EgoState:
    """The ego at t = 0: on its place, along its lane, at its start speed, steering straight."""
    pose = scenario.start.pose(roads)
    return EgoState(0.0, pose.x_m, pose.y_m, pose.heading_rad, vx_mps=scenario.start_speed_mps)


def open_traffic(
    scenario: Scenario,
    roads: Roads,
    *,
    seed: int = 0,
    vehicle_types: Path | None = None,
    shape: EgoShape = PACIFICA,
    presence: EgoPresence = EgoPresence.DRIVES,
    most_agents: int | None = None,
    reach_m: tuple[float, float] = (BEHIND_M, AHEAD_M),
) -> SumoTraffic | ReplayedTraffic:
    """The scenario's traffic at t = 0: recorded tracks where it has some, else SUMO as `open_sumo_traffic` has it."""
    if scenario.replayed:
        scenario.check(roads)
        return _replays(scenario, roads, seed)
    return open_sumo_traffic(
        scenario, roads, seed=seed, vehicle_types=vehicle_types, shape=shape,
        presence=presence, most_agents=most_agents, reach_m=reach_m,
    )  # fmt: skip


def open_sumo_traffic(
    scenario: Scenario,
    roads: Roads,
    *,
    seed: int = 0,
    vehicle_types: Path | None = None,
    shape: EgoShape = PACIFICA,
    presence: EgoPresence = EgoPresence.DRIVES,
    most_agents: int | None = None,
    reach_m: tuple[float, float] = (BEHIND_M, AHEAD_M),
) -> SumoTraffic:
    """SUMO with the scenario's traffic at t = 0. InputError if a file cannot be used, TrafficError if SUMO fails.

    For measurements, `most_agents` cuts the traffic short and lets none enter later, and `reach_m`
    spreads it (behind, ahead of the ego).
    """
    scenario.check(roads)
    files = find_map(scenario.map, scenario.maps_beside)
    network = read_network(files.network)
    ids = NetworkIds.read(files.ids)
    types = read_vehicle_types(vehicle_types or vehicle_type_file(scenario.traffic.behaviour))
    rng = scenario.rng(seed)
    tokens = opaque_ids(len(scenario.obstacles) + len(scenario.jaywalkers), rng)
    standing = standing_actors(scenario, roads, tokens[: len(scenario.obstacles)])
    blocked = blockages(network, standing, ids.origin_m)
    crowd, waiting, walked = None, blocked, blocked
    if scenario.jaywalkers:
        line = route_centerline(roads, scenario)
        crowd = Crowd(scenario, roads, line, tokens[len(scenario.obstacles) :], STEP_S)
        waiting += blocked_by(network, crowd.standing(ids.origin_m).values(), 0.0)
        walked += blocked_by(network, crowd.ways(ids.origin_m), 0.0)
    staged = StagedScenario(scenario, roads, network, ids, types, shape)
    population = populate(staged, waiting, rng, reach_m, walked)
    spawns = population.spawns[:most_agents]
    names = opaque_ids(len(spawns), rng, besides=tokens)
    flow = None
    if most_agents is None and scenario.has_flow:
        free = shuffled_ids(rng, (*tokens, *names))
        arrivals = draw_arrivals(types, rng)
        flow = Flow(network, population.demand, walked, arrivals, free, staged.route_m, rng)
    setup = TrafficSetup(
        network, ids, types, start_state(scenario, roads), population.ego_route, shape, spawns, names, standing,
        blocked, crowd=crowd, flow=flow, presence=presence,
        logged=LoggedLights.on(scenario.lights, ids.links) if scenario.lights else None, lights=population.lights,
        chance_seed=int(rng.integers(2**32)),
        heights_m=standing_heights_m(scenario, tokens[: len(scenario.obstacles)]),
    )  # fmt: skip
    return SumoTraffic(setup)


def _replays(scenario: Scenario, roads: Roads, seed: int) -> ReplayedTraffic:
    many = len(scenario.obstacles)
    tokens = opaque_ids(many + len(scenario.replayed), scenario.rng(seed))
    standing = standing_actors(scenario, roads, tokens[:many])
    heights_m = standing_heights_m(scenario, tokens[:many])
    return ReplayedTraffic(scenario.replayed, tokens[many:], standing, LoggedLights(scenario.lights), heights_m)


def opaque_ids(count: int, rng: np.random.Generator, besides: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Ids that say nothing of their bearers, in random order: four hexadecimal digits each, none of `besides`."""
    return tuple(islice(shuffled_ids(rng, besides), count))


def shuffled_ids(rng: np.random.Generator, besides: Iterable[str]) -> Iterator[str]:
    """All ids but `besides`, without end; the order of those of four digits is drawn at once, longer ones follow."""
    taken = frozenset(besides)
    drawn = (f"{number:04x}" for number in rng.permutation(16**4))
    return (token for token in chain(drawn, (f"{number:x}" for number in count(16**4))) if token not in taken)
