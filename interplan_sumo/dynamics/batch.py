"""Many drives at once: tracker and bicycle for N plans of one ego, as planners need that score what they propose."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import pi

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
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
from interplan_sumo.world.geometry import Floats, wrap_angle


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

    turns = np.rint(np.diff(heading_rad, axis=1) / (2.0 * pi))
    heading = heading_rad.copy()
    heading[:, 1:] -= 2.0 * pi * np.cumsum(turns, axis=1)
    ref_x, ref_y = rear_axles_of(x_m, y_m, heading, shape)
    cosine, sine = np.cos(heading), np.sin(heading)
    forward_m = np.diff(ref_x, axis=1) * cosine[:, :-1] + np.diff(ref_y, axis=1) * sine[:, :-1]
    speed = np.einsum("nj,ij->ni", forward_m, speed_inverse(count))
    wished = _held(speed, HORIZON_STEPS + np.arange(driven))
    curvature = _curvatures(speed, np.diff(heading, axis=1))
    x, y, turned, c, s, v = (np.ascontiguousarray(each.T) for each in (ref_x, ref_y, heading, cosine, sine, wished))
    return _drive(start, _References(x, y, turned, c, s, v, _bends(curvature, driven)), driven, shape)


@dataclass(frozen=True, slots=True, eq=False)
class _References:
    """What N plans ask for at the rear axle, by step: every row is contiguous."""

    x_m: Floats  # (M + 1, N)
    y_m: Floats  # (M + 1, N)
    heading_rad: Floats  # (M + 1, N)
    cosine: Floats  # (M + 1, N) of the heading
    sine: Floats  # (M + 1, N)
    speed_mps: Floats  # (K, N) one second ahead
    bend: Floats  # (K, 5, N) as `_bends` has it


def _drive(start: EgoState, plans: _References, steps: int, shape: EgoShape) -> SimulatedDrives:
    """Tracker and bicycle, step after step: `lqr.command` and `bicycle.step` on arrays."""
    ref_x, ref_y, ref_heading, cos_ref, sin_ref = plans.x_m, plans.y_m, plans.heading_rad, plans.cosine, plans.sine
    wished_mps, bend = plans.speed_mps, plans.bend
    many = ref_x.shape[1]
    rows = np.empty((9, steps + 1, many))
    rear = start.rear_axle(shape)
    first = (
        rear.x_m, rear.y_m, start.heading_rad, start.vx_mps, start.ax_mps2, start.tire_angle_rad,
        start.tire_rate_radps, start.yaw_rate_radps, start.yaw_acceleration_radps2,
    )  # fmt: skip
    rows[:, 0] = np.array(first)[:, None]
    x, y, turned, v, ax, tire = (rows[i, 0].copy() for i in range(6))
    wheelbase = shape.wheelbase_m
    passed_a = GRID_S / (GRID_S + ACCELERATION_LAG_S)
    passed_tire = GRID_S / (GRID_S + STEERING_LAG_S)
    for k in range(steps):
        off_x, off_y = x - ref_x[k], y - ref_y[k]
        lateral = off_y * cos_ref[k] - off_x * sin_ref[k]
        error = wrap_angle(turned - ref_heading[k])

        a = TRACKING_GAIN_PER_S * (wished_mps[k] - v)
        vv, va, aa = v * v, v * a, a * a
        # errors after the horizon without steering, and how they answer to a constant steering rate
        way, once, twice, once_i, twice_i = _PLAIN
        travelled = way[0] * v + way[1] * a
        tire_share = tire / wheelbase
        ahead = bend[k]
        lateral += travelled * error
        lateral += tire_share * (once[0] * vv + once[1] * va + once[2] * aa)
        lateral -= ahead[2] * vv + ahead[3] * va + ahead[4] * aa
        error = wrap_angle(error + tire_share * travelled - ahead[0] * v - ahead[1] * a)
        lateral_effect = (twice[0] * vv + twice[1] * va + twice[2] * aa) / wheelbase
        heading_effect = (once_i * v + twice_i * a) / wheelbase
        pull = LATERAL_WEIGHT * lateral_effect * lateral + HEADING_WEIGHT * heading_effect * error
        stiffness = (
            LATERAL_WEIGHT * lateral_effect * lateral_effect
            + HEADING_WEIGHT * heading_effect * heading_effect
            + TIRE_RATE_WEIGHT
        )
        rate = -pull / stiffness
        stopping = (wished_mps[k] <= STOP_SPEED_MPS) & (v <= STOP_SPEED_MPS)
        if stopping.any():
            a = np.where(stopping, -STOP_GAIN_PER_S * (v - wished_mps[k]), a)
            rate = np.where(stopping, 0.0, rate)

        ax = np.minimum(np.maximum(ax + passed_a * (a - ax), -MAX_ACCELERATION_MPS2), MAX_ACCELERATION_MPS2)
        rate = passed_tire * rate
        step_m = GRID_S * v
        x = x + step_m * np.cos(turned)
        y = y + step_m * np.sin(turned)
        turned = wrap_angle(turned + step_m * np.tan(tire) / wheelbase)
        v = v + GRID_S * ax
        most = np.minimum(MAX_TIRE_ANGLE_RAD, np.arctan2(MAX_ACCELERATION_MPS2 * wheelbase, v * v))
        tire = np.minimum(np.maximum(tire + GRID_S * rate, -most), most)
        after = rows[:, k + 1]
        after[0], after[1], after[2], after[3], after[4], after[5], after[6] = x, y, turned, v, ax, tire, rate
    rows[7, 1:] = rows[3, 1:] * np.tan(rows[5, 1:]) / wheelbase
    rows[8, 1:] = (rows[7, 1:] - rows[7, :-1]) / GRID_S
    ahead_m = shape.rear_axle_to_center_m
    rows[0] += ahead_m * np.cos(rows[2])
    rows[1] += ahead_m * np.sin(rows[2])
    columns = np.ascontiguousarray(rows.transpose(0, 2, 1))
    columns[0, :, 0], columns[1, :, 0] = start.x_m, start.y_m
    columns.setflags(write=False)
    return SimulatedDrives(np.round(start.time_s + GRID_S * np.arange(steps + 1, dtype=np.float64), 6), *columns)


def _held(profile: Floats, at: NDArray[np.intp]) -> Floats:
    """Columns of (N, M) profiles at indices (K,), the last one beyond the end."""
    return profile[:, np.minimum(at, profile.shape[1] - 1)]


def _curvatures(speed_mps: Floats, turn_rad: Floats) -> Floats:
    """Fitted curvatures (N, M) from speeds and heading changes (N, M): `lqr._curvatures` on arrays."""
    link = CURVATURE_RATE_PENALTY / GRID_S**2
    if not turn_rad.any():
        return np.zeros_like(turn_rad)
    travelled = np.ascontiguousarray((GRID_S * speed_mps).T)
    own_square, own_pull = travelled * travelled, travelled * turn_rad.T
    pivot, right = np.empty_like(travelled), np.empty_like(travelled)
    coming = coming_right = np.zeros(len(speed_mps))
    for i in range(len(travelled) - 1, 0, -1):
        own = own_square[i] + coming
        pivot[i] = own + link
        right[i] = own_pull[i] + coming_right
        share = link / pivot[i]
        coming, coming_right = share * own, share * right[i]
    curvature = np.empty_like(travelled)
    curvature[0] = (own_pull[0] + coming_right) / (own_square[0] + coming + INITIAL_CURVATURE_PENALTY)
    for i in range(1, len(travelled)):
        curvature[i] = (right[i] + link * curvature[i - 1]) / pivot[i]
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
    padded = np.concatenate((curvature_per_m, np.repeat(curvature_per_m[:, -1:], HORIZON_STEPS, axis=1)), axis=1)
    windows = sliding_window_view(padded, HORIZON_STEPS, axis=1)[:, :steps]
    return np.einsum("nkj,wj->kwn", windows, _STEP_WEIGHTS)
