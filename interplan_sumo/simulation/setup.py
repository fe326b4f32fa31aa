"""From a scenario to its running traffic and the ego's first state."""

from __future__ import annotations

from pathlib import Path

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map
from interplan_sumo.scenario.route import route_lanes
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.network import read_network
from interplan_sumo.simulation.spawning import ego_sumo_route, spawn
from interplan_sumo.simulation.sumo import SumoTraffic
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
    with_ego: bool = True,
) -> SumoTraffic:
    """SUMO with the scenario's traffic at t = 0. InputError if a file cannot be used, TrafficError if SUMO fails."""
    scenario.check(roads)
    files = find_map(scenario.map)
    network = read_network(files.network)
    ids = NetworkIds.read(files.ids)
    types = read_vehicle_types(vehicle_types or vehicle_type_file(scenario.traffic.behaviour))
    rng = scenario.rng(seed)
    spawns = spawn(scenario, roads, network, ids, types, shape, rng)
    route = ego_sumo_route(network, ids, route_lanes(roads, scenario))
    ego = start_state(scenario, roads)
    return SumoTraffic(network, ids, types, spawns, ego, route, shape, rng, with_ego=with_ego)
