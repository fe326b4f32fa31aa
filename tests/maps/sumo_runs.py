"""Random background traffic on a converted map, run by the sumo program, and what went wrong in it."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from defusedxml.ElementTree import parse

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.maps.network_file import read_network_file
from interplan_sumo.maps.store import MapFiles
from interplan_sumo.maps.to_sumo import program_path, sumo_home
from interplan_sumo.resources import routes_root
from interplan_sumo.world.geometry import box_corners, penetration_m, wrap_angle
from interplan_sumo.world.roads import Connector, Lane, Roads

STEP_S = 0.1
OVERLAP_M = 0.05
"""Boxes that penetrate each other by more count as an overlap (decisions on traffic)."""
LENGTH_M, WIDTH_M = 4.6, 1.85  # the cars of routes/*.xml


@dataclass(frozen=True, slots=True)
class Overlap:
    """The deepest moment of two cars in each other."""

    time_s: float
    vehicles: tuple[str, str]
    depth_m: float
    askew: bool
    """One of them stands or creeps at an angle to its lane: SUMO's continuous lane change, not the network."""


@dataclass(frozen=True, slots=True)
class TrafficRun:
    """What happened."""

    vehicles: int
    mean_speed_mps: float
    teleports: int
    collisions: int
    overlaps: tuple[Overlap, ...]
    emergency_brakings: int
    """Harder than comfort allows, by SUMO's count: a right of way that both sides claim shows in them."""


@dataclass(frozen=True, slots=True)
class _Car:
    time_s: float
    id: str
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    lane_id: str
    arc_m: float


