"""People in the streets of a segment, and what stands there: they come, wait at the kerb, cross and are forgotten once
they are far away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import hypot
from typing import Final

import numpy as np
import shapely

from interplan_sumo.endurance.kerbside import Thing
from interplan_sumo.scenario.jaywalking import PedestrianWalk
from interplan_sumo.simulation.lane_polygons import hull
from interplan_sumo.simulation.pedestrians import WayAhead, covered, way_ahead
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import EgoShape, EgoState

FORGOTTEN_M: Final = 115.0
"""Farther from the ego somebody who neither waits for it nor walks is gone."""


@dataclass(slots=True, eq=False)
class Walker:
    """One of them."""

    id: str
    walk: PedestrianWalk
    expected: bool = True
    """Whether it still waits for its moment; who does not and stands is part of the street."""
    walked_s: float | None = None
    """None: it has not set off."""
    boxes: dict[str, shapely.Polygon] = field(default_factory=dict[str, shapely.Polygon])

    @property
    def walks(self) -> bool:
        """Whether it is under way."""
        return self.walked_s is not None and self.walked_s < self.walk.duration_s

    @property
    def at(self) -> tuple[float, float]:
        """Where it is, in the map's frame."""
        x_m, y_m, _ = self.walk.poses(np.array([self.time_s]))[0].tolist()
        return x_m, y_m

    @property
    def time_s(self) -> float:
        """Since it set off, negative where it has not."""
        return -1.0 if self.walked_s is None else self.walked_s


class StreetPeople:
    """All who are there; `People` for the traffic."""

    def __init__(self, dt_s: float) -> None:
        self._dt_s = dt_s
        self._there: list[Walker] = []
        self._coming: list[Walker] = []
        self._things: list[Thing] = []
        self._leaving: list[Thing] = []
        self._changed = False
        self._ego = (0.0, 0.0)

    @property
    def there(self) -> Sequence[Walker]:
        """Those who can be seen, by id."""
        return self._there

    def come(self, walker: Walker) -> None:
        """One who stands at a kerb from the next step on."""
        self._coming.append(walker)

    def put(self, thing: Thing) -> None:
        """What stands there from the next step on."""
        self._things = sorted([*self._things, thing], key=lambda each: each.id)
        self._changed = True

    def take(self, thing: Thing) -> None:
        """What stands there no longer."""
        self._things = [each for each in self._things if each is not thing]
        self._changed = True

    def expect_no_more(self, thing: Thing) -> None:
        """What goes once it is out of sight."""
        self._leaving.append(thing)

    def notice(self, ego: EgoState, _shape: EgoShape) -> None:
        """Nobody minds the ego of their own accord."""
        self._ego = (ego.x_m, ego.y_m)

    def advance(self) -> bool:
        """Everyone under way walks on for one step; whether somebody has come or left."""
        for each in self._there:
            if each.walked_s is not None:
                each.walked_s += self._dt_s
        stay = [each for each in self._there if each.expected or each.walks or self._is_near(*each.at)]
        for thing in [each for each in self._leaving if not self._is_near(each.pose.x_m, each.pose.y_m)]:
            self._leaving.remove(thing)
            self.take(thing)
        changed = bool(self._coming) or len(stay) != len(self._there)
        if changed:
            self._there = sorted([*stay, *self._coming], key=lambda each: each.id)
            self._coming.clear()
        changed, self._changed = changed or self._changed, False
        return changed

    def _is_near(self, x_m: float, y_m: float) -> bool:
        return hypot(x_m - self._ego[0], y_m - self._ego[1]) <= FORGOTTEN_M

    def observe(self) -> Actors:
        """Everyone and everything as actors with their true velocities, rows sorted by id."""
        if not self._there and not self._things:
            return Actors.none()
        rows: list[tuple[str, ActorKind, float, float, float, float, tuple[float, float]]] = []
        for each in self._there:
            x_m, y_m, heading_rad = each.walk.poses(np.array([each.time_s]))[0].tolist()
            speed_mps = each.walk.speed_mps(each.time_s)
            rows.append((each.id, ActorKind.PEDESTRIAN, x_m, y_m, heading_rad, speed_mps, each.walk.size_m))
        for thing in self._things:
            pose = thing.pose
            rows.append((thing.id, thing.kind, pose.x_m, pose.y_m, pose.heading_rad, 0.0, thing.size_m))
        rows.sort(key=lambda row: row[0])
        x, y, heading, speed = np.array([row[2:6] for row in rows], dtype=np.float64).T
        length, width = np.array([row[6] for row in rows], dtype=np.float64).T
        kinds = np.array([int(row[1]) for row in rows], dtype=np.int8)
        ids = tuple(row[0] for row in rows)
        return Actors(ids, kinds, x, y, heading, length, width, speed * np.cos(heading), speed * np.sin(heading))

    def foreseen(self, origin_m: tuple[float, float]) -> list[WayAhead]:
        """Where those under way will be."""
        return [way_ahead(each.walk, each.time_s, origin_m) for each in self._there if each.walks]

    def standing(self, origin_m: tuple[float, float]) -> dict[str, shapely.Polygon]:
        """The boxes of what stands, and of those who wait or have arrived, by place. In SUMO's frame."""
        found = {thing.id: shapely.Polygon(thing.corners(origin_m)) for thing in self._things}
        for each in self._there:
            if each.walks:
                continue
            place = f"{each.id} {'waits' if each.walked_s is None else 'has arrived'}"
            if place not in each.boxes:
                corners = hull(covered(each.walk, np.array([each.time_s]), origin_m))
                each.boxes[place] = shapely.Polygon(corners)
            found[place] = each.boxes[place]
        return found
