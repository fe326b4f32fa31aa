"""What a planner sees of a scene: everything near, but for pedestrians behind the scenario's occluder.

Pedestrians are all of that kind: jaywalkers, and the workers among the obstacles. Vehicles, cones and barriers are
seen in any case, and the trace keeps all.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads

SENSOR_RANGE_M = 100.0
"""How far a planner sees, from centre to centre."""
_PARALLEL_M = 1e-12  # lines that gain no more than this across a slab run along it


@dataclass(frozen=True, slots=True)
class OccludingBox:
    """The standing box that hides pedestrians, in the map frame."""

    x_m: float
    y_m: float
    heading_rad: float
    length_m: float
    width_m: float

    def cuts(self, from_x: float, from_y: float, to_x: Floats, to_y: Floats) -> NDArray[np.bool_]:
        """(N,) whether the straight lines from one point to others (N,) pass through the box, not just along it."""
        cosine, sine = cos(self.heading_rad), sin(self.heading_rad)
        start_x, start_y = from_x - self.x_m, from_y - self.y_m
        first, last = np.zeros(len(to_x)), np.ones(len(to_x))  # shares of each line that lie in both slabs of the box
        for along, across, half_m in ((cosine, sine, self.length_m / 2.0), (-sine, cosine, self.width_m / 2.0)):
            start = start_x * along + start_y * across
            run = (to_x - from_x) * along + (to_y - from_y) * across
            parallel = np.abs(run) < _PARALLEL_M
            step = np.where(parallel, 1.0, run)
            near, far = (-half_m - start) / step, (half_m - start) / step
            inside = abs(start) < half_m
            first = np.maximum(first, np.where(parallel, 0.0 if inside else 1.0, np.minimum(near, far)))
            last = np.minimum(last, np.where(parallel, 1.0 if inside else 0.0, np.maximum(near, far)))
        return first < last


def occluding_box(scenario: Scenario, roads: Roads) -> OccludingBox | None:
    """The box of the scenario's occluder, if it has one."""
    if scenario.occluder is None:
        return None
    obstacle = scenario.obstacles[scenario.occluder]
    pose = obstacle.pose(roads)
    return OccludingBox(pose.x_m, pose.y_m, pose.heading_rad, *obstacle.size_m)


def visible(actors: Actors, ego: EgoState, occluder: OccludingBox | None) -> Actors:
    """The actors that a planner sees: within `SENSOR_RANGE_M`, pedestrians only if the occluder does not hide them.

    A pedestrian is hidden while the straight line from the ego's centre to
    its centre passes through the occluder's box.
    """
    near = actors.within(ego.x_m, ego.y_m, SENSOR_RANGE_M)
    if occluder is None:
        return near
    rows = np.flatnonzero(near.kind == ActorKind.PEDESTRIAN)
    if not len(rows):
        return near
    hidden = rows[occluder.cuts(ego.x_m, ego.y_m, near.x_m[rows], near.y_m[rows])]
    return near.only(np.setdiff1d(np.arange(len(near)), hidden)) if len(hidden) else near
