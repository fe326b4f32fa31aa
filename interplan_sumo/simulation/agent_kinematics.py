"""Where SUMO's cars are, held to motions that a car can make.

SUMO moves the middle of a car's front bumper and draws the body back from it to
where it believes the rear to be; while a car changes lane that body slips
sideways, and beside a junction its angle jumps by up to 90 degrees and back.
Here the front is SUMO's, and the body is trailed by it: the rear axle rolls the
way it points, but for a small slip that lets it stay near SUMO's angle. A bus or
a lorry steers far behind its bumper: there the front axle goes where SUMO's front
went, the bumper swings out, and the rear cuts in less.
A lane change that is cut short by a jump to the middle of the next lane slides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import atan, atan2, cos, degrees, exp, hypot, pi, sin, tan

import numpy as np
from numpy.typing import ArrayLike, NDArray

from interplan_sumo.world.geometry import Floats, box_polygons, wrap_angle

REAR_AXLE = 0.78
"""How far behind the front bumper the rear axle is, as a share of the length: nuPlan's Pacifica."""
LONG_M = 6.5
"""Longer vehicles steer at their front axle."""
FRONT_AXLE = 0.2
"""Of those, behind the front bumper, as a share of the length: 2.7 m of a city bus of 12 m, 1.4 m of a lorry of 8 m."""
LARGEST_SLIP_RAD = 0.13
"""Between the way that the rear axle goes and the way that it points; decisions.md allows 10 degrees."""
STRETCH = 1.2
"""SUMO scales the lanes of an edge to one length; on the outer lane of a bend cars go faster than they say."""
LEAST = 0.5
"""On the inner lane they go slower; a step that is shorter still is a jump back, from one edge to the next."""
STEEPEST = 1.0
"""Way to the side per way ahead of a front bumper, at full lock; who stands stands still, whatever SUMO slides."""
STEEPEST_LONG = 0.8
"""The same of the front axle of a long vehicle, whose wheels are nearer to one another: 39 degrees."""
NEARLY = 0.2
"""As a share of the step: a front this near to where its speed would take it straight on needs no holding."""
DISPLACED_M = 0.1
STRAIGHT_RAD = 1e-4
"""Turned by less in a step, and moved sideways by less, nobody slips."""
STRAIGHT_M = 1e-3
STANDING_M = 1e-6
"""Less than this in a step is no motion."""
SLIDE_M = 0.2
"""Per step, for the lateral speed of a lane change, 3.5 m in 3 s; no more than the way that a slow car drives."""


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
        self.cosine: Floats = np.zeros(0)
        """Of the headings, as `sine`."""
        self.sine: Floats = np.zeros(0)
        self.speed_mps: Floats = np.zeros(0)
        self.turned_rad: Mapping[int, float] = {}
        """By SUMO's angle since the step before, not wrapped, of the rows where that is more than `STRAIGHT_RAD`."""
        self.displaced: frozenset[int] = frozenset()
        """Rows of cars that are shown elsewhere than where SUMO has them, which slid sideways without driving."""
        self._steered_m: Floats = np.zeros((0, 2))
        """(N, 2) what is steered: the middle of the front bumper, of long ones that of the front axle."""
        self._trails: list[list[tuple[float, float]]] = []
        """Where SUMO's fronts have been of late, the latest last; of long ones only."""
        self._new: list[int] = []

    def move(self, front_m: ArrayLike, angle_deg: ArrayLike, speed_mps: ArrayLike, length_m: Floats) -> None:
        """Take over SUMO's positions, navigation angles and speeds after a step, held to what a car can do.

        `front_m` are x and y of one after the other, `length_m` (N,) the lengths of the cars. Arrays are kept.
        """
        front, speed = np.asarray(front_m, dtype=np.float64).reshape(-1, 2), np.asarray(speed_mps, dtype=np.float64)
        heading = (pi / 2.0 - np.radians(angle_deg) + pi) % (2.0 * pi) - pi
        turns: dict[int, float] = {}
        self.turned_rad, self.displaced = turns, frozenset()
        long = np.flatnonzero(length_m > LONG_M).tolist()
        steered = self._steered(front, heading, FRONT_AXLE * length_m, long)
        if self._new:
            rows, self._new = self._new, []
            came = np.stack((np.cos(heading[rows]), np.sin(heading[rows])), axis=1) * speed[rows, None]
            self._steered_m[rows], self.heading_rad[rows] = steered[rows] - self._dt_s * came, heading[rows]
            self.cosine, self.sine = np.cos(self.heading_rad), np.sin(self.heading_rad)
        if len(front):
            went = steered - self._steered_m
            along_m = went[:, 0] * self.cosine + went[:, 1] * self.sine
            left_m = went[:, 1] * self.cosine - went[:, 0] * self.sine
            step_m, aside_m = self._dt_s * speed, np.abs(left_m)
            if np.count_nonzero(np.abs(along_m - step_m) + aside_m > NEARLY * step_m):
                steepest = np.where(length_m > LONG_M, STEEPEST_LONG, STEEPEST)
                odd = (along_m < LEAST * step_m) | (aside_m > steepest * along_m)
                odd |= np.hypot(along_m, left_m) > _farthest_m(step_m)
                self._hold(steered, along_m, left_m, step_m, steepest, odd.nonzero()[0])
            turned = heading - self.heading_rad
            for row in ((np.abs(turned) > STRAIGHT_RAD) | (aside_m > STRAIGHT_M)).nonzero()[0].tolist():
                before, wanted = float(self.heading_rad[row]), float(heading[row])
                axle_m = (REAR_AXLE - FRONT_AXLE if row in long else REAR_AXLE) * float(length_m[row])
                if abs(wanted - before) > STRAIGHT_RAD:
                    turns[row] = wanted - before
                heading[row] = _trailed(before, wanted, float(along_m[row]), float(left_m[row]), axle_m)
        self.heading_rad, self.speed_mps = heading, speed
        self.cosine, self.sine = np.cos(heading), np.sin(heading)
        self.front_m = self._steered_m = steered
        if long:
            swung = FRONT_AXLE * length_m[long, None]
            self.front_m = steered.copy()
            self.front_m[long] += swung * np.stack((self.cosine[long], self.sine[long]), axis=1)

    def _steered(self, front: Floats, heading_rad: Floats, behind_m: Floats, rows: list[int]) -> Floats:
        """(N, 2) SUMO's fronts, but for those in `rows`: they go where SUMO's fronts were `behind_m` before."""
        steered = front.copy() if rows else front
        for row in rows:
            x, y = front[row].tolist()
            trail, reach_m = self._trails[row], float(behind_m[row])
            if not trail:
                trail.append((x - reach_m * cos(heading_rad[row]), y - reach_m * sin(heading_rad[row])))
            if trail[-1] != (x, y):
                trail.append((x, y))
            steered[row], first = _behind(trail, reach_m)
            del trail[:first]
        return steered

    def _hold(
        self, steered: Floats, along_m: Floats, left_m: Floats, step_m: Floats, steepest: Floats, rows: NDArray[np.intp]
    ) -> None:
        """Hold the motion of what is steered in `rows` to what a car can do, in place."""
        if not len(rows):
            return
        along = np.maximum(along_m[rows], LEAST * step_m[rows])
        left = np.clip(left_m[rows], -steepest[rows] * along, steepest[rows] * along)
        shrunk = np.minimum(1.0, _farthest_m(step_m[rows]) / np.maximum(np.hypot(along, left), 1e-9))
        along_m[rows], left_m[rows] = along, left = along * shrunk, left * shrunk
        cosine, sine = self.cosine[rows], self.sine[rows]
        shown = self._steered_m[rows] + np.stack((along * cosine - left * sine, along * sine + left * cosine), axis=1)
        off_m = np.hypot(*(steered[rows] - shown).T)
        steered[rows] = shown
        self.displaced = frozenset(rows[off_m > DISPLACED_M].tolist())

    def insert(self, rows: list[int]) -> None:
        """Make room for agents that have entered, at these rows of the new order; they begin where SUMO says next."""
        old = [row for row in range(len(self.front_m) + len(rows)) if row not in set(rows)]
        front, steered, heading, speed = self.front_m, self._steered_m, self.heading_rad, self.speed_mps
        many = len(old) + len(rows)
        self.front_m, self._steered_m = np.zeros((many, 2)), np.zeros((many, 2))
        self.heading_rad, self.speed_mps = np.zeros(many), np.zeros(many)
        self.front_m[old], self._steered_m[old] = front, steered
        self.heading_rad[old], self.speed_mps[old] = heading, speed
        for row in rows:
            self._trails.insert(row, [])
        self._new = rows

    def keep(self, stays: list[bool]) -> None:
        """Drop the rows of agents that have left."""
        rows = np.flatnonzero(stays)
        self.front_m, self._steered_m = self.front_m[rows], self._steered_m[rows]
        self.heading_rad, self._trails = self.heading_rad[rows], [self._trails[row] for row in rows.tolist()]
        self.speed_mps = self.speed_mps[rows]
        self.cosine, self.sine = self.cosine[rows], self.sine[rows]


