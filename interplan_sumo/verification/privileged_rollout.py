"""Privileged rollout: a speed profile on its paths followed through the ego's own tracker and bicycle.

It knows where everybody will be, so it looks at nothing. What it drives is
what an ego in an episode would that is given these plans, step by step by the
same `follow`: feasible by construction.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from math import cos, sin, tan

import numpy as np

from interplan_sumo.dynamics.bicycle import ACCELERATION_LAG_S, STEERING_LAG_S
from interplan_sumo.dynamics.lqr import (
    HEADING_WEIGHT,
    HORIZON_STEPS,
    LATERAL_WEIGHT,
    TIRE_RATE_WEIGHT,
    TRACKING_GAIN_PER_S,
    follow,
)
from interplan_sumo.scenario.route import GoalLine, goal_arc_m, route_centerline
from interplan_sumo.simulation.episode import DT_S
from interplan_sumo.verification.corridor import GRID_M, FrenetCorridor, smoothed
from interplan_sumo.verification.drivable_paths import DrivablePath, headings_of, quintic
from interplan_sumo.verification.planning_problem import SpeedProfile
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Floats, wrap_angle
from interplan_sumo.world.trajectory import Trajectory

PLAN_S = 1.5
"""Length of the plans; the tracker looks 1 s ahead."""
SPEED_GAIN_PER_S, PLACE_GAIN_PER_S2 = 1.0, 0.4
"""How the driver corrects what it is off its speed profile by."""
RETURN_S, SHORTEST_RETURN_M = 0.7, 4.5
"""The rear axle is steered back to the line within this time, over this length at least."""
JOIN_M = 30.0
"""A drive that begins beside the middle of its lane is there after this length."""
STEERING_RADPS, LARGEST_TIRE_RAD = 0.6, 0.6
FELT_MPS2 = (-3.8, 2.1)
"""Acceleration along the car as the metric of comfort has it; its bounds are -4.05 and 2.4."""
PUSH_MPS2 = (-4.5, 2.5)
SOFTENING_S = 0.5
"""Changes of acceleration are spread over about twice this time, so that nobody feels a jerk."""
DECIMALS = 6
"""States are rounded to these, so that they can be stored exactly."""
_STEERING_PASSED = DT_S / (DT_S + STEERING_LAG_S)
_PASSED = DT_S / (DT_S + ACCELERATION_LAG_S)


@dataclass(frozen=True, slots=True, eq=False)
class RolloutPath:
    """A line in the map frame with the corridor's arc at each of its points."""

    corridor_m: Floats  # (P,)
    along_m: Floats  # (P,) own arc length
    x_m: Floats  # (P,)
    y_m: Floats  # (P,)
    heading_rad: Floats
    """(P,) not wrapped."""
    bend_per_m: Floats
    """(P,) curvature, left positive."""
    bend_change_per_m2: Floats  # (P,)


def planned_line(corridor: FrenetCorridor, paths: tuple[DrivablePath, ...], profile: SpeedProfile) -> RolloutPath:
    """The line that a speed profile drives: along its paths, from one to the next in its lane changes."""
    arc = corridor.arc_m
    left = _filled(paths[profile.path].left_m)
    for change in profile.changes:
        share = quintic((arc - change.from_m) / max(change.to_m - change.from_m, 1.0))
        left = (1.0 - share) * left + share * _filled(paths[change.path].left_m)
    if corridor.scenario.start.left_m:
        left = left + corridor.scenario.start.left_m * (1.0 - quintic((arc - corridor.start_m) / JOIN_M))
    xy = corridor.points(left)
    xy = np.stack((smoothed(xy[:, 0], 2), smoothed(xy[:, 1], 2)), axis=1)
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))))
    heading = headings_of(xy)
    bend = smoothed(np.gradient(heading) / np.gradient(along), 1)
    change = smoothed(np.gradient(bend) / np.gradient(along), 2)
    return RolloutPath(arc, along, xy[:, 0], xy[:, 1], heading, bend, change)


