"""Where SUMO's cars are, held to motions that a car can make.

SUMO moves the middle of a car's front bumper and draws the body back from it to
where it believes the rear to be; while a car changes lane that body slips
sideways, and beside a junction its angle jumps by up to 90 degrees and back.
Here the front is SUMO's, and the body is trailed by it: the rear axle rolls the
way it points, but for a small slip that lets it stay near SUMO's angle.
A lane change that is cut short by a jump to the middle of the next lane slides.
"""

from __future__ import annotations

from math import degrees, pi

import numpy as np
from numpy.typing import ArrayLike

from interplan_sumo.world.geometry import Floats, wrap_angle

REAR_AXLE = 0.78
"""How far behind the front bumper the rear axle is, as a share of the length: nuPlan's Pacifica."""
LARGEST_SLIP_RAD = 0.1
"""Between the way that the rear axle goes and the way that it points; decisions.md allows 10 degrees."""
STRETCH = 1.2
"""SUMO scales the lanes of an edge to one length; on the outer lane of a bend cars go faster than they say."""
LEAST = 0.5
"""On the inner lane they go slower; a step that is shorter still is a jump back, from one edge to the next."""
STEEPEST = 1.0
"""Way to the side per way ahead of a front bumper, at full lock; who stands stands still, whatever SUMO slides."""
DISPLACED_M = 0.1
STRAIGHT_RAD = 1e-4
"""Turned by less in a step, and moved sideways by less, nobody slips."""
STRAIGHT_M = 1e-3
STANDING_M = 1e-6
"""Less than this in a step is no motion."""
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
        self.displaced: frozenset[int] = frozenset()
        """Rows of cars that are shown elsewhere than where SUMO has them, which slid sideways without driving."""
        self._new: list[int] = []

    def move(self, front_m: ArrayLike, angle_deg: ArrayLike, speed_mps: ArrayLike, length_m: Floats) -> None:
        """Take over SUMO's positions, navigation angles and speeds after a step, held to what a car can do.

        `length_m` (N,) are the lengths of the cars, in m.
        """
        front = np.array(front_m, dtype=np.float64).reshape(-1, 2)
        heading = (pi / 2.0 - np.radians(angle_deg) + pi) % (2.0 * pi) - pi
        speed = np.array(speed_mps, dtype=np.float64)
        self.turned_rad, self.most_turned_rad, self.displaced = np.zeros(0), 0.0, frozenset[int]()
        if self._new:
            rows, self._new = self._new, []
            came = np.stack((np.cos(heading[rows]), np.sin(heading[rows])), axis=1) * speed[rows, None]
            self.front_m[rows], self.heading_rad[rows] = front[rows] - self._dt_s * came, heading[rows]
        if len(front) and len(self.front_m):
            went = front - self.front_m
            cosine, sine = np.cos(self.heading_rad), np.sin(self.heading_rad)
            along_m = went[:, 0] * cosine + went[:, 1] * sine
            left_m = went[:, 1] * cosine - went[:, 0] * sine
            held = np.maximum(along_m, LEAST * self._dt_s * speed)
            most_m = STRETCH * self._dt_s * speed + SLIDE_M
            held_left = np.clip(left_m, -STEEPEST * held, STEEPEST * held)
            shrunk = np.minimum(1.0, most_m / np.maximum(np.hypot(held, held_left), 1e-9))
            odd = np.flatnonzero((held > along_m) | (held_left != left_m) | (shrunk < 1.0))
            if len(odd):
                along_m, left_m = held * shrunk, held_left * shrunk
                went[odd, 0] = along_m[odd] * cosine[odd] - left_m[odd] * sine[odd]
                went[odd, 1] = along_m[odd] * sine[odd] + left_m[odd] * cosine[odd]
                shown = self.front_m[odd] + went[odd]
                off_m = np.hypot(*(front[odd] - shown).T)
                front[odd] = shown
                self.displaced = frozenset(odd[off_m > DISPLACED_M].tolist())
            self.turned_rad = turned = heading - self.heading_rad
            self.most_turned_rad = float(max(turned.max(), -turned.min()))
            if self.most_turned_rad > STRAIGHT_RAD or np.abs(left_m).max() > STRAIGHT_M:
                heading = self._trailed(went, heading, REAR_AXLE * length_m)
        self.front_m, self.heading_rad, self.speed_mps = front, heading, speed

    def _trailed(self, went_m: Floats, wanted_rad: Floats, axle_m: Floats) -> Floats:
        """The headings (N,) nearest to those wanted with which the rear axles do not slip more than they may.

        `went_m` (N, 2) is the motion of the fronts, `axle_m` (N,) from the front to the rear axle. A
        point that is pulled straight on by a rod trails it along a tractrix: tan(angle / 2) falls by exp(-way / rod).
        """
        way_m = np.hypot(went_m[:, 0], went_m[:, 1])
        towards = np.arctan2(went_m[:, 1], went_m[:, 0])
        off = wrap_angle(towards - self.heading_rad)
        left = 2.0 * np.arctan(np.tan(off / 2.0) * np.exp(-way_m / axle_m))
        rolled = np.where(way_m > STANDING_M, towards - left, self.heading_rad)
        axle_way_m = way_m * np.maximum(0.0, np.cos(off))
        slack = LARGEST_SLIP_RAD * axle_way_m / (axle_m + axle_way_m)
        apart = wrap_angle(wanted_rad - rolled)
        return np.where(np.abs(apart) <= slack, wanted_rad, wrap_angle(rolled + np.clip(apart, -slack, slack)))

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
