"""Bodies: where SUMO's cars are, made into motions that a body can make.

SUMO draws a body from its front to where it believes the rear to be. While a
car changes lane beside a junction that belief is wrong for some steps, and
the angle jumps by up to 90 degrees and back; and a lane change that reaches
the end of its lane is cut short by a jump to the middle of the next. A body
turns no faster than its wheels allow, and slides no faster than in a lane change.
"""

from __future__ import annotations

from math import pi

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


class Bodies:
    """All agents at one instant, in SUMO's frame, rows as given."""

    def __init__(self, dt_s: float) -> None:
        self._dt_s = dt_s
        self.front_m: Floats = np.zeros((0, 2))
        """(N, 2) middle of the front bumper."""
        self.heading_rad: Floats = np.zeros(0)
        self.speed_mps: Floats = np.zeros(0)
        self._moved = False

    def move(self, front_m: ArrayLike, angle_deg: ArrayLike, speed_mps: ArrayLike) -> None:
        """Take over SUMO's positions, navigation angles and speeds after a step, held to what a body can do."""
        front = np.array(front_m, dtype=np.float64).reshape(-1, 2)
        heading = (pi / 2.0 - np.radians(angle_deg) + pi) % (2.0 * pi) - pi
        speed = np.array(speed_mps, dtype=np.float64)
        if self._moved:
            most_rad = SHARPEST_TURN_PER_M * self._dt_s * speed + TURN_SLACK_RAD
            turned = wrap_angle(heading - self.heading_rad)
            too_far = np.abs(turned) > most_rad
            if too_far.any():
                reached = wrap_angle(self.heading_rad + np.clip(turned, -most_rad, most_rad))
                heading = np.where(too_far, reached, heading)
            most_m = STRETCH * self._dt_s * speed + SLIDE_M
            went = front - self.front_m
            went_m = np.hypot(went[:, 0], went[:, 1])
            if (went_m > most_m).any():
                front = self.front_m + went * np.minimum(1.0, most_m / np.maximum(went_m, 1e-9))[:, None]
        self.front_m, self.heading_rad, self.speed_mps = front, heading, speed
        self._moved = True

    def keep(self, stays: list[bool]) -> None:
        """Drop the rows of agents that have left."""
        rows = np.flatnonzero(stays)
        self.front_m, self.heading_rad = self.front_m[rows], self.heading_rad[rows]
        self.speed_mps = self.speed_mps[rows]
