"""Obstacles: true boxes for all that look, and which stretches of SUMO lanes they, and people on foot, block."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf

import numpy as np
import shapely

from interplan_sumo.scenario.scenario import OBSTACLES, Scenario
from interplan_sumo.simulation.lane_footprint import lanes_overlapped
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.geometry import box_polygons
from interplan_sumo.world.roads import Roads

MERGE_WITHIN_M = 8.0
"""Blocked stretches of a lane nearer to one another than this are one: no car fits between."""
STOP_LINE_M = 1.0
"""Of a lane that leads to an obstacle inside a junction so much is blocked."""
SWING_OUT_M = 6.0
"""Cars queue this far before an obstacle: a lane change from rest needs the room to swing out."""
TAPER_M = 20.0
"""What stands at the edge of a lane, and no farther than that before where it is blocked, closes it, too."""


@dataclass(frozen=True, slots=True)
class LaneBlockage:
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


def standing_heights_m(scenario: Scenario, ids: tuple[str, ...]) -> dict[str, float]:
    """The heights of the obstacles of a scenario by id; the named occluder hides others however tall it is."""
    return {
        name: inf if i == scenario.occluder else obstacle.tall_m
        for i, (name, obstacle) in enumerate(zip(ids, scenario.obstacles, strict=True))
    }


def blockages(network: SumoNetwork, obstacles: Actors, origin_m: tuple[float, float]) -> tuple[LaneBlockage, ...]:
    """The stretches of normal lanes that obstacles block, and the room to swing out before them.

    Where one stands inside a junction, on a connector, the lanes that lead there are blocked at their ends.
    """
    boxes = box_polygons(
        obstacles.x_m - origin_m[0],
        obstacles.y_m - origin_m[1],
        obstacles.heading_rad,
        obstacles.length_m,
        obstacles.width_m,
    )
    inside = {lane for box in boxes for lane in lanes_overlapped(network, box, in_junctions=True)}
    ends = {link.from_lane for links in network.links.values() for link in links if inside.intersection(link.via)}
    before = tuple(
        LaneBlockage(lane, max(0.0, network.lanes[lane].length_m - STOP_LINE_M), network.lanes[lane].length_m)
        for lane in sorted(ends)
    )
    return blocked_by(network, boxes, SWING_OUT_M, before)


def blocked_by(
    network: SumoNetwork, areas: Iterable[shapely.Polygon], before_m: float, besides: Iterable[LaneBlockage] = ()
) -> tuple[LaneBlockage, ...]:
    """The stretches of normal lanes that areas in SUMO's frame block, from so far before them on, and those `besides`.

    Sorted by lane and position. An area blocks a lane if a car on its centre
    line would touch it; one that only reaches into the lane's edge is passed,
    unless the lane is blocked soon after: a taper begins there, and whoever
    leaves the lane beside it would sweep over it.
    """
    found: dict[str, list[tuple[float, float]]] = {}
    edges: list[tuple[float, float, str]] = []
    for each in besides:
        found.setdefault(each.lane, []).append((each.start_m, each.end_m))
    for area in areas:
        in_the_way = lanes_overlapped(network, area)
        for lane_id, (start_m, end_m) in in_the_way.items():
            found.setdefault(lane_id, []).append((max(0.0, start_m - before_m), end_m))
        for lane_id, (start_m, end_m) in lanes_overlapped(network, area, in_the_way, to_the_edge=True).items():
            edges.append((start_m, end_m, lane_id))
    for start_m, end_m, lane_id in sorted(edges, reverse=True):  # the nearest to what is blocked first
        if any(0.0 < begins_m + before_m - end_m < TAPER_M for begins_m, _ in found.get(lane_id, ())):
            found[lane_id].append((max(0.0, start_m - before_m), end_m))
    return tuple(LaneBlockage(lane, *span) for lane in sorted(found) for span in _merged(found[lane]))


def _merged(spans: list[tuple[float, float]]) -> list[tuple[float, float]]:
    merged: list[tuple[float, float]] = []
    for start_m, end_m in sorted(spans):
        if merged and start_m - merged[-1][1] < MERGE_WITHIN_M:
            merged[-1] = (merged[-1][0], max(merged[-1][1], end_m))
        else:
            merged.append((start_m, end_m))
    return merged
