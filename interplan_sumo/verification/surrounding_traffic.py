"""Surrounding traffic: does a drive meet the traffic that every scene of the benchmark is to have?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from interplan_sumo.families import find_family
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.spawning import oncoming_lanes
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import Trace

NEAR_M: Final = 100.0
LEAST_VEHICLES: Final = 6.0
"""So many vehicles of the traffic are that near to the ego, on average over the first"""
LEAST_ORDINARY: Final = 2.0
"""(in ordinary driving so many)"""
WITHIN_S: Final = 20.0
MOVING_MPS: Final = 1.0
CROSSING_RAD: Final = (np.radians(45.0), np.radians(135.0))
ONCOMING_RAD: Final = np.radians(150.0)
LEAST_ARMS: Final = 2
"""From so many roads at least, besides the ego's, traffic comes into a junction with cross traffic."""


@dataclass(frozen=True, slots=True)
class SurroundingTraffic:
    """Whom the ego met."""

    vehicles: float
    """Within `NEAR_M`, on average over the first `WITHIN_S`."""
    crossing: int
    """How many moved across its way within that distance."""
    oncoming: int
    """How many came towards it."""


def surrounding_traffic(trace: Trace) -> SurroundingTraffic:
    """Whom the ego of a drive met."""
    actors, ego = trace.actors, trace.ego
    rows = np.flatnonzero(actors.behaviour.astype(bool))
    frame = actors.frame[rows]
    near = np.hypot(actors.x_m[rows] - ego.x_m[frame], actors.y_m[rows] - ego.y_m[frame]) <= NEAR_M
    rows, frame = rows[near], frame[near]
    frames = max(1, min(len(trace), round(WITHIN_S / 0.1)))
    turned = np.abs(wrap_angle(actors.heading_rad[rows] - ego.heading_rad[frame]))
    moves = np.hypot(actors.vx_mps[rows], actors.vy_mps[rows]) >= MOVING_MPS
    across = moves & (turned >= CROSSING_RAD[0]) & (turned <= CROSSING_RAD[1])
    against = moves & (turned >= ONCOMING_RAD)
    ids = actors.ids[rows]
    return SurroundingTraffic(
        float((frame < frames).sum()) / frames, len(set(ids[across].tolist())), len(set(ids[against].tolist()))
    )


def passes_junction(scenario: Scenario, roads: Roads) -> bool:
    """Whether the route leads through a junction that traffic comes into from other roads as well."""
    after = scenario.route.index(roads[scenario.goal.lane].roadblock_id)
    for block in scenario.route[: after + 1]:
        link = roads.roadblocks[block]
        if not link.is_connector or link.intersection_id is None:
            continue
        others = {
            other.from_id
            for other in roads.roadblocks.values()
            if other.is_connector and other.intersection_id == link.intersection_id
        }
        if len(others - {link.from_id}) >= LEAST_ARMS:
            return True
    return False


def traffic_shortcomings(scenario: Scenario, roads: Roads, trace: Trace) -> list[str]:
    """What the traffic that a drive met lacks, one sentence each."""
    found = surrounding_traffic(trace)
    problems: list[str] = []
    least = LEAST_ORDINARY if find_family(scenario.family).ordinary else LEAST_VEHICLES
    if found.vehicles < least:
        problems.append(
            f"{found.vehicles:.1f} vehicles within {NEAR_M:.0f} m in the first {WITHIN_S:.0f} s, expected {least:.0f}"
        )
    if not found.crossing and passes_junction(scenario, roads):
        problems.append("nobody crosses the ego's way near the junction on its route")
    if not found.oncoming and oncoming_lanes(roads, scenario):
        problems.append("nobody comes towards the ego on a road of two directions")
    return problems
