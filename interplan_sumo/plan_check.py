"""Whether a plan can be followed: asked of every plan before it reaches anything else."""

from __future__ import annotations

from math import ceil, hypot, isfinite

import numpy as np

from interplan_sumo.errors import PlannerError
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory

START_SLACK_S = 1e-3
"""A plan may begin this late after now."""
SHORTEST_REACH_S = 0.1
"""A plan must cover the next step."""
LONGEST_SPAN_S = 120.0
"""No plan needs more; the tracker resamples all of it."""
FARTHEST_START_M = 2.5
"""Largest distance of the plan's pose at now from the ego's centre: planners that plan from their own centre line
may be off by a lane's half, not by a car's length."""
FASTEST_MPS = 60.0
"""Largest speed that positions 0.1 s apart may imply."""
LARGEST_HEADING_RAD = 1000.0
"""Headings need not be wrapped; beyond this they are no angles."""
_SAMPLE_S = 0.1
_TIME_SLACK_S = 1e-6
_ROUNDING_M = 1e-6
"""Of coordinates of a million metres, interpolated: a plan of exactly the largest speed is no jump."""


def check_plan(plan: object, ego: EgoState, now_s: float) -> None:
    """PlannerError if the plan cannot be followed by an ego that is at `ego` at `now_s`.

    A plan must be a Trajectory of finite numbers with increasing times, begin
    at now (1 ms late at most) or earlier, reach 0.1 s beyond now, span 120 s at
    most, put the box centre within 2.5 m of where it is now, and imply at most
    60 m/s from any 0.1 s to the next. The message is a clause about "the plan"
    with the numbers and the way out.
    """
    plan = check_type(plan)
    with np.errstate(over="ignore", invalid="ignore"):  # absurd numbers are what this is about
        _check_numbers(plan)
        steps_s = plan.time_s[1:] - plan.time_s[:-1]
        is_even = not np.count_nonzero(np.abs(steps_s - _SAMPLE_S) > _TIME_SLACK_S)
        _check_times(plan, now_s, steps_s, is_even)
        _check_motion(plan, ego, now_s, is_even)


def check_type(plan: object) -> Trajectory:
    """The plan, which must be a Trajectory; PlannerError otherwise."""
    if isinstance(plan, Trajectory):
        return plan
    hint = " (did plan() forget to return it?)" if plan is None else ""
    raise PlannerError(
        f"the plan is of type {type(plan).__name__}{hint}; "
        "return a Trajectory(time_s, x_m, y_m, heading_rad) from interplan_sumo"
    )


def _check_numbers(plan: Trajectory) -> None:
    # Trajectory checks this when it is made; a plan from foreign code may have got round it.
    squared = (plan.time_s.dot(plan.time_s), plan.x_m.dot(plan.x_m), plan.y_m.dot(plan.y_m))
    heading = plan.heading_rad
    turned = heading.dot(heading)
    if isfinite(sum(squared)) and turned <= LARGEST_HEADING_RAD * LARGEST_HEADING_RAD:
        return  # the quick way: so it is only if every term is
    for name in ("time_s", "x_m", "y_m", "heading_rad"):
        values = getattr(plan, name)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise PlannerError(f"the plan holds a number that is not finite: {name}[{bad[0]}] = {values[bad[0]]}")
    i = int(np.argmax(np.abs(heading)))
    if abs(heading[i]) > LARGEST_HEADING_RAD:
        raise PlannerError(
            f"the plan's heading_rad[{i}] = {heading[i]:g} is no angle in radians (at most {LARGEST_HEADING_RAD:g})"
        )


