"""Obstacles: true boxes for everyone who looks, and which stretches of SUMO lanes they block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from interplan_sumo.scenario.scenario import OBSTACLES, Scenario
from interplan_sumo.simulation.network import Network
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.geometry import box_polygons
from interplan_sumo.world.roads import Roads

HALF_PASSAGE_M = 1.15
"""A car on the centre line keeps clear of what stays this far from it: half its width and a hand's breadth more."""
MERGE_WITHIN_M = 8.0
"""Blocked stretches of a lane nearer to one another than this are one: no car fits between."""


SWING_OUT_M = 6.0
"""Cars queue this far before an obstacle: a lane change from rest needs the room to swing out."""


@dataclass(frozen=True, slots=True)
class Blockage:
    """A stretch of a SUMO lane that cars must keep out of: where none can pass, and the room to swing out before it."""

    lane: str
    start_m: float
    """SUMO's lane position."""
    end_m: float


def standing_actors(scenario: Scenario, roads: Roads, ids: tuple[str, ...]) -> Actors:
    """The obstacles of a scenario as actors with the given ids, rows sorted by id."""
    rows = sorted(zip(ids, scenario.obstacles, strict=True), key=lambda row: row[0])
    poses = [obstacle.pose(roads) for _, obstacle in rows]
    zeros = np.zeros(len(rows))
    return Actors(
        ids=tuple(name for name, _ in rows),
        kind=np.array([OBSTACLES[obstacle.kind][0] for _, obstacle in rows], dtype=np.int8),
        x_m=np.array([pose.x_m for pose in poses]),
        y_m=np.array([pose.y_m for pose in poses]),
        heading_rad=np.array([pose.heading_rad for pose in poses]),
        length_m=np.array([obstacle.size_m[0] for _, obstacle in rows]),
        width_m=np.array([obstacle.size_m[1] for _, obstacle in rows]),
        vx_mps=zeros,
        vy_mps=zeros,
    )


def blockages(network: Network, obstacles: Actors, origin_m: tuple[float, float]) -> tuple[Blockage, ...]:
    """The stretches of normal lanes that obstacles block, sorted by lane and position.

    An obstacle blocks a lane if a car on its centre line would touch it; one
    that only reaches into the lane's edge is passed.
    """
    found: dict[str, list[tuple[float, float]]] = {}
    boxes = box_polygons(
        obstacles.x_m - origin_m[0],
        obstacles.y_m - origin_m[1],
        obstacles.heading_rad,
        obstacles.length_m,
        obstacles.width_m,
    )
    for box in boxes:
        for lane_id, (start_m, end_m) in _reaches(network, box).items():
            found.setdefault(lane_id, []).append((start_m, end_m))
    return tuple(Blockage(lane, *span) for lane in sorted(found) for span in _merged(found[lane]))


def _reaches(network: Network, box: shapely.Polygon) -> dict[str, tuple[float, float]]:
    """Normal lanes whose passage a box reaches into, with the SUMO positions from and to."""
    strips, tree = network.strips
    reached: dict[str, tuple[float, float]] = {}
    for hit in np.sort(tree.query(box, predicate="intersects")):
        strip = strips[hit]
        lane = strip.lane
        part = shapely.intersection(shapely.buffer(strip.line.linestring, HALF_PASSAGE_M, cap_style="flat"), box)
        if lane.internal or part.area < 1e-6:
            continue
        arcs, _ = strip.line.project(shapely.get_coordinates(part))
        start_m = max(0.0, lane.position_of(strip.start_m + float(arcs.min())) - SWING_OUT_M)
        end_m = lane.position_of(strip.start_m + float(arcs.max()))
        before = reached.get(lane.id, (start_m, end_m))
        reached[lane.id] = (min(before[0], start_m), max(before[1], end_m))
    return reached


def _merged(spans: list[tuple[float, float]]) -> list[tuple[float, float]]:
    merged: list[tuple[float, float]] = []
    for start_m, end_m in sorted(spans):
        if merged and start_m - merged[-1][1] < MERGE_WITHIN_M:
            merged[-1] = (merged[-1][0], max(merged[-1][1], end_m))
        else:
            merged.append((start_m, end_m))
    return merged