def random_traffic(
    files: MapFiles,
    roads: Roads,
    folder: Path,
    *,
    seconds: float = 60.0,
    vehicles: int = 80,
    seed: int = 1,
) -> TrafficRun:
    """Drive `vehicles` cars on random ways for some time and look at every step."""
    ids = NetworkIds.read(files.ids)
    lengths_m = {lane.id: lane.length_m or 0.0 for lane in read_network_file(files.network).in_order}
    rng = np.random.default_rng(seed)
    sources = [lane for lane in roads.lanes.values() if not roads.incoming(lane.id) and roads.outgoing(lane.id)]
    early = vehicles // 2 if sources else vehicles
    walks = [_walk(roads, rng, seconds, None if k < early else sources) for k in range(vehicles)]
    departures = np.concatenate((np.zeros(early), np.sort(rng.uniform(0.0, 0.7 * seconds, vehicles - early))))
    folder.mkdir(parents=True, exist_ok=True)
    routes = ["<routes>"]
    for k, (walk, depart_s) in enumerate(zip(walks, departures, strict=True)):
        first = walk[0][0]
        length_m = roads.lanes[first].centerline.length_m
        arc_m = float(rng.uniform(min(LENGTH_M, length_m), length_m)) if k < early else LENGTH_M
        sumo_lane, fraction = ids.sumo_place(first, arc_m)
        edge, _, index = sumo_lane.rpartition("_")
        edges = _edges(ids, walk)
        if edge not in edges:
            continue  # on a cut, or where the lane runs alone and the walk leaves by another
        edges = edges[edges.index(edge) :]
        position_m = fraction * lengths_m[sumo_lane]
        speed_mps = max(0.0, _start_speed_mps(roads, walk, arc_m) - 0.01)
        routes.append(
            f'<vehicle id="v{k}" type="traffic" depart="{depart_s:.1f}" departLane="{index}" '
            f'departPos="{position_m:.2f}" departSpeed="{speed_mps:.2f}"><route edges="{" ".join(edges)}"/></vehicle>'
        )
    (folder / "random.rou.xml").write_text("\n".join((*routes, "</routes>")))
    done = subprocess.run(
        [
            str(program_path("sumo")), "-n", str(files.network.resolve()), "-r", "random.rou.xml",
            "-a", str((routes_root() / "mixed.xml").resolve()),
            "--step-length", str(STEP_S), "--end", str(seconds), "--time-to-teleport", "-1",
            "--collision.action", "warn", "--collision.check-junctions", "--collision-output", "collisions.xml",
            "--lanechange.duration", "3", "--default.speeddev", "0", "--seed", str(seed), "--no-step-log",
            "--xml-validation", "never", "--xml-validation.net", "never", "--xml-validation.routes", "never",
            "--fcd-output", "fcd.xml", "--statistic-output", "statistics.xml",
            "--precision", "4",
            "--max-depart-delay", "3",
        ],
        cwd=folder, env={**os.environ, "SUMO_HOME": str(sumo_home())}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(done.stderr)
    frames = _frames(folder / "fcd.xml", ids, lengths_m)
    statistics = parse(folder / "statistics.xml").getroot()
    assert statistics is not None
    counts = {element.tag: element.attrib for element in statistics}
    collisions = parse(folder / "collisions.xml").getroot()
    everyone = [car for cars in frames.values() for car in cars]
    return TrafficRun(
        vehicles=len({car.id for car in everyone}),
        mean_speed_mps=float(np.mean([car.speed_mps for car in everyone])) if everyone else 0.0,
        teleports=int(counts["teleports"]["total"]),
        collisions=0 if collisions is None else len(collisions),
        overlaps=_overlaps(roads, frames),
        emergency_brakings=int(counts["safety"]["emergencyBraking"]),
    )


# --- routes ------------------------------------------------------------------------------------


def _walk(
    roads: Roads, rng: np.random.Generator, seconds: float, starts: Sequence[Lane] | None
) -> list[tuple[str, str, str | None]]:
    """Per roadblock the lane where one comes in, the lane where one leaves, and the connector that one takes."""
    lanes = starts or [lane for lane in roads.lanes.values() if roads.outgoing(lane.id)] or list(roads.lanes.values())
    lengths = np.array([lane.centerline.length_m for lane in lanes])
    here = lanes[int(rng.choice(len(lanes), p=lengths / lengths.sum()))].id
    walk: list[tuple[str, str, str | None]] = []
    length_m = 0.0
    while True:
        siblings = roads.roadblocks[roads.lanes[here].roadblock_id].lane_ids
        ways = [c for lane in siblings for c in roads.outgoing(lane)]
        length_m += roads.lanes[here].centerline.length_m
        if not ways or length_m > seconds * 20.0:
            walk.append((here, here, None))
            return walk
        way = ways[int(rng.integers(len(ways)))]
        walk.append((here, roads.connectors[way].from_lane_id, way))
        here = roads.connectors[way].to_lane_id


def _start_speed_mps(roads: Roads, walk: list[tuple[str, str, str | None]], arc_m: float) -> float:
    """The fastest start from which 1.5 m/s2 meet every lower limit ahead, and a stop at the end of the lane."""
    ahead = [item for enter, _, way in walk for item in (enter, way) if item is not None]
    to_end_m = roads[walk[0][0]].centerline.length_m - arc_m
    speed, at = (np.sqrt(3.0 * max(0.0, to_end_m - 3.0)) if len(walk) > 1 else np.inf), -arc_m
    for name in ahead[:8]:
        lane = roads[name]
        limit = lane.speed_limit_mps or 13.89
        speed = min(speed, float(np.sqrt(limit**2 + 3.0 * max(0.0, at - 5.0))))
        at += lane.centerline.length_m
    return speed


def _edges(ids: NetworkIds, walk: list[tuple[str, str, str | None]]) -> list[str]:
    edges: list[str] = []
    for enter, leave, _ in walk:
        first, last = (
            [p.sumo_lane.rpartition("_")[0] for p in ids.pieces[lane] if not p.sumo_lane.startswith(":")]
            for lane in (enter, leave)
        )
        shared = [edge for edge in first if edge in last]
        if not shared:
            return edges + first  # lanes that do not run side by side
        edges += first[: first.index(shared[0])] + shared + last[last.index(shared[-1]) + 1 :]
    return edges


# --- reading what SUMO wrote -------------------------------------------------------------------


def _frames(path: Path, ids: NetworkIds, lengths_m: Mapping[str, float]) -> dict[float, list[_Car]]:
    root = parse(path).getroot()
    assert root is not None
    frames: dict[float, list[_Car]] = {}
    for step in root:
        time_s = round(float(step.attrib["time"]), 3)
        cars: list[_Car] = []
        for v in step:
            heading = np.pi / 2 - np.radians(float(v.attrib["angle"]))
            x, y = float(v.attrib["x"]), float(v.attrib["y"])  # the middle of the front bumper
            lane = v.attrib["lane"]
            lane_id, start_m, end_m = ids.sources[lane]
            arc_m = start_m + (end_m - start_m) * float(v.attrib["pos"]) / lengths_m[lane]
            cars.append(
                _Car(
                    time_s, v.attrib["id"],
                    float(x - np.cos(heading) * LENGTH_M / 2), float(y - np.sin(heading) * LENGTH_M / 2),
                    float(heading),
                    float(v.attrib["speed"]), lane_id, arc_m,
                )
            )  # fmt: skip
        frames[time_s] = cars
    return frames


def _overlaps(roads: Roads, frames: dict[float, list[_Car]]) -> tuple[Overlap, ...]:
    deepest: dict[tuple[str, str], Overlap] = {}
    for time_s, cars in frames.items():
        if len(cars) < 2:
            continue
        x, y, heading = (np.array([getattr(c, n) for c in cars]) for n in ("x_m", "y_m", "heading_rad"))
        i, j = np.triu_indices(len(cars), 1)
        close = np.hypot(x[i] - x[j], y[i] - y[j]) < LENGTH_M + WIDTH_M
        i, j = i[close], j[close]
        if not len(i):
            continue
        corners = box_corners(x, y, heading, np.full(len(x), LENGTH_M), np.full(len(x), WIDTH_M))
        depth = penetration_m(corners[i], corners[j])
        for a, b, d in zip(i.tolist(), j.tolist(), depth.tolist(), strict=True):
            pair = cars[a].id, cars[b].id
            if d > OVERLAP_M and (pair not in deepest or d > deepest[pair].depth_m):
                askew = any(_askew(roads, cars[k]) for k in (a, b))
                deepest[pair] = Overlap(time_s, pair, d, askew)
    return tuple(sorted(deepest.values(), key=lambda o: (o.time_s, o.vehicles)))


def _askew(roads: Roads, car: _Car) -> bool:
    """Whether a car stands across its path: its heading against the chord from rear to front on the path."""
    lane, back_m = roads[car.lane_id], car.arc_m - LENGTH_M
    front = lane.centerline.pose_at(car.arc_m)
    if back_m < 0.0 and isinstance(lane, Connector):
        before = roads.lanes[lane.from_lane_id].centerline
        back = before.pose_at(before.length_m + back_m)
    else:
        back = lane.centerline.pose_at(max(0.0, back_m))
    chord = np.arctan2(front.y_m - back.y_m, front.x_m - back.x_m)
    return abs(float(wrap_angle(car.heading_rad - chord))) > np.radians(4.0)
