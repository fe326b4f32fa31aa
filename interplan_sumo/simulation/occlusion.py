"""Who is hidden behind what: straight lines from the ego's centre against boxes seen from above."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.geometry import FRONTWARD, LEFTWARD, Floats, Ints
from interplan_sumo.world.roads import Roads

AHEAD, LEFT = (np.append(0.0, signs)[:, None] for signs in (FRONTWARD, LEFTWARD))
"""(5, 1) of the centre and the corners of a box."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes that hide: numbers of one, or (K,) of many, centres relative to the eye, map axes."""

    x_m: Floats | float
    y_m: Floats | float
    heading_rad: Floats | float
    length_m: Floats | float
    width_m: Floats | float

    @cached_property
    def _turn(self) -> tuple[Any, Any]:
        """Cosine and sine of the headings."""
        return np.cos(self.heading_rad), np.sin(self.heading_rad)

    @cached_property
    def _eye(self) -> tuple[Any, Any]:
        """Where the eye lies as seen from the boxes: ahead and to the left."""
        cosine, sine = self._turn
        return -self.x_m * cosine - self.y_m * sine, self.x_m * sine - self.y_m * cosine

    def cut(self, to_x: Floats, to_y: Floats) -> NDArray[np.bool_]:
        """(P, K) whether the straight lines from the eye to points (P, K) pass through the box, not just along it.

        They do unless an axis of the box, or that across the line, keeps them apart.
        """
        (cosine, sine), (eye_x, eye_y) = self._turn, self._eye
        half_x, half_y = self.length_m / 2.0, self.width_m / 2.0
        run_x, run_y = (to_x * cosine + to_y * sine) / 2.0, (to_y * cosine - to_x * sine) / 2.0  # halves, box's axes
        wide_x, wide_y = np.abs(run_x), np.abs(run_y)
        cut = np.abs(eye_x + run_x) < half_x + wide_x
        cut &= np.abs(eye_y + run_y) < half_y + wide_y
        cut &= np.abs(eye_x * run_y - eye_y * run_x) < half_x * wide_y + half_y * wide_x
        return np.asarray(cut)

    def holds_eye(self) -> NDArray[np.bool_]:
        """(K,) whether the eye lies in the box."""
        eye_x, eye_y = self._eye
        return np.asarray((np.abs(eye_x) < self.length_m / 2.0) & (np.abs(eye_y) < self.width_m / 2.0))


def named_occluder(scenario: Scenario, roads: Roads) -> Boxes | None:
    """The box of the scenario's occluder in the map frame, if it has one."""
    if scenario.occluder is None:
        return None
    obstacle = scenario.obstacles[scenario.occluder]
    pose = obstacle.pose(roads)
    return Boxes(pose.x_m, pose.y_m, pose.heading_rad, *obstacle.size_m)


def behind(box: Boxes, eye: tuple[float, float], to_x: Floats, to_y: Floats) -> NDArray[np.bool_]:
    """(N,) whether a box in the map frame hides points (N,) from the eye."""
    x_m, y_m = eye
    seen_from = Boxes(box.x_m - x_m, box.y_m - y_m, box.heading_rad, box.length_m, box.width_m)
    return seen_from.cut(to_x - x_m, to_y - y_m)


def hidden(actors: Actors, rows: Ints, hiding: Ints, eye: tuple[float, float]) -> NDArray[np.bool_]:
    """(len(rows),) which rows of the actors are hidden: neither a corner nor the centre is in sight of the eye.

    `hiding` are the rows of those that hide others; nobody hides itself, and
    who overlaps the eye hides nobody.
    """
    x_m, y_m = actors.x_m - eye[0], actors.y_m - eye[1]
    radius_m = 0.5 * np.hypot(actors.length_m, actors.width_m)
    to_x, to_y, to_radius_m = x_m[rows], y_m[rows], radius_m[rows]
    away_m = np.maximum(np.hypot(to_x, to_y), 1e-9)
    ahead_x, ahead_y = to_x / away_m, to_y / away_m
    box_x, box_y = x_m[hiding, None], y_m[hiding, None]
    reach_m = radius_m[hiding, None] + to_radius_m
    along_m = box_x * ahead_x + box_y * ahead_y
    near = np.abs(box_y * ahead_x - box_x * ahead_y) < reach_m  # circles around both: most pairs end here
    near &= (along_m > -reach_m) & (along_m < away_m + reach_m) & (hiding[:, None] != rows)
    which, whom = near.nonzero()
    if not len(which):
        return np.zeros(len(rows), dtype=np.bool_)
    columns = (x_m, y_m, actors.heading_rad, actors.length_m, actors.width_m)
    boxes = Boxes(*(column[hiding[which]] for column in columns))
    points_x, points_y = _points(*(column[rows] for column in columns))
    cut = boxes.cut(points_x[:, whom], points_y[:, whom]) & ~boxes.holds_eye()
    shut = np.zeros(points_x.shape, dtype=np.bool_)
    of_point, of_pair = cut.nonzero()
    shut[of_point, whom[of_pair]] = True
    return np.logical_and.reduce(shut, axis=0)


def _points(x_m: Floats, y_m: Floats, heading_rad: Floats, length_m: Floats, width_m: Floats) -> tuple[Floats, Floats]:
    """(5, N) x and y of the centres and the corners of boxes."""
    cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
    points_x = x_m + AHEAD * (cosine * length_m / 2) + LEFT * (-sine * width_m / 2)
    points_y = y_m + AHEAD * (sine * length_m / 2) + LEFT * (cosine * width_m / 2)
    return points_x, points_y
