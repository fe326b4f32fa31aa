"""nuPlan's LQR tracker: which acceleration and steering rate make the ego follow a plan.

Two least-squares fits turn the plan into a speed profile and a curvature
profile; one-step and ten-step linear-quadratic problems turn their errors into
commands. Both fits are written in the fitted values themselves (speeds,
curvatures) instead of nuPlan's start value and increments: same minimum, but
the matrices become banded. Nothing here calls BLAS or LAPACK, whose results
differ between machines in the last bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import cos, pi, sin

import numpy as np

from interplan_sumo.dynamics import bicycle
from interplan_sumo.dynamics.rear_axle import rear_axle_of
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, wrap_angle
from interplan_sumo.world.trajectory import Trajectory

# nuPlan's tracker parameters.
GRID_S = 0.1
HORIZON_STEPS = 10
JERK_PENALTY = 1e-4
CURVATURE_RATE_PENALTY = 1e-2
INITIAL_CURVATURE_PENALTY = 1e-10
SPEED_WEIGHT, ACCELERATION_WEIGHT = 10.0, 1.0
LATERAL_WEIGHT, HEADING_WEIGHT, TIRE_RATE_WEIGHT = 1.0, 10.0, 1.0
TRACKING_GAIN_PER_S = SPEED_WEIGHT / (SPEED_WEIGHT + ACCELERATION_WEIGHT)
"""The optimum of one step of 1 s, the horizon."""
STOP_GAIN_PER_S = 0.5
STOP_SPEED_MPS = 0.2

LARGEST_INVERSE = 200
"""Plans up to this many grid steps are fitted with an inverse that is computed once per length."""
START_SLACK_S = 1e-3
"""A plan may start this late after now; its first pose is then taken for now."""


@dataclass(frozen=True, slots=True)
class Target:
    """What a plan asks of the ego now, at the rear axle."""

    speed_mps: float
    """Speed of the plan one second ahead."""
    curvature_per_m: tuple[float, ...]
    """Curvature of the plan now and 0.1 to 0.9 s ahead, left positive."""
    lateral_error_m: float
    """How far the ego is left of the plan."""
    heading_error_rad: float
    """How far the ego's heading is turned left of the plan's, in [-pi, pi)."""


@dataclass(frozen=True, slots=True)
class Command:
    """What the tracker asks of the car. Neither value is limited, as in nuPlan."""

    acceleration_mps2: float
    tire_rate_radps: float


def follow(state: EgoState, plan: Trajectory, dt_s: float, shape: EgoShape = PACIFICA) -> EgoState:
    """The ego `dt_s` later: tracker, then bicycle."""
    command = track(state, plan, shape)
    return bicycle.step(state, command.acceleration_mps2, command.tire_rate_radps, dt_s, shape)


def track(state: EgoState, plan: Trajectory, shape: EgoShape = PACIFICA) -> Command:
    """The command for now; ValueError if the plan does not cover now."""
    return command(state, target(state, plan, shape), shape)


def target(state: EgoState, plan: Trajectory, shape: EgoShape = PACIFICA) -> Target:
    """What the plan asks of the ego now; ValueError if the plan does not cover now.

    The fits run over the whole plan resampled every 0.1 s from its start, so
    poses far ahead have a small say in today's command (nuPlan issue 350).
    """
    start_s = float(plan.time_s[0])
    time_s = plan.time_s - start_s
    now_s, end_s = state.time_s - start_s, float(time_s[-1])
    if now_s < -START_SLACK_S or now_s > end_s + START_SLACK_S:
        raise ValueError(f"the plan covers {start_s:.3f} to {plan.time_s[-1]:.3f} s, not now ({state.time_s:.3f} s)")

    heading, turn_rad = _unwrapped(plan.heading_rad)
    cosine, sine = np.cos(heading), np.sin(heading)
    behind_m = shape.rear_axle_to_center_m
    x_m, y_m = plan.x_m - behind_m * cosine, plan.y_m - behind_m * sine
    # One point on the grid per full 0.1 s; half a microsecond forgives the rounding of times.
    count = max(1, int((end_s + 0.5e-6) / GRID_S))
    grid_s = _grid(count)
    if len(time_s) == count + 1 and not np.count_nonzero(np.abs(time_s - grid_s) >= 1e-9):
        grid_x, grid_y = x_m, y_m
    else:
        grid_heading, grid_x, grid_y = (np.interp(grid_s, time_s, v) for v in (heading, x_m, y_m))
        cosine, sine = np.cos(grid_heading), np.sin(grid_heading)
        _, turn_rad = _unwrapped(grid_heading)
    step_x_m, step_y_m = grid_x[1:] - grid_x[:-1], grid_y[1:] - grid_y[:-1]
    forward_m = step_x_m * cosine[:-1] + step_y_m * sine[:-1]
    at = now_s / GRID_S
    if np.count_nonzero(turn_rad):
        speed = _speeds(forward_m)
        last = min(count - 1, int(at) + HORIZON_STEPS)
        curvature = _curvatures(speed, turn_rad.tolist(), last)
        speed_mps = _held(speed, at + HORIZON_STEPS)
    else:  # a straight plan: the curvature fit has the solution 0, and one speed is all that is left to know
        curvature = [0.0]
        speed_mps = _speed_at(forward_m, at + HORIZON_STEPS)

    if now_s == 0.0:  # as most planners have it
        plan_x, plan_y, plan_heading = float(x_m[0]), float(y_m[0]), float(heading[0])
    else:
        plan_x, plan_y, plan_heading = (float(np.interp(now_s, time_s, v)) for v in (x_m, y_m, heading))
    ego_x, ego_y = rear_axle_of(state.x_m, state.y_m, state.heading_rad, shape)
    return Target(
        speed_mps=speed_mps,
        curvature_per_m=_next(curvature, at),
        lateral_error_m=-(ego_x - plan_x) * sin(plan_heading) + (ego_y - plan_y) * cos(plan_heading),
        heading_error_rad=wrap_angle(state.heading_rad - plan_heading),
    )


def command(state: EgoState, target: Target, shape: EgoShape = PACIFICA) -> Command:
    """The command that answers a target.

    Speed: proportional, to a stop where both speeds are small. Steering: the
    constant rate with the least weighted lateral and heading error after 1 s on
    the linearised bicycle.
    """
    speed = state.vx_mps
    if target.speed_mps <= STOP_SPEED_MPS and speed <= STOP_SPEED_MPS:
        return Command(-STOP_GAIN_PER_S * (speed - target.speed_mps), 0.0)

    acceleration = TRACKING_GAIN_PER_S * (target.speed_mps - speed)

    # Errors after i steps are affine in the rate: error + effect * rate.
    lateral, heading, tire = target.lateral_error_m, target.heading_error_rad, state.tire_angle_rad
    lateral_effect = heading_effect = tire_effect = 0.0
    wheelbase_m = shape.wheelbase_m
    for i, curvature in enumerate(target.curvature_per_m):
        travelled_m = GRID_S * (speed + i * GRID_S * acceleration)
        lateral += travelled_m * heading
        lateral_effect += travelled_m * heading_effect
        heading += travelled_m * (tire / wheelbase_m - curvature)
        heading_effect += travelled_m * tire_effect / wheelbase_m
        tire_effect += GRID_S
    heading = wrap_angle(heading)
    pull = LATERAL_WEIGHT * lateral_effect * lateral + HEADING_WEIGHT * heading_effect * heading
    stiffness = LATERAL_WEIGHT * lateral_effect**2 + HEADING_WEIGHT * heading_effect**2 + TIRE_RATE_WEIGHT
    return Command(acceleration, -pull / stiffness)


def _unwrapped(heading_rad: Floats) -> tuple[Floats, Floats]:
    """The same headings (N,) without jumps by full turns, and the turns (N - 1,) from each to the next."""
    turn_rad = heading_rad[1:] - heading_rad[:-1]
    if not np.count_nonzero(np.abs(turn_rad) >= pi):
        return heading_rad, turn_rad
    unwrapped = heading_rad.copy()
    unwrapped[1:] -= 2.0 * pi * np.cumsum(np.rint(turn_rad / (2.0 * pi)))
    return unwrapped, unwrapped[1:] - unwrapped[:-1]


def _next(profile: list[float], at: float) -> tuple[float, ...]:
    """`_held` at an index and at the ones that follow it, as far as the horizon."""
    if at > 0.0 and len(profile) > 1:
        return tuple([_held(profile, at + i) for i in range(HORIZON_STEPS)])
    found = profile[:HORIZON_STEPS]
    return (*found, *profile[-1:] * (HORIZON_STEPS - len(found)))


def _held(profile: list[float], at: float) -> float:
    """Linear interpolation at a fractional index, constant beyond both ends."""
    if at <= 0.0:
        return profile[0]
    below = int(at)
    if below >= len(profile) - 1:
        return profile[-1]
    share = at - below
    return profile[below] + share * (profile[below + 1] - profile[below])


@lru_cache(maxsize=64)
def _grid(count: int) -> Floats:
    """(M + 1,) grid times of M steps."""
    return GRID_S * np.arange(count + 1, dtype=np.float64)


@lru_cache(maxsize=64)
def _speed_factors(count: int) -> tuple[list[float], list[float], list[float]]:
    """The matrix of the speed fit over `count` grid steps as L D L': 1 / D, and both subdiagonals of L.

    Minimising |d - dt v|^2 + penalty |differences of successive accelerations|^2
    is (I + w S'S) v = d / dt with second differences S and w = penalty / dt^4:
    five diagonals that depend on `count` alone. No pivoting, the matrix is
    positive definite.
    """
    weight = JERK_PENALTY / GRID_S**4
    diagonal = [1.0] * count
    beside, beyond = [0.0] * (count + 2), [0.0] * (count + 2)  # entries (i, i - 1) and (i, i - 2)
    for i in range(2, count):
        for row, share in ((i - 2, 1.0), (i - 1, 4.0), (i, 1.0)):
            diagonal[row] += share * weight
        beside[i - 1] -= 2.0 * weight
        beside[i] -= 2.0 * weight
        beyond[i] += weight
    pivot, one, two = [1.0, 1.0], [0.0, 0.0], [0.0, 0.0]  # two rows of nothing above the first
    for i in range(count):
        two.append(beyond[i] / pivot[-2])
        one.append((beside[i] - two[-1] * one[-1] * pivot[-2]) / pivot[-1])
        pivot.append(diagonal[i] - one[-1] ** 2 * pivot[-1] - two[-1] ** 2 * pivot[-2])
    return [1.0 / p for p in pivot[2:]], one[2:], two[2:]


def _speeds(forward_m: Floats) -> list[float]:
    """Fitted speeds (M) from forward displacements (M) per grid step."""
    if len(forward_m) > LARGEST_INVERSE:
        return _solved_speeds(forward_m.tolist())
    # A sum over rows has a fixed order of additions; a matrix product of BLAS has not.
    return (speed_inverse(len(forward_m)) * forward_m).sum(axis=1).tolist()


def _speed_at(forward_m: Floats, at: float) -> float:
    """`_held` of the fitted speeds at one place, without the others."""
    count = len(forward_m)
    if count > LARGEST_INVERSE:
        return _held(_solved_speeds(forward_m.tolist()), at)
    first = min(int(at), count - 1)
    rows = speed_inverse(count)[first : first + 2]
    return _held((rows * forward_m).sum(axis=1).tolist(), at - first)


@lru_cache(maxsize=64)
def speed_inverse(count: int) -> Floats:
    """(M, M) what takes displacements to fitted speeds, for plans of usual length."""
    rows = [_solved_speeds([float(i == j) for i in range(count)]) for j in range(count)]
    return np.array(rows).T.copy()


def _solved_speeds(forward_m: list[float]) -> list[float]:
    inverse_pivot, one, two = _speed_factors(len(forward_m))
    scaled: list[float] = []
    last = before_last = 0.0
    for moved, l1, l2, d in zip(forward_m, one, two, inverse_pivot, strict=True):
        last, before_last = moved / GRID_S - l1 * last - l2 * before_last, last
        scaled.append(last * d)
    speeds: list[float] = []
    after = after_next = l1_after = l2_after = l2_next = 0.0
    for value, l1, l2 in zip(reversed(scaled), reversed(one), reversed(two), strict=True):
        after, after_next = value - l1_after * after - l2_next * after_next, after
        l1_after, l2_after, l2_next = l1, l2, l2_after
        speeds.append(after)
    speeds.reverse()
    return speeds


def _curvatures(speed_mps: list[float], turn_rad: list[float], last: int) -> list[float]:
    """Fitted curvatures 0 to `last` from speeds (M) and heading changes (M) per grid step.

    Minimises |turn - dt v k|^2 + penalty |curvature rates|^2 + tiny k_0^2: a
    tridiagonal system, eliminated from its end so that only the needed head
    has to be solved for.
    """
    link = CURVATURE_RATE_PENALTY / GRID_S**2
    # After elimination: pivot[i] k[i] - link k[i - 1] = right[i].
    pivot, right = [0.0] * len(speed_mps), [0.0] * len(speed_mps)
    coming, coming_right = 0.0, 0.0
    for i in range(len(speed_mps) - 1, -1, -1):
        travelled_m = GRID_S * speed_mps[i]
        own = travelled_m * travelled_m + coming
        own_right = travelled_m * turn_rad[i] + coming_right
        if i == 0:
            own += INITIAL_CURVATURE_PENALTY
            pivot[0], right[0] = own, own_right
            break
        p = pivot[i] = own + link
        right[i] = own_right
        # Schur complement of row i in row i - 1: link - link^2 / p, without cancellation.
        coming = link * own / p
        coming_right = link * own_right / p
    curvature = [right[0] / pivot[0]]
    for i in range(1, last + 1):
        curvature.append((right[i] + link * curvature[-1]) / pivot[i])
    return curvature
