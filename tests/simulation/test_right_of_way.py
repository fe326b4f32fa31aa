"""At junctions the ego, which SUMO does not drive, is respected where it has right of way and no ghost where not."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import shapely
from networks import stepped

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map
from interplan_sumo.simulation.lane_chains import continued_route
from interplan_sumo.simulation.network import NetworkLink, SumoNetwork, read_network
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.simulation.sumo_traffic import SumoTraffic, TrafficSetup
from interplan_sumo.simulation.traffic import EgoPresence
from interplan_sumo.simulation.vehicle_types import read_vehicle_types, vehicle_type_file
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Polyline, box_corners, penetration_m
from interplan_sumo.world.signals import SignalStatus
from tests.quick import DISTRICTS

APPROACH_M = 45.0
EGO_MPS = 9.0


@dataclass(frozen=True)
class Crossing:
    """Two ways over a junction that cross: `first` has priority, `second` must yield."""

    map: str
    first: NetworkLink
    second: NetworkLink


@cache
def first_crossing(name: str) -> Crossing:
    network = read_network(find_map(name).network)
    links = [link for ways in network.links.values() for link in ways if link.via]
    long_enough = [link for link in links if network.lanes[link.from_lane].length_m > APPROACH_M + 5.0]
    return next(
        Crossing(name, first, second)
        for first in long_enough
        if first.direction == "s"
        for second in long_enough
        if junction(first) == junction(second) and must_yield(network, first, second)
        if way(network, first).linestring.crosses(way(network, second).linestring)
    )


def junction(link: NetworkLink) -> str:
    return link.via[0].rsplit("_", 2)[0]


def must_yield(network: SumoNetwork, first: NetworkLink, second: NetworkLink) -> bool:
    """Whether `second` must let `first` pass, by sign or while both show green."""
    if first.light is None or second.light is None:
        return first.light is second.light is None and first.major and not second.major
    states = network.lights.states(first.light[0])
    mine, other = first.light[1], second.light[1]
    return any((s[mine], s[other]) == ("G", "g") for s in states) and all(s[other] != "G" for s in states)


def way(network: SumoNetwork, link: NetworkLink) -> Polyline:
    """The centre line over the junction, with the lanes before and behind it."""
    line = network.lanes[link.from_lane].line
    for lane in (*link.via, link.to_lane):
        line = line.joined(network.lanes[lane].line)
    return line


def drive(
    crossing: Crossing,
    ego_on: NetworkLink,
    agent_on: NetworkLink,
    *,
    meet_s: float | None,
    presence: EgoPresence = EgoPresence.DRIVES,
) -> tuple[float, float]:
    """(When the agent gets to where the ways cross, deepest penetration of the two boxes).

    The ego is there at `meet_s`; None: it stands there from the beginning.
    """
    files = find_map(crossing.map)
    network, ids = read_network(files.network), NetworkIds.read(files.ids)
    types = read_vehicle_types(vehicle_type_file("conservative"))
    mine, other = way(network, ego_on), way(network, agent_on)
    point = shapely.get_coordinates(shapely.intersection(mine.linestring, other.linestring))[0]
    meet_m, conflict_m = mine.project_point(*point)[0], other.project_point(*point)[0]
    from_lane = network.lanes[agent_on.from_lane]
    speed_mps = 8.0
    at_m = from_lane.length_m - APPROACH_M

    def ego(step: int) -> EgoState:
        time_s = 0.1 * step
        arc_m = meet_m if meet_s is None else meet_m + EGO_MPS * (time_s - meet_s)
        pose = mine.pose_at(float(np.clip(arc_m, 3.0, mine.length_m - 3.0)))
        x, y = pose.x_m + ids.origin_m[0], pose.y_m + ids.origin_m[1]
        return EgoState(time_s, x, y, pose.heading_rad, vx_mps=0.0 if meet_s is None else EGO_MPS)

    def edges(link: NetworkLink) -> tuple[str, ...]:
        return (network.lanes[link.from_lane].edge, *continued_route(network, link.to_lane, 300.0))

    spawn = Spawn(agent_on.from_lane, at_m, speed_mps, types.members[0], edges(agent_on))
    arrives_s, deepest = np.inf, -np.inf
    setup = TrafficSetup(network, ids, types, ego(0), edges(ego_on), spawns=(spawn,), tokens=("a",), presence=presence)
    with SumoTraffic(setup) as traffic:
        green = [connector for connector, link in ids.links.items() if link in (ego_on.light, agent_on.light)]
        traffic.impose_signals(dict.fromkeys(green, SignalStatus.GREEN))
        for step, actors in enumerate(stepped(traffic, ego, 220)):
            if not len(actors):
                break
            here_m = other.project_point(actors.x_m[0] - ids.origin_m[0], actors.y_m[0] - ids.origin_m[1])[0]
            if here_m + actors.length_m[0] / 2.0 > conflict_m:
                arrives_s = min(arrives_s, 0.1 * step)
            now = ego(step)
            box = box_corners(now.x_m, now.y_m, now.heading_rad, PACIFICA.length_m, PACIFICA.width_m)
            deepest = max(deepest, float(penetration_m(box, actors.corners)[0]))
    return arrives_s, deepest


@pytest.mark.parametrize("name", DISTRICTS)
def test_a_turning_car_lets_an_ego_with_right_of_way_pass(name: str) -> None:
    crossing = first_crossing(name)
    alone_s, _ = drive(crossing, crossing.first, crossing.second, meet_s=99.0, presence=EgoPresence.ABSENT)
    arrives_s, deepest = drive(crossing, crossing.first, crossing.second, meet_s=alone_s + 0.5)
    assert alone_s < 16.0
    assert deepest < 0.0
    assert arrives_s > alone_s + 0.5


@pytest.mark.parametrize("name", DISTRICTS)
def test_a_car_with_right_of_way_does_not_drive_through_an_ego_that_stands_in_its_way(name: str) -> None:
    crossing = first_crossing(name)
    arrives_s, deepest = drive(crossing, crossing.second, crossing.first, meet_s=None)
    assert deepest < 0.0
    assert arrives_s == np.inf