def _filled(left_m: Floats) -> Floats:
    """Offsets held on where a path does not exist."""
    exists = np.flatnonzero(np.isfinite(left_m))
    return np.interp(np.arange(len(left_m)), exists, left_m[exists])


def driven(
    corridor: FrenetCorridor, line: RolloutPath, profile: SpeedProfile, before: tuple[EgoState, ...], frames: int
) -> tuple[EgoState, ...]:
    """The states of the drive from frame 0 to the one beyond the goal line, or to `frames`, that one included.

    `before` are those up to the frame where the speed profile begins, that one included.
    """
    states = list(before)
    now = states[-1]
    begin_m = _place_on(line, now, float(np.interp(profile.arc_m[0], line.corridor_m, line.along_m)))
    wanted = _softened(_places(line, profile, frames - profile.frame + 1), begin_m, now.vx_mps, now.ax_mps2)
    speeds = np.gradient(wanted, DT_S)
    pushes = np.gradient(speeds, DT_S)
    roads, scenario = corridor.roads, corridor.scenario
    goal = GoalLine(route_centerline(roads, scenario), goal_arc_m(roads, scenario))
    for i in range(frames - profile.frame):
        ego = states[-1]
        if goal.is_passed(ego.x_m, ego.y_m):
            break
        along_m = _place_on(line, ego, float(wanted[i]))
        wish = float(pushes[i + 1]) + SPEED_GAIN_PER_S * (float(speeds[i]) - ego.vx_mps)
        wish += PLACE_GAIN_PER_S2 * (float(wanted[i]) - along_m)
        steering = _steering_radps(line, ego)
        turning = _turning_mps2(ego, steering)
        wish = max(FELT_MPS2[0] - turning, min(FELT_MPS2[1] - turning, wish))
        push = ego.ax_mps2 + (wish - ego.ax_mps2) / _PASSED  # the bicycle lets only a share of a change pass
        push = max(PUSH_MPS2[0], min(PUSH_MPS2[1], push))
        states.append(rounded(follow(ego, _plan(ego, push, steering / _STEERING_PASSED), DT_S)))
    return tuple(states)


def rounded(state: EgoState) -> EgoState:
    """The state with all numbers rounded to `DECIMALS`."""
    return replace(state, **{f.name: round(getattr(state, f.name), DECIMALS) + 0.0 for f in fields(state)})


def _places(line: RolloutPath, profile: SpeedProfile, count: int) -> Floats:
    """(count,) own arc length at each frame from the speed profile's first on; at the end the speed is held."""
    frame_s = DT_S * np.arange(count)
    knot = np.minimum(frame_s.astype(np.int64), len(profile.arc_m) - 1)
    speed = profile.speed_mps
    push = np.append(np.diff(speed), 0.0)
    into_s = frame_s - knot
    places = profile.arc_m[knot] + speed[knot] * into_s + 0.5 * push[knot] * into_s**2
    corridor_end = float(line.corridor_m[-1])
    along = np.interp(places, line.corridor_m, line.along_m)
    return along + np.maximum(places - corridor_end, 0.0)


def _softened(places_m: Floats, begin_m: float, speed_mps: float, push_mps2: float) -> Floats:
    """(K,) the nearest places to (K,) that begin with the given state and have little jerk: a smoothing spline.

    Minimises |z - places|^2 + weight^2 |third differences of z|^2 over all but
    the first place; two places before it stand for speed and acceleration.
    """
    count = len(places_m) - 1
    weight = (SOFTENING_S / DT_S) ** 3
    before = [begin_m + speed_mps * t + 0.5 * push_mps2 * t * t for t in (-2.0 * DT_S, -DT_S, 0.0)]
    right = places_m[1:].tolist()
    # What the third differences of the known places pull at the first three unknown ones.
    known = [-before[i] + 3.0 * _at(before, i + 1) - 3.0 * _at(before, i + 2) for i in range(3)]
    for row, pull in enumerate(known[:count]):
        for shift, share in enumerate(_THIRD):
            if row - shift >= 0:
                right[row - shift] -= weight * weight * share * pull
    return np.array([begin_m, *_solved(count, right)])


