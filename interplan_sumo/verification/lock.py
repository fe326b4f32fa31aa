"""The lock of a suite: hashes of everything that makes its scenarios what they are, and an overview of them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from msgspec import to_builtins

from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import LOCK, MapLock, ScenarioLock, Suite, SuiteLock, overview
from interplan_sumo.simulation.network import read_network
from interplan_sumo.simulation.setup import open_traffic
from interplan_sumo.simulation.vehicle_types import vehicle_type_file
from interplan_sumo.world.roads import Roads

LOCK_FORMAT = 1


def lock(suite: Suite) -> SuiteLock:
    """What lock.json of a suite must hold, computed afresh. Starts SUMO once per scenario."""
    maps = sorted({s.map for s in suite.scenarios})
    behaviours = sorted({s.traffic.behaviour for s in suite.scenarios})
    return SuiteLock(
        format=LOCK_FORMAT,
        suite=suite.key,
        hash=suite.hash(),
        maps={name: MapLock(roads_hash(load_roads(name)), network_hash(name)) for name in maps},
        vehicle_types={name: _sha256([vehicle_type_file(name).read_bytes()]) for name in behaviours},
        scenarios={
            s.id: ScenarioLock(s.hash(), initial_actors_hash(s)) for s in sorted(suite.scenarios, key=lambda s: s.id)
        },
        overview=[overview(s, load_roads(s.map)) for s in suite.scenarios],
    )


def write_lock(suite: Suite) -> Path:
    """Write lock.json into the suite's folder; equal suites give equal bytes."""
    path = suite.folder / LOCK
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        json.dumps(to_builtins(lock(suite)), indent=1, sort_keys=True) + "\n", encoding="utf-8", newline="\n"
    )
    return path


def roads_hash(roads: Roads) -> str:
    """Over ids, links, limits and coordinates to the millimetre: equal maps agree whatever library wrote them."""
    lines: list[bytes] = [f"{roads.crs} {roads.driving_side}".encode()]
    for lane in sorted(roads.lanes.values(), key=lambda lane: lane.id):
        lines.append(f"lane {lane.id} {lane.roadblock_id} {lane.index} {lane.speed_limit_mps!r}".encode())
        lines.append(_millimetres(lane.centerline.points))
    for each in sorted(roads.connectors.values(), key=lambda connector: connector.id):
        stops = ",".join(each.stop_line_ids)
        lines.append(f"connector {each.id} {each.from_lane_id} {each.to_lane_id} {stops}".encode())
        lines.append(_millimetres(each.centerline.points))
    return _sha256(lines)


def network_hash(map_name: str) -> str:
    """Over the SUMO lanes' shapes to the centimetre, lengths and limits, and the lights' first states."""
    network = read_network(find_map(map_name).network)
    lines = [f"{name} {state}".encode() for name, state in sorted(network.lights.shown.items())]
    for lane in sorted(network.lanes.values(), key=lambda lane: lane.id):
        lines.append(f"{lane.id} {lane.length_m:.2f} {lane.width_m:.2f} {lane.limit_mps:.2f}".encode())
        lines.append(np.round(lane.line.points * 100.0).astype("<i8").tobytes())
    return _sha256(lines)


def initial_actors_hash(scenario: Scenario) -> str:
    """Over the actors of seed 0 at t = 0, to the millimetre."""
    with open_traffic(scenario, load_roads(scenario.map, scenario.maps_beside)) as traffic:
        actors = traffic.observe().actors
        lines = [f"{i} {traffic.behaviours.get(i, '')}".encode() for i in actors.ids]
    columns = (actors.x_m, actors.y_m, actors.heading_rad, actors.length_m, actors.width_m, actors.speed_mps)
    return _sha256([*lines, _millimetres(np.stack(columns))])


def _millimetres(values: np.ndarray) -> bytes:
    return np.round(values * 1000.0).astype("<i8").tobytes()


def _sha256(parts: Iterable[bytes]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part + b"\n")
    return digest.hexdigest()
