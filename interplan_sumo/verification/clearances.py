"""Clearances: how near a drive comes to others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import box_polygons
from interplan_sumo.world.trace import Trace

NEAR_M = 15.0
"""Centres farther apart than this (and half the other's length) are not asked about."""


@dataclass(frozen=True, slots=True)
class Clearance:
    """The nearest that the ego's box comes to others of one kind, metres between the boxes."""

    distance_m: float
    """Infinite where nobody comes near."""
    track: str = ""
    time_s: float = 0.0


@dataclass(frozen=True, slots=True)
class NearestApproach:
    """The least clearances of a drive."""

    pedestrians: Clearance = Clearance(np.inf)
    others: Clearance = Clearance(np.inf)


def nearest_approach(trace: Trace) -> NearestApproach:
    """How near the ego comes to whom, over all frames of a trace."""
    ego, table = trace.ego, trace.actors
    length_m, width_m = (np.full(len(trace), size) for size in (trace.shape.length_m, trace.shape.width_m))
    boxes = box_polygons(ego.x_m, ego.y_m, ego.heading_rad, length_m, width_m)
    on_foot = others = Clearance(np.inf)
    for k in range(len(trace)):
        actors = table.at(k)
        apart_m = np.hypot(actors.x_m - ego.x_m[k], actors.y_m - ego.y_m[k])
        near = actors.only(apart_m < NEAR_M + actors.length_m / 2)
        if not len(near):
            continue
        gaps_m = shapely.distance(boxes[k], near.polygons)
        walks = near.kind == ActorKind.PEDESTRIAN
        for row in np.flatnonzero(gaps_m < np.where(walks, on_foot.distance_m, others.distance_m)).tolist():
            found = Clearance(float(gaps_m[row]), near.ids[row], float(ego.time_us[k]) / 1e6)
            if walks[row]:
                on_foot = min(on_foot, found, key=lambda each: each.distance_m)
            else:
                others = min(others, found, key=lambda each: each.distance_m)
    return NearestApproach(on_foot, others)
