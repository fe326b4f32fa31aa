"""Perception: what a planner is told of a scene, in the mode that the scenario names.

`full`: everything within 100 m as it is, but for pedestrians behind the
scenario's named occluder. `occluded`: who is hidden behind a tall box is not
seen. `noisy`: tracks have errors and gaps. `late`: all is 0.2 s old. The last
three can be combined, and follow one another in this order: what was in sight
then, as it was measured then, is told now.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Final

import numpy as np

from interplan_sumo.scenario.scenario import Scenario, perception_modes
from interplan_sumo.simulation.history import PAST_STEPS, extrapolated_actors
from interplan_sumo.simulation.occlusion import behind, hidden, named_occluder
from interplan_sumo.simulation.track_noise import TrackNoise
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Ints
from interplan_sumo.world.roads import Roads

SENSOR_RANGE_M: Final = 100.0
"""How far a planner sees, from centre to centre."""
TALL_M: Final = 1.4
"""Boxes at least this tall hide others in the mode `occluded`."""
LATE_STEPS: Final = 2
"""How old everything is in the mode `late`."""


class Perception:
    """What the planner of one episode is told: `first` of the start, then `look` once a step."""

    def __init__(
        self, scenario: Scenario, roads: Roads, heights_m: Mapping[str, float], seed: int, dt_s: float
    ) -> None:
        """`heights_m` are those of vehicles and obstacles by id, now and later; who is not in it hides nobody."""
        modes = perception_modes(scenario.perception)
        self._roads = roads
        self._dt_s = dt_s
        self._heights_m = heights_m
        self._named = named_occluder(scenario, roads)
        self._is_occluded = "occluded" in modes
        self._noise = TrackNoise(f"{scenario.id}#{seed}", dt_s) if "noisy" in modes else None
        self._late_steps = LATE_STEPS if "late" in modes else 0
        self._told: deque[Actors] = deque(maxlen=1 + self._late_steps)
        self._frame = 0
        self._ids: tuple[str, ...] = ()
        self._tall: Ints = np.zeros(0, dtype=np.int64)
        self._hides_within_m = 0.0

    def first(self, ego: EgoState, actors: Actors) -> tuple[tuple[Actors, ...], Actors]:
        """What the planner was told in the frames before the first, and what it is told in that.

        Nobody drove before the start: who is in sight there has been in sight
        all along, and come at its present speed.
        """
        eye = (ego.x_m, ego.y_m)
        rows = self._rows_in_sight(eye, actors)
        near = actors.only(rows)
        before = extrapolated_actors(self._roads, near, self._dt_s, PAST_STEPS + LATE_STEPS)
        everyone = np.arange(len(near))
        seen = [self._measured(k, near.ids, each, everyone, eye) for k, each in enumerate(before, -len(before))]
        seen.append(self._measured(0, actors.ids, near, rows, eye))
        self._told.extend(seen)
        told = seen[LATE_STEPS - self._late_steps :]
        return tuple(told[:PAST_STEPS]), told[PAST_STEPS]

    def look(self, ego: EgoState, actors: Actors) -> Actors:
        """What the planner is told one step later."""
        self._frame += 1
        eye = (ego.x_m, ego.y_m)
        rows = self._rows_in_sight(eye, actors)
        self._told.append(self._measured(self._frame, actors.ids, actors.only(rows), rows, eye))
        return self._told[0]

    def _rows_in_sight(self, eye: tuple[float, float], actors: Actors) -> Ints:
        dx, dy = actors.x_m - eye[0], actors.y_m - eye[1]
        away_m2 = dx * dx + dy * dy
        rows = (away_m2 <= SENSOR_RANGE_M * SENSOR_RANGE_M).nonzero()[0]
        if self._is_occluded:
            tall = self._tall_rows(actors)
            return rows[~hidden(actors, rows, tall[away_m2[tall] <= self._hides_within_m**2], eye)]
        if self._named is None:
            return rows
        people = rows[actors.kind[rows] == ActorKind.PEDESTRIAN]
        if not len(people):
            return rows
        return np.setdiff1d(rows, people[behind(self._named, eye, actors.x_m[people], actors.y_m[people])])

    def _tall_rows(self, actors: Actors) -> Ints:
        if actors.ids != self._ids:
            height_m = np.array([self._heights_m.get(name, 0.0) for name in actors.ids])
            self._ids = actors.ids
            people = (actors.kind == ActorKind.PEDESTRIAN) | (actors.kind == ActorKind.BICYCLE)
            self._tall = np.flatnonzero((height_m >= TALL_M) & ~people)  # one sees past people, however tall
            largest_m = float(np.hypot(actors.length_m, actors.width_m).max(initial=0.0))
            self._hides_within_m = SENSOR_RANGE_M + largest_m  # halves of the box that hides and of the one hidden
        return self._tall

    def _measured(self, frame: int, ids: tuple[str, ...], near: Actors, rows: Ints, eye: tuple[float, float]) -> Actors:
        return near if self._noise is None else self._noise.seen(frame, ids, near, rows, eye)
