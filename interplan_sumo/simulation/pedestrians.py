"""Jaywalkers: they wait at the kerb, and set off across the road once the ego is near. They yield to none."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import shapely

from interplan_sumo.scenario.jaywalking import PedestrianWalk, trigger_distance_m, walk
from interplan_sumo.scenario.scenario import WALKERS, Scenario
from interplan_sumo.simulation.lane_polygons import Ring, hull
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, Polyline, box_corners
from interplan_sumo.world.roads import Roads

FORESIGHT_S = 3.0
"""Background traffic foresees for so long where a walking pedestrian will be."""
SOON_S = 1.0
"""For who will be in its lane within this time background traffic brakes, even if it can no longer stop before."""
FORESEEN_STEP_S = 0.5
"""It looks at places this far apart in time."""


class WayAhead(NamedTuple):
    """What a walking pedestrian covers from now on, in SUMO's frame."""

    soon: Ring
    """Within `SOON_S`."""
    later: Ring
    """Within `FORESIGHT_S`."""


class People(Protocol):
    """All who walk in an episode. Background traffic brakes for them."""

    def notice(self, ego: EgoState, shape: EgoShape, /) -> None:
        """See where the ego is, before anybody moves."""
        ...

    def advance(self) -> bool:
        """Everyone under way walks on for one step; whether somebody has come or left."""
        ...

    def observe(self) -> Actors:
        """Everyone as actors with their true velocities, rows sorted by id."""
        ...

    def foreseen(self, origin_m: tuple[float, float]) -> list[WayAhead]:
        """Where those who walk will be."""
        ...

    def standing(self, origin_m: tuple[float, float]) -> dict[str, shapely.Polygon]:
        """The boxes of those that stand, by place: equal keys mean equal boxes. In SUMO's frame."""
        ...


class Crowd:
    """All jaywalkers of an episode and how far each has come."""

    def __init__(self, scenario: Scenario, roads: Roads, route: Polyline, ids: tuple[str, ...], dt_s: float) -> None:
        rows = sorted(zip(ids, scenario.jaywalkers, strict=True), key=lambda row: row[0])
        self.ids = tuple(name for name, _ in rows)
        self._walks = [walk(jaywalker, roads, route) for _, jaywalker in rows]
        kinds = [WALKERS[jaywalker.kind][0] for _, jaywalker in rows]
        self._kinds = np.array(kinds, dtype=np.int8)
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

    def advance(self) -> bool:
        """Everyone under way walks on for one step; nobody comes or leaves."""
        self._walked_s = [None if walked is None else walked + self._dt_s for walked in self._walked_s]
        return False

    def observe(self) -> Actors:
        """Everyone as actors with their true velocities, rows sorted by id."""
        walked_s = [-1.0 if walked is None else walked for walked in self._walked_s]  # who waits has not walked
        now = list(zip(self._walks, walked_s, strict=True))
        poses = [each.poses(np.array([walked]))[0] for each, walked in now]
        x, y, heading = np.array(poses, dtype=np.float64).reshape(-1, 3).T
        speed = np.array([each.speed_mps(walked) for each, walked in now], dtype=np.float64)
        length, width = np.array([each.size_m for each in self._walks], dtype=np.float64).reshape(-1, 2).T
        vx, vy = speed * np.cos(heading), speed * np.sin(heading)
        return Actors(self.ids, self._kinds, x, y, heading, length, width, vx, vy)

    def foreseen(self, origin_m: tuple[float, float]) -> list[WayAhead]:
        """Where walking pedestrians will be. Those who stand midway are not at rest: they will go on."""
        return [
            way_ahead(each, walked, origin_m)
            for each, walked in zip(self._walks, self._walked_s, strict=True)
            if walked is not None and walked < each.duration_s
        ]

    def ways(self, origin_m: tuple[float, float]) -> list[shapely.Polygon]:
        """What everyone covers on its whole way, part by part, in SUMO's frame."""
        return [
            shapely.Polygon(hull(covered(each, np.array((begins_s, ends_s)), origin_m)))
            for each in self._walks
            for begins_s, ends_s in zip(each.leaves_s.tolist(), each.arrives_s.tolist(), strict=True)
        ]

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


def way_ahead(each: PedestrianWalk, walked_s: float, origin_m: tuple[float, float]) -> WayAhead:
    """The way ahead of a pedestrian that has walked for so long."""

    def swept(ahead_s: float) -> Ring:
        upto_s = min(walked_s + ahead_s, each.duration_s) + FORESEEN_STEP_S
        times_s = np.minimum(np.arange(walked_s, upto_s, FORESEEN_STEP_S), each.duration_s)
        return hull(covered(each, times_s, origin_m))

    return WayAhead(swept(SOON_S), swept(FORESIGHT_S))


def covered(each: PedestrianWalk, walked_s: Floats, origin_m: tuple[float, float]) -> list[tuple[float, float]]:
    """Corners of a walker's boxes at several times, in SUMO's frame."""
    x_m, y_m, heading_rad = each.poses(walked_s).T
    sizes = (np.full_like(x_m, size_m) for size_m in each.size_m)
    corners = box_corners(x_m - origin_m[0], y_m - origin_m[1], heading_rad, *sizes).reshape(-1, 2)
    return [(x, y) for x, y in corners.tolist()]