_THIRD = (1.0, -3.0, 3.0, -1.0)
"""A third difference from its last value backwards."""


def _at(values: list[float], index: int) -> float:
    return values[index] if index < len(values) else 0.0


@lru_cache(maxsize=64)
def _factors(count: int) -> tuple[list[float], list[list[float]]]:
    """The matrix of the spline over `count` places as L D L': D, and the three subdiagonals of L by column."""
    square = (SOFTENING_S / DT_S) ** 6
    bands = [[0.0] * count for _ in range(4)]  # bands[d][j] is the entry (j + d, j)
    for row in range(count):
        for one, share in enumerate(_THIRD):
            for other in range(one, 4):
                if row - other >= 0:
                    bands[other - one][row - other] += square * share * _THIRD[other]
    pivots: list[float] = []
    below: list[list[float]] = [[0.0] * count for _ in range(4)]  # below[d][j] is L's entry (j + d, j)
    for j in range(count):
        pivot = 1.0 + bands[0][j] - sum(below[k][j - k] ** 2 * pivots[j - k] for k in (1, 2, 3) if j >= k)
        pivots.append(pivot)
        for d in (1, 2, 3):
            if j + d < count:
                rest = sum(below[d + k][j - k] * below[k][j - k] * pivots[j - k] for k in range(1, 4 - d) if j >= k)
                below[d][j] = (bands[d][j] - rest) / pivot
    return pivots, below


def _solved(count: int, right: list[float]) -> list[float]:
    """The places from the right-hand side, in a fixed order of additions: equal on every machine."""
    pivots, below = _factors(count)
    forward: list[float] = []
    for j in range(count):
        forward.append(right[j] - sum(below[k][j - k] * forward[j - k] for k in (1, 2, 3) if j >= k))
    places = [value / pivot for value, pivot in zip(forward, pivots, strict=True)]
    for j in range(count - 1, -1, -1):
        places[j] -= sum(below[d][j] * places[j + d] for d in (1, 2, 3) if j + d < count)
    return places


def _place_on(line: RolloutPath, ego: EgoState, near_m: float) -> float:
    """Own arc length of the ego's projection, looked for around where it should be."""
    first, end = np.searchsorted(line.along_m, (near_m - 15.0, near_m + 15.0))
    first, end = max(int(first) - 1, 0), int(end) + 1
    i = first + int(np.argmin((line.x_m[first:end] - ego.x_m) ** 2 + (line.y_m[first:end] - ego.y_m) ** 2))
    heading = float(line.heading_rad[i])
    ahead_m = (ego.x_m - float(line.x_m[i])) * cos(heading) + (ego.y_m - float(line.y_m[i])) * sin(heading)
    return float(line.along_m[i]) + max(-GRID_M, min(GRID_M, ahead_m))


def _steering_radps(line: RolloutPath, ego: EgoState) -> float:
    """The tyre rate that brings the rear axle back to the line, by the quintic from where and how it is now."""
    rear = ego.rear_axle(PACIFICA)
    at_m, off_m = _beside(line, rear.x_m, rear.y_m)
    heading_rad, bend, change = (
        float(np.interp(at_m, line.along_m, column))
        for column in (line.heading_rad, line.bend_per_m, line.bend_change_per_m2)
    )
    turned = float(wrap_angle(ego.heading_rad - heading_rad))
    off_m -= bend * PACIFICA.rear_axle_to_center_m**2 / 2.0  # in a bend the rear runs further in than the centre
    own_bend = tan(ego.tire_angle_rad) / PACIFICA.wheelbase_m
    length_m = max(RETURN_S * ego.vx_mps, SHORTEST_RETURN_M)
    jerk = -60.0 * off_m / length_m**3 - 36.0 * tan(turned) / length_m**2 - 9.0 * (own_bend - bend) / length_m
    rate = PACIFICA.wheelbase_m * cos(ego.tire_angle_rad) ** 2 * ego.vx_mps * (change + jerk)
    return max(-STEERING_RADPS, min(STEERING_RADPS, rate))


