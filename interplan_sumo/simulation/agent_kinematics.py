"""Where SUMO's cars are, held to motions that a car can make.

SUMO draws a car from its front to where it believes the rear to be. While a
car changes lane beside a junction that belief is wrong for some steps, and
the angle jumps by up to 90 degrees and back; and a lane change that reaches
the end of its lane is cut short by a jump to the middle of the next. A car
turns no faster than its wheels allow, and slides no faster than in a lane change.
"""

from __future__ import annotations

from math import degrees, pi

import numpy as np
from numpy.typing import ArrayLike

from interplan_sumo.world.geometry import Floats, wrap_angle

SHARPEST_TURN_PER_M = 0.25
"""Curvature of a car at full lock: tan(35 degrees) over a wheelbase of 2.8 m."""
TURN_SLACK_RAD = 0.02
"""Per step, for a car that SUMO slides sideways at its least lateral speed, 0.5 m/s."""
STRETCH = 1.2
"""SUMO scales the lanes of an edge to one length; on the outer lane of a bend cars go faster than they say."""
SLIDE_M = 0.2
"""Per step, for the lateral speed of a lane change, 3.5 m in 3 s."""


def navigation_deg(heading_rad: float) -> float:
    """SUMO's angle: degrees clockwise from north."""
    return round((90.0 - degrees(heading_rad)) % 360.0, 6)


class AgentKinematics:
    """All agents at one instant, in SUMO's frame, rows as given."""

    def __init__(self, dt_s: float) -> None:
        self._dt_s = dt_s
        self.front_m: Floats = np.zeros((0, 2))
        """(N, 2) middle of the front bumper."""
        self.heading_rad: Floats = np.zeros(0)
        self.speed_mps: Floats = np.zeros(0)
        self.turned_rad: Floats = np.zeros(0)
        """By SUMO's angle since the step before, not wrapped; none in the first step."""
        self.most_turned_rad = 0.0
        """The largest of `turned_rad`, to either side."""
        self._new: list[int] = []

    def move(self, front_m: ArrayLike, angle_deg: ArrayLike, speed_mps: ArrayLike) -> None:
        """Take over SUMO's positions, navigation angles and speeds after a step, held to what a car can do."""
        front = np.array(front_m, dtype=np.float64).reshape(-1, 2)
        heading = (pi / 2.0 - np.radians(angle_deg) + pi) % (2.0 * pi) - pi
        speed = np.array(speed_mps, dtype=np.float64)
        self.turned_rad, self.most_turned_rad = np.zeros(0), 0.0
        if self._new:
            rows, self._new = self._new, []
            self.front_m[rows], self.heading_rad[rows] = front[rows], heading[rows]
        if len(front) and len(self.front_m):
            self.turned_rad = turned = heading - self.heading_rad
            self.most_turned_rad = float(max(turned.max(), -turned.min()))
            if self.most_turned_rad > TURN_SLACK_RAD:
                heading = self._followed(heading, speed)
            went = front - self.front_m
            most_m = STRETCH * self._dt_s * speed + SLIDE_M
            squared = went[:, 0] ** 2 + went[:, 1] ** 2
            if (squared > most_m * most_m).any():
                front = self.front_m + went * np.minimum(1.0, most_m / np.sqrt(np.maximum(squared, 1e-9)))[:, None]
        self.front_m, self.heading_rad, self.speed_mps = front, heading, speed

    def _followed(self, heading_rad: Floats, speed_mps: Floats) -> Floats:
        turned = wrap_angle(self.turned_rad)
        most_rad = SHARPEST_TURN_PER_M * self._dt_s * speed_mps + TURN_SLACK_RAD
        reached = wrap_angle(self.heading_rad + np.clip(turned, -most_rad, most_rad))
        return np.where(np.abs(turned) > most_rad, reached, heading_rad)

    def insert(self, rows: list[int]) -> None:
        """Make room for agents that have entered, at these rows of the new order; they begin where SUMO says next."""
        old = [row for row in range(len(self.front_m) + len(rows)) if row not in set(rows)]
        front, heading, speed = self.front_m, self.heading_rad, self.speed_mps
        many = len(old) + len(rows)
        self.front_m, self.heading_rad, self.speed_mps = np.zeros((many, 2)), np.zeros(many), np.zeros(many)
        self.front_m[old], self.heading_rad[old], self.speed_mps[old] = front, heading, speed
        self._new = rows

    def keep(self, stays: list[bool]) -> None:
        """Drop the rows of agents that have left."""
        rows = np.flatnonzero(stays)
        self.front_m, self.heading_rad = self.front_m[rows], self.heading_rad[rows]
        self.speed_mps = self.speed_mps[rows]