def _check_times(plan: Trajectory, now_s: float, steps_s: Floats, is_even: bool) -> None:
    if not is_even and np.count_nonzero(steps_s > 0.0) < len(steps_s):
        i = int(np.argmax(steps_s <= 0.0))
        raise PlannerError(
            f"the plan's times do not increase: time_s[{i}] = {plan.time_s[i]:.6f}, "
            f"time_s[{i + 1}] = {plan.time_s[i + 1]:.6f}"
        )
    first_s, last_s = float(plan.time_s[0]), float(plan.time_s[-1])
    if first_s > now_s + START_SLACK_S:
        raise PlannerError(
            f"the plan begins {first_s - now_s:.3f} s after now (time_s[0] = {first_s:.3f}, now = {now_s:.3f}); "
            "begin it with the ego's pose at observation.time_s"
        )
    if last_s < now_s + SHORTEST_REACH_S - _TIME_SLACK_S:
        where = f"{now_s - last_s:.3f} s before now" if last_s < now_s else f"only {last_s - now_s:.3f} s after now"
        raise PlannerError(
            f"the plan ends {where} (time_s[-1] = {last_s:.3f}, now = {now_s:.3f}), it must reach "
            f"{SHORTEST_REACH_S:g} s beyond now; are its times absolute, as observation.time_s is?"
        )
    if last_s - first_s > LONGEST_SPAN_S:
        raise PlannerError(
            f"the plan spans {last_s - first_s:.1f} s (at most {LONGEST_SPAN_S:g}); are its times in seconds?"
        )


def _check_motion(plan: Trajectory, ego: EgoState, now_s: float, is_even: bool) -> None:
    if now_s == plan.time_s[0]:  # as most planners have it
        x_m, y_m = float(plan.x_m[0]), float(plan.y_m[0])
    else:
        x_m, y_m = float(np.interp(now_s, plan.time_s, plan.x_m)), float(np.interp(now_s, plan.time_s, plan.y_m))
    away_m = hypot(x_m - ego.x_m, y_m - ego.y_m)
    if away_m > FARTHEST_START_M:
        first_s, first_m = float(plan.time_s[0]), hypot(float(plan.x_m[0]) - ego.x_m, float(plan.y_m[0]) - ego.y_m)
        late = first_s < now_s - START_SLACK_S and first_m <= FARTHEST_START_M
        way_out = (
            f"its first pose is where the ego is, at time_s[0] = {first_s:.3f}, and now is {now_s:.3f}: are its times "
            "absolute, as observation.time_s is?"
            if late
            else "plan the box centre, in the map frame"
        )
        raise PlannerError(
            f"the plan is {away_m:.2f} m away from the ego at now, at ({x_m:.2f}, {y_m:.2f}) instead of "
            f"({ego.x_m:.2f}, {ego.y_m:.2f}), at most {FARTHEST_START_M:g} m; {way_out}"
        )
    at_s, x, y = plan.time_s, plan.x_m, plan.y_m
    if not is_even:
        first_s, last_s = float(at_s[0]), float(at_s[-1])
        count = max(1, ceil((last_s - first_s) / _SAMPLE_S - _TIME_SLACK_S))
        at_s = first_s + _SAMPLE_S * np.arange(count + 1, dtype=np.float64)
        x, y = np.interp(at_s, plan.time_s, plan.x_m), np.interp(at_s, plan.time_s, plan.y_m)
        _check_between(plan, at_s, x, y)
    step_x, step_y = x[1:] - x[:-1], y[1:] - y[:-1]
    squared = step_x * step_x + step_y * step_y
    i = int(squared.argmax())
    moved_m = hypot(step_x[i], step_y[i])
    if moved_m > FASTEST_MPS * _SAMPLE_S + _ROUNDING_M:
        raise PlannerError(
            f"the plan jumps {moved_m:.2f} m from {at_s[i]:.2f} to {at_s[i + 1]:.2f} s, "
            f"that is {moved_m / _SAMPLE_S:.4g} m/s (at most {FASTEST_MPS:g})"
        )


def _check_between(plan: Trajectory, at_s: Floats, x: Floats, y: Floats) -> None:
    """What lies between the samples is no farther from them than one can drive."""
    off_x, off_y = plan.x_m - np.interp(plan.time_s, at_s, x), plan.y_m - np.interp(plan.time_s, at_s, y)
    off_m = np.maximum(np.abs(off_x), np.abs(off_y))
    i = int(off_m.argmax())
    if off_m[i] > FASTEST_MPS * _SAMPLE_S + _ROUNDING_M:
        raise PlannerError(f"the plan jumps {off_m[i]:.4g} m at {plan.time_s[i]:.3f} s, off the poses around it")