def _turning_mps2(ego: EgoState, steering_radps: float) -> float:
    """What turning adds to the acceleration along the car in the metric of comfort: the yaw acceleration leaks in."""
    change = steering_radps / cos(ego.tire_angle_rad) ** 2 * ego.vx_mps + tan(ego.tire_angle_rad) * ego.ax_mps2
    return PACIFICA.rear_axle_to_center_m * (ego.yaw_rate_radps**2 + change / PACIFICA.wheelbase_m)


def _plan(ego: EgoState, push_mps2: float, steering_radps: float) -> Trajectory:
    """A plan that makes the tracker accelerate and steer as wanted: the motion under both, drawn out.

    The tracker holds back a little of either: it weighs effort against error.
    """
    slope, speed = push_mps2 / TRACKING_GAIN_PER_S, max(0.0, ego.vx_mps)
    acceleration = TRACKING_GAIN_PER_S * slope
    heading_effect = lateral_effect = 0.0
    for i in range(HORIZON_STEPS):
        travelled_m = DT_S * max(0.0, speed + i * DT_S * acceleration)
        lateral_effect += travelled_m * heading_effect
        heading_effect += travelled_m * i * DT_S / PACIFICA.wheelbase_m
    pull = LATERAL_WEIGHT * lateral_effect**2 + HEADING_WEIGHT * heading_effect**2
    rate = steering_radps * (pull + TIRE_RATE_WEIGHT) / max(pull, 0.1)
    count = round(PLAN_S / DT_S)
    after_s = (DT_S * np.arange(count + 1)).astype(np.float64)
    speeds = np.maximum(0.0, speed + slope * after_s)
    tires = np.clip(ego.tire_angle_rad + rate * after_s, -LARGEST_TIRE_RAD, LARGEST_TIRE_RAD)
    travelled = DT_S * (speeds[:-1] + speeds[1:]) / 2.0
    heading = ego.heading_rad + np.concatenate(
        ([0.0], np.cumsum(travelled * np.tan(tires[:-1]) / PACIFICA.wheelbase_m))
    )
    rear = ego.rear_axle(PACIFICA)
    x = rear.x_m + np.concatenate(([0.0], np.cumsum(travelled * np.cos(heading[:-1]))))
    y = rear.y_m + np.concatenate(([0.0], np.cumsum(travelled * np.sin(heading[:-1]))))
    ahead_m = PACIFICA.rear_axle_to_center_m
    return Trajectory(
        ego.time_s + after_s, x + ahead_m * np.cos(heading), y + ahead_m * np.sin(heading), wrap_angle(heading)
    )


def _beside(line: RolloutPath, x_m: float, y_m: float) -> tuple[float, float]:
    """Own arc length nearest to a point of the ego, and how far left of the line it is."""
    i = int(np.argmin((line.x_m - x_m) ** 2 + (line.y_m - y_m) ** 2))
    heading = float(line.heading_rad[i])
    dx, dy = x_m - float(line.x_m[i]), y_m - float(line.y_m[i])
    ahead_m = dx * cos(heading) + dy * sin(heading)
    at_m = float(line.along_m[i]) + ahead_m
    there = float(np.interp(at_m, line.along_m, line.heading_rad))
    dx, dy = x_m - float(np.interp(at_m, line.along_m, line.x_m)), y_m - float(np.interp(at_m, line.along_m, line.y_m))
    return at_m, -dx * sin(there) + dy * cos(there)
