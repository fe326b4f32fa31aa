"""Jaywalkers: they wait at the kerb, and walk straight across once the ego is near. They yield to none."""

from __future__ import annotations

from math import cos, sin

import numpy as np
import shapely

from interplan_sumo.scenario.jaywalking import trigger_distance_m, walk
from interplan_sumo.scenario.scenario import PEDESTRIAN_LENGTH_M, PEDESTRIAN_WIDTH_M, Scenario
from interplan_sumo.simulation.lane_polygons import Ring, hull
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import Roads

FORESIGHT_S = 3.0
"""Background traffic foresees for so long where a walking pedestrian will be."""


class Crowd:
    """All jaywalkers of an episode and how far each has come."""

    def __init__(self, scenario: Scenario, roads: Roads, route: Polyline, ids: tuple[str, ...], dt_s: float) -> None:
        rows = sorted(zip(ids, scenario.jaywalkers, strict=True), key=lambda row: row[0])
        self.ids = tuple(name for name, _ in rows)
        self._walks = [walk(jaywalker, roads, route) for _, jaywalker in rows]
        self._route = route
        self._dt_s = dt_s
        self._boxes: dict[str, shapely.Polygon] = {}
        self._walked_s: list[float | None] = [None] * len(rows)  # None: still waiting

    def notice(self, ego: EgoState, shape: EgoShape) -> None:
        """Set off those that the ego has come near enough to, before it has passed."""
        if all(walked is not None for walked in self._walked_s):
            return
        centre_m, _ = self._route.project_point(ego.x_m, ego.y_m)
        front_m = centre_m + shape.length_m / 2.0
        for i, each in enumerate(self._walks):
            ahead_m = each.conflict_m - front_m
            if self._walked_s[i] is None and -shape.length_m <= ahead_m <= trigger_distance_m(ego.speed_mps):
                self._walked_s[i] = 0.0

    def advance(self) -> None:
        """Everyone under way walks on for one step."""
        self._walked_s = [None if walked is None else walked + self._dt_s for walked in self._walked_s]

    def observe(self) -> Actors:
        """Everyone as actors with their true velocities, rows sorted by id."""
        rows: list[tuple[float, float, float, float, float]] = []
        for each, walked in zip(self._walks, self._walked_s, strict=True):
            done_s = min(walked or 0.0, each.duration_s)
            moving = walked is not None and walked < each.duration_s
            along_m = each.speed_mps * done_s
            dx, dy = cos(each.heading_rad), sin(each.heading_rad)
            speed = each.speed_mps if moving else 0.0
            rows.append(
                (each.start[0] + along_m * dx, each.start[1] + along_m * dy, each.heading_rad, speed * dx, speed * dy)
            )
        x, y, heading, vx, vy = np.array(rows, dtype=np.float64).reshape(-1, 5).T
        size = len(rows)
        kind = np.full(size, ActorKind.PEDESTRIAN, dtype=np.int8)
        length, width = np.full(size, PEDESTRIAN_LENGTH_M), np.full(size, PEDESTRIAN_WIDTH_M)
        return Actors(self.ids, kind, x, y, heading, length, width, vx, vy)

    def foreseen(self, origin_m: tuple[float, float]) -> list[Ring]:
        """What walking pedestrians cover from now to `FORESIGHT_S` later, in SUMO's frame."""
        actors = self.observe()
        walking = np.flatnonzero(actors.speed_mps > 0.0)
        areas: list[Ring] = []
        for i in walking.tolist():
            left_s = min(FORESIGHT_S, self._walks[i].duration_s - (self._walked_s[i] or 0.0))
            ends = (actors.corners[i] - origin_m, actors.corners[i] - origin_m + left_s * _velocity(actors, i))
            areas.append(hull([(x, y) for x, y in np.concatenate(ends).tolist()]))
        return areas

    def ways(self, origin_m: tuple[float, float]) -> list[shapely.Polygon]:
        """What everyone covers on its whole way, in SUMO's frame."""
        here, ends = self.observe(), np.array([each.end for each in self._walks]).reshape(-1, 1, 2)
        begins = np.array([each.start for each in self._walks]).reshape(-1, 1, 2)
        first = here.corners - np.stack((here.x_m, here.y_m), axis=1)[:, None, :] - origin_m
        corners = np.concatenate((first + begins, first + ends), axis=1)
        return [shapely.Polygon(hull([(x, y) for x, y in each.tolist()])) for each in corners]

    def standing(self, origin_m: tuple[float, float]) -> dict[str, shapely.Polygon]:
        """The boxes of those that wait or have arrived, by place: equal keys mean equal boxes. In SUMO's frame."""
        found: dict[str, shapely.Polygon] = {}
        actors: Actors | None = None
        for i, (each, walked) in enumerate(zip(self._walks, self._walked_s, strict=True)):
            if walked is not None and walked < each.duration_s:
                continue
            place = f"{self.ids[i]} {'waits' if walked is None else 'has arrived'}"
            if place not in self._boxes:
                actors = actors or self.observe()
                self._boxes[place] = shapely.Polygon(actors.corners[i] - origin_m)
            found[place] = self._boxes[place]
        return found


def _velocity(actors: Actors, row: int) -> Floats:
    return np.array((actors.vx_mps[row], actors.vy_mps[row]))
