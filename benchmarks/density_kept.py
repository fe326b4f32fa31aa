"""Is the density kept? python -m benchmarks.density_kept [--suite interplan==1] [--planner idm] [--seeds 3]

Moving vehicles within 100 m of the ego at the start and, on average, from second 5 until the drive ends, per density
of the scenes. Besides: how many the lanes in reach would hold at the scene's densities at the start and later, which
tells what the geometry of a start explains, and how many of those there later stand, in queues and before red lights.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.planner import load_planner
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import find_suite
from interplan_sumo.simulation.episode import drive
from interplan_sumo.simulation.local_demand import LocalDemand
from interplan_sumo.simulation.network import SumoNetwork, read_network
from interplan_sumo.simulation.spawning import StagedScenario, populate
from interplan_sumo.simulation.vehicle_types import read_vehicle_types, vehicle_type_file
from interplan_sumo.world.geometry import Floats

SIGHT_M = 100.0
LATER_STEP = 50
"""From this frame on it is later."""
LEAST_STEPS = 20
"""Drives that last no longer after that say nothing."""
STANDING_MPS = 0.5
POINTS_M = 4.0
"""Lanes are summed up at points this far apart."""


@dataclass(frozen=True, slots=True)
class Count:
    """One drive; `first` at its start, `later` on average from second 5 on."""

    first: float
    later: float
    expected_first: float
    expected_later: float
    standing_first: float
    standing_later: float


def counted(scenario: Scenario, planner: str, seed: int) -> Count | None:
    """One drive; None if it ends too early."""
    trace = drive(scenario, load_planner(planner), seed=seed).trace
    if trace is None or len(trace) < LATER_STEP + LEAST_STEPS:
        return None
    actors, ego = trace.actors, trace.ego
    away_m = np.hypot(actors.x_m - ego.x_m[actors.frame], actors.y_m - ego.y_m[actors.frame])
    near = (away_m <= SIGHT_M) & np.array([bool(behaviour) for behaviour in actors.behaviour])
    stands = near & (np.hypot(actors.vx_mps, actors.vy_mps) < STANDING_MPS)
    within, standing = (np.bincount(actors.frame[rows], minlength=len(trace)) for rows in (near, stands))
    points, vehicles = _wanted(scenario, seed)
    expected = [
        float(vehicles[np.hypot(points[:, 0] - ego.x_m[k], points[:, 1] - ego.y_m[k]) <= SIGHT_M].sum())
        for k in (0, *range(LATER_STEP, len(trace), 10))
    ]
    return Count(
        float(within[0]), float(within[LATER_STEP:].mean()), expected[0], float(np.mean(expected[1:])),
        float(standing[0]), float(standing[LATER_STEP:].mean()),
    )  # fmt: skip


def _wanted(scenario: Scenario, seed: int) -> tuple[Floats, Floats]:
    """(N, 2) points along all lanes, map frame, and how many vehicles the densities want at each."""
    roads, files = load_roads(scenario.map), find_map(scenario.map)
    network, ids = read_network(files.network), NetworkIds.read(files.ids)
    types = read_vehicle_types(vehicle_type_file(scenario.traffic.behaviour))
    staged = StagedScenario(scenario, roads, network, ids, types)
    demand = populate(staged, (), scenario.rng(seed)).demand
    return _along(network, demand, ids.origin_m)


def _along(network: SumoNetwork, demand: LocalDemand, origin_m: tuple[float, float]) -> tuple[Floats, Floats]:
    points, vehicles = list[Floats](), list[Floats]()
    for lane in (network.lanes[name] for name in sorted(demand.lanes)):
        many = max(1, round(lane.line.length_m / POINTS_M))
        part_m = lane.line.length_m / many
        points.append(lane.line.poses_at((np.arange(many) + 0.5) * part_m)[:, :2] + origin_m)
        vehicles.append(np.full(many, part_m / demand.mean_gap_m(lane.edge)))
    return np.concatenate(points), np.concatenate(vehicles)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suite", default="interplan==1")
    parser.add_argument("--planner", default="idm")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--scenes", action="store_true", help="a line for each drive, too")
    asked = parser.parse_args()
    counts: dict[str, list[Count]] = defaultdict(list)
    for scenario in find_suite(asked.suite).scenarios:
        if not scenario.has_flow or scenario.replayed or scenario.traffic.density == "none":
            continue
        for seed in range(asked.seeds):
            count = counted(scenario, asked.planner, seed)
            if count is not None:
                counts[scenario.traffic.density].append(count)
                if asked.scenes:
                    print(f"{scenario.id} {seed}: {count.first:.0f} -> {count.later:.1f}", flush=True)
    print("density  drives  start  later  ratio     expected       ratio to it  standing  ratio of moving")
    for density, found in counts.items():
        first, later, wanted_first, wanted_later, stood, standing = (
            float(np.mean([getattr(each, name) for each in found]))
            for name in ("first", "later", "expected_first", "expected_later", "standing_first", "standing_later")
        )
        to_it = later / wanted_later / (first / wanted_first)
        print(
            f"{density:8} {len(found):6} {first:6.1f} {later:6.1f} {later / first:6.2f}  {wanted_first:6.1f} to "
            f"{wanted_later:5.1f} {to_it:12.2f} {standing:10.1f} {(later - standing) / (first - stood):15.2f}"
        )


if __name__ == "__main__":
    main()