def _behind(trail: Sequence[tuple[float, float]], reach_m: float) -> tuple[tuple[float, float], int]:
    """The point `reach_m` before the end of a trail, measured along it, or its first; and the place before that."""
    left_m = reach_m
    for k in range(len(trail) - 1, 0, -1):
        (x0, y0), (x1, y1) = trail[k - 1], trail[k]
        step_m = hypot(x1 - x0, y1 - y0)
        if step_m >= left_m > 0.0:
            share = left_m / step_m
            return (x1 + share * (x0 - x1), y1 + share * (y0 - y1)), k - 1
        left_m -= step_m
    return trail[0], 0


def _farthest_m(step_m: Floats) -> Floats:
    """How far a front can have moved in a step in which its car drove `step_m`."""
    return STRETCH * step_m + np.minimum(SLIDE_M, step_m)


def bodies(front_poses: Floats, length_m: ArrayLike, width_m: ArrayLike) -> NDArray[np.object_]:
    """(N,) boxes of cars whose front bumpers are at (N, 3) x, y, heading; lengths and widths (N,) or of all."""
    x, y, heading = front_poses.T
    half_m = np.asarray(length_m, dtype=np.float64) / 2.0
    return box_polygons(x - half_m * np.cos(heading), y - half_m * np.sin(heading), heading, length_m, width_m)


def rolled_rad(heading_rad: float, along_m: float, left_m: float, axle_m: float) -> float:
    """The heading after the front has moved by `along_m` and `left_m` as seen from the heading before, not wrapped.

    It is `axle_m` ahead of the rear axle, which rolls. A point that is pulled straight on by a rod trails it along
    a tractrix: tan(angle / 2) falls by exp(-way / rod).
    """
    way_m = hypot(along_m, left_m)
    if way_m <= STANDING_M:
        return heading_rad
    off = atan2(left_m, along_m)
    return heading_rad + off - 2.0 * atan(tan(off / 2.0) * exp(-way_m / axle_m))


def _trailed(heading_rad: float, wanted_rad: float, along_m: float, left_m: float, axle_m: float) -> float:
    """The heading nearest to the one wanted with which the rear axle does not slip more than it may.

    The other arguments are those of `rolled_rad`.
    """
    rolled = rolled_rad(heading_rad, along_m, left_m, axle_m)
    slack = LARGEST_SLIP_RAD * max(0.0, along_m) / (axle_m + max(0.0, along_m))
    apart = wrap_angle(wanted_rad - rolled)
    return wanted_rad if abs(apart) <= slack else wrap_angle(rolled + min(max(apart, -slack), slack))
