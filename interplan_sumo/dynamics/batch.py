"""Many drives at once: tracker and bicycle for N plans of one ego, as planners need that score what they propose."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import pi

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.dynamics.bicycle import (
    ACCELERATION_LAG_S,
    MAX_ACCELERATION_MPS2,
    MAX_TIRE_ANGLE_RAD,
    STEERING_LAG_S,
)
from interplan_sumo.dynamics.lqr import (
    CURVATURE_RATE_PENALTY,
    GRID_S,
    HEADING_WEIGHT,
    HORIZON_STEPS,
    INITIAL_CURVATURE_PENALTY,
    LATERAL_WEIGHT,
    STOP_GAIN_PER_S,
    STOP_SPEED_MPS,
    TIRE_RATE_WEIGHT,
    TRACKING_GAIN_PER_S,
    speed_inverse,
)
from interplan_sumo.dynamics.rear_axle import rear_axles_of
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.geometry import Floats

_PASSED_ACCELERATION = GRID_S / (GRID_S + ACCELERATION_LAG_S)
_PASSED_STEERING = GRID_S / (GRID_S + STEERING_LAG_S)
"""What the lags let pass of a command within a step."""


@dataclass(frozen=True, eq=False)
class SimulatedDrives:
    """N drives of one ego: a row per drive, a column per 0.1 s, the first column is the common start.

    Meaning of the columns as in `EgoState`: box centre in the map frame,
    dynamics at the rear axle.
    """

    time_s: Floats  # (K + 1,)
    x_m: Floats  # (N, K + 1), as all below
    y_m: Floats
    heading_rad: Floats
    vx_mps: Floats
    ax_mps2: Floats
    tire_angle_rad: Floats
    tire_rate_radps: Floats
    yaw_rate_radps: Floats
    yaw_acceleration_radps2: Floats

    def __len__(self) -> int:
        return len(self.x_m)

    def thinned(self, every: int) -> SimulatedDrives:
        """The same drives with every n-th state only, from the start on."""
        columns = (getattr(self, column.name)[..., ::every] for column in fields(self))
        return SimulatedDrives(*columns)

    def state(self, drive: int, step: int) -> EgoState:
        """One state of one drive."""
        return EgoState(
            time_s=float(self.time_s[step]),
            x_m=float(self.x_m[drive, step]),
            y_m=float(self.y_m[drive, step]),
            heading_rad=float(self.heading_rad[drive, step]),
            vx_mps=float(self.vx_mps[drive, step]),
            ax_mps2=float(self.ax_mps2[drive, step]),
            tire_angle_rad=float(self.tire_angle_rad[drive, step]),
            tire_rate_radps=float(self.tire_rate_radps[drive, step]),
            yaw_rate_radps=float(self.yaw_rate_radps[drive, step]),
            yaw_acceleration_radps2=float(self.yaw_acceleration_radps2[drive, step]),
        )


def follow_all(
    start: EgoState, x_m: Floats, y_m: Floats, heading_rad: Floats, steps: int | None = None, shape: EgoShape = PACIFICA
) -> SimulatedDrives:
    """Where the ego gets if it follows each of N plans, each for `steps` of 0.1 s (default: to the end of the plans).

    Plans are poses of the box centre in the map frame, (N, M + 1) each, every
    0.1 s from the ego's time on. Equal to N times `lqr.follow` step after step
    with an unchanged plan, but for rounding. ValueError if the plans are not
    that long.
    """
    count = x_m.shape[1] - 1
    driven = count if steps is None else steps
    if count < 1 or not 0 <= driven <= count:
        raise ValueError(f"plans of {count} steps cannot be followed for {driven} steps")

    heading, turns = heading_rad, np.rint(np.diff(heading_rad, axis=1) / (2.0 * pi))
    if turns.any():
        heading = heading_rad.copy()
        heading[:, 1:] -= 2.0 * pi * np.cumsum(turns, axis=1)
    ref_x, ref_y = rear_axles_of(x_m, y_m, heading, shape)
    cosine, sine = np.cos(heading), np.sin(heading)
    forward_m = np.diff(ref_x, axis=1) * cosine[:, :-1] + np.diff(ref_y, axis=1) * sine[:, :-1]
    speed = np.einsum("nj,ij->ni", forward_m, speed_inverse(count))
    wished = _held(speed, HORIZON_STEPS + np.arange(driven))
    curvature = _curvatures(speed, np.diff(heading, axis=1))
    pose, across = np.stack((ref_x.T, ref_y.T, heading.T), axis=1), np.stack((sine.T, cosine.T), axis=1)
    v = np.ascontiguousarray(wished.T)
    return _drive(start, _References(pose, across, v, _bends(curvature, driven)), driven, shape)


@dataclass(frozen=True, slots=True, eq=False)
class _References:
    """What N plans ask for at the rear axle, by step: every row is contiguous."""

    pose: Floats  # (M + 1, 3, N) x, y and heading
    across: Floats  # (M + 1, 2, N) sine and cosine of the heading: what x and y add to an offset to the left
    speed_mps: Floats  # (K, N) one second ahead
    bend: Floats  # (K, 5, N) as `_bends` has it


def _drive(start: EgoState, plans: _References, steps: int, shape: EgoShape) -> SimulatedDrives:
    """Tracker and bicycle, step after step: `lqr.command` and `bicycle.step` on arrays."""
    many = plans.pose.shape[2]
    rows = np.empty((9, steps + 1, many))
    rear = start.rear_axle(shape)
    first = (
        rear.x_m, rear.y_m, start.heading_rad, start.vx_mps, start.ax_mps2, start.tire_angle_rad,
        start.tire_rate_radps, start.yaw_rate_radps, start.yaw_acceleration_radps2,
    )  # fmt: skip
    rows[:, 0] = np.array(first)[:, None]
    wished = plans.speed_mps
    slow = wished <= STOP_SPEED_MPS
    # speed answers to nothing but the speed that is wished for, so that it comes first and its terms need no loop
    asked, stopping = _speeds(rows[3], rows[4], wished, slow)
    _steer(rows, plans, asked, stopping, shape)
    wheelbase = shape.wheelbase_m
    rows[7, 1:] = rows[3, 1:] * np.tan(rows[5, 1:]) / wheelbase
    rows[8, 1:] = (rows[7, 1:] - rows[7, :-1]) / GRID_S
    ahead_m = shape.rear_axle_to_center_m
    rows[0] += ahead_m * np.cos(rows[2])
    rows[1] += ahead_m * np.sin(rows[2])
    columns = np.ascontiguousarray(rows.transpose(0, 2, 1))
    columns[0, :, 0], columns[1, :, 0] = start.x_m, start.y_m
    columns.setflags(write=False)
    return SimulatedDrives(np.round(start.time_s + GRID_S * np.arange(steps + 1, dtype=np.float64), 6), *columns)


def _speeds(
    speed_mps: Floats, acceleration_mps2: Floats, wished_mps: Floats, slow: NDArray[np.bool_]
) -> tuple[Floats, NDArray[np.bool_]]:
    """Fills speeds and accelerations (K + 1, N) from their first rows on, towards wished speeds (K, N).

    `slow` (K, N) is where so little is wished for that a slow ego stops.
    Returns, (K, N) each, the accelerations that the tracker asks for where it does not stop, and where it does.
    """
    asked, stopping = np.empty_like(wished_mps), np.zeros_like(slow)
    # an array where a number would do: numpy takes longer for a number than for fifteen of them
    gain, passed, most, step_s, still = (
        np.full(wished_mps.shape[1], value)
        for value in (TRACKING_GAIN_PER_S, _PASSED_ACCELERATION, MAX_ACCELERATION_MPS2, GRID_S, STOP_SPEED_MPS)
    )
    least, change = -most, np.empty_like(gain)
    may_stop: list[bool] = np.logical_or.reduce(slow, axis=1).tolist()
    v, ax = speed_mps[0], acceleration_mps2[0]
    for k, (wished, a, after, ax_after) in enumerate(
        zip(wished_mps, asked, speed_mps[1:], acceleration_mps2[1:], strict=True)
    ):
        np.subtract(wished, v, a)
        np.multiply(gain, a, a)
        used = a
        if may_stop[k]:
            stops = np.logical_and(slow[k], np.less_equal(v, still), stopping[k])
            used = np.where(stops, -STOP_GAIN_PER_S * (v - wished), a)
        np.subtract(used, ax, change)
        np.multiply(passed, change, change)
        np.add(ax, change, change)
        np.maximum(change, least, out=change)
        ax = np.minimum(change, most, out=ax_after)
        np.multiply(step_s, ax, change)
        v = np.add(v, change, after)
    return asked, stopping


def _steer(rows: Floats, plans: _References, asked_mps2: Floats, stopping: NDArray[np.bool_], shape: EgoShape) -> None:
    """Fills x, y, heading, tyre angle and its rate, rows (9, K + 1, N) that hold the speeds already."""
    steps, many = asked_mps2.shape
    wheelbase = shape.wheelbase_m
    v, a = rows[3, :-1], asked_mps2
    vv, va, aa = v * v, v * a, a * a
    # errors after the horizon without steering, and how they answer to a constant steering rate
    way, once, twice, once_i, twice_i = _PLAIN
    travelled = way[0] * v + way[1] * a
    drift = once[0] * vv + once[1] * va + once[2] * aa
    bend = plans.bend
    bent = bend[:, 2] * vv + bend[:, 3] * va + bend[:, 4] * aa
    turn, turn_more = bend[:, 0] * v, bend[:, 1] * a
    lateral_effect = (twice[0] * vv + twice[1] * va + twice[2] * aa) / wheelbase
    heading_effect = (once_i * v + twice_i * a) / wheelbase
    lateral_pull, heading_pull = LATERAL_WEIGHT * lateral_effect, HEADING_WEIGHT * heading_effect
    stiffness = lateral_pull * lateral_effect + heading_pull * heading_effect + TIRE_RATE_WEIGHT
    step_m = GRID_S * v
    after = rows[3, 1:]
    most = np.minimum(MAX_TIRE_ANGLE_RAD, np.arctan2(MAX_ACCELERATION_MPS2 * wheelbase, after * after))
    stops: list[bool] = np.logical_or.reduce(stopping, axis=1).tolist()

    base, passed, step_s, half, full = (
        np.full(many, value) for value in (wheelbase, _PASSED_STEERING, GRID_S, np.pi, 2.0 * np.pi)
    )
    add, subtract, multiply, divide, remainder = np.add, np.subtract, np.multiply, np.divide, np.remainder
    # x, y and heading together
    poses, off, moves = np.empty((steps + 1, 3, many)), np.empty((3, many)), np.empty((3, many))
    poses[0] = rows[:3, 0]
    off_xy, turned_by = off[:2], off[2]
    (cosine, sine, tangent), errors, shares = moves, np.empty((2, many)), np.empty((2, many))
    off_x, off_y = off_xy
    lateral, error = errors
    share, part = np.empty((2, many))
    pose, tyre = poses[0], rows[5, 0]
    turned = pose[2]
    by_step = zip(
        plans.pose, plans.across, travelled, np.stack((drift, travelled), axis=1), np.stack((bent, turn), axis=1),
        turn_more, np.stack((lateral_pull, heading_pull), axis=1), -stiffness, stops, stopping, step_m, most, -most,
        poses[1:], rows[5, 1:], rows[6, 1:], strict=False,
    )  # fmt: skip
    for (
        reference, across, way_m, answers, bends, turns_more, pulls, soft, any_stops, which_stop, moved_m, left_stop,
        right_stop, next_pose, next_tyre, rate,
    ) in by_step:  # fmt: skip
        # how far the ego is off, and what becomes of it within the horizon
        subtract(pose, reference, off)
        multiply(off_xy, across, off_xy)
        subtract(off_y, off_x, lateral)
        add(turned_by, half, error)
        remainder(error, full, error)
        subtract(error, half, error)
        multiply(way_m, error, part)
        add(lateral, part, lateral)
        divide(tyre, base, share)
        multiply(share, answers, shares)
        add(errors, shares, errors)
        subtract(errors, bends, errors)
        subtract(error, turns_more, error)
        add(error, half, error)
        remainder(error, full, error)
        subtract(error, half, error)
        multiply(pulls, errors, errors)
        add(lateral, error, part)
        divide(part, soft, rate)
        if any_stops:
            rate[which_stop] = 0.0
        multiply(passed, rate, rate)

        np.cos(turned, cosine)
        np.sin(turned, sine)
        np.tan(tyre, tangent)
        multiply(moved_m, moves, moves)
        divide(tangent, base, tangent)
        pose = add(pose, moves, next_pose)
        turned = pose[2]
        add(turned, half, turned)
        remainder(turned, full, turned)
        subtract(turned, half, turned)
        multiply(step_s, rate, part)
        add(tyre, part, part)
        np.maximum(part, right_stop, out=part)
        tyre = np.minimum(part, left_stop, out=next_tyre)
    rows[:3] = poses.transpose(1, 0, 2)


def _held(profile: Floats, at: NDArray[np.intp]) -> Floats:
    """Columns of (N, M) profiles at indices of any shape, the last one beyond the end."""
    return profile.take(np.minimum(at, profile.shape[1] - 1), axis=1)


def _curvatures(speed_mps: Floats, turn_rad: Floats) -> Floats:
    """Fitted curvatures (N, M) from speeds and heading changes (N, M): `lqr._curvatures` on arrays."""
    link = CURVATURE_RATE_PENALTY / GRID_S**2
    if not turn_rad.any():
        return np.zeros_like(turn_rad)
    travelled = np.ascontiguousarray((GRID_S * speed_mps).T)
    steps, many = travelled.shape
    # of each step, what it adds itself: to the square of the way, and to the way times the turn
    own = np.stack((travelled * travelled, travelled * turn_rad.T), axis=1)
    pivot, right = np.empty_like(travelled), np.empty_like(travelled)
    links, share, coming = np.full(many, link), np.empty(many), np.zeros((2, many))
    for i in range(steps - 1, 0, -1):
        summed = np.add(own[i], coming, coming)
        right[i] = summed[1]
        np.add(summed[0], links, pivot[i])
        np.divide(links, pivot[i], share)
        np.multiply(share, summed, coming)
    curvature = np.empty_like(travelled)
    curvature[0] = (own[0, 1] + coming[1]) / (own[0, 0] + coming[0] + INITIAL_CURVATURE_PENALTY)
    for before, after, pulled, divisor in zip(curvature, curvature[1:], right[1:], pivot[1:], strict=False):
        np.multiply(links, before, after)
        np.add(pulled, after, after)
        np.divide(after, divisor, after)
    return np.ascontiguousarray(curvature.T)


# The tracker's ten Euler steps cover T_j = g (v + j g a). Sums over them are polynomials in speed v and acceleration a:
# with n_j steps left after step j, whose indices add up to m_j, sum_{i > j} T_i = g (n_j v + g m_j a).
_J = np.arange(HORIZON_STEPS, dtype=np.float64)
_LEFT = HORIZON_STEPS - 1 - _J
_LEFT_SUM = _J.sum() - np.cumsum(_J)
_G = GRID_S
# (5, 10): per step, its weight in sum T_j (v, a) and in sum T_j sum_{i > j} T_i (v v, v a, a a)
_STEP_WEIGHTS = np.stack(
    (
        np.full(HORIZON_STEPS, _G),
        _G**2 * _J,
        _G**2 * _LEFT,
        _G**3 * (_LEFT_SUM + _J * _LEFT),
        _G**4 * _J * _LEFT_SUM,
    )
)
_SUMS = _STEP_WEIGHTS.sum(axis=1).tolist()
_RAMP_SUMS = (_G * _J * _STEP_WEIGHTS).sum(axis=1).tolist()
_PLAIN = (_SUMS[:2], _SUMS[2:], _RAMP_SUMS[2:], _RAMP_SUMS[0], _RAMP_SUMS[1])


def _bends(curvature_per_m: Floats, steps: int) -> Floats:
    """(steps, 5, N) the sums above, each step weighted with the plan's curvature there."""
    windows = _held(curvature_per_m, np.arange(steps)[:, None] + np.arange(HORIZON_STEPS))
    return np.einsum("nkj,wj->kwn", windows, _STEP_WEIGHTS)
