"""Reachability: whether the ego's tracker and bicycle can bring about a drive, state by state."""

from __future__ import annotations

from dataclasses import fields, replace
from math import hypot, isfinite

from interplan_sumo.dynamics import bicycle
from interplan_sumo.dynamics.bicycle import ACCELERATION_LAG_S, STEERING_LAG_S
from interplan_sumo.simulation.episode import DT_S
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.trace import EgoTrack

PUSH_MPS2 = (-9.0, 5.0)
STEERING_RADPS = 1.5
"""Commands beyond these no car can follow. nuPlan's tracker itself has no bounds."""
PLACE_M, REST = 1e-5, 1e-4
"""States are stored in millionths; derivatives of them are less certain."""


def unreachable(start: EgoState, track: EgoTrack, duration_s: float) -> list[str]:
    """Where a drive from `start` is not what the bicycle model does under commands a car can follow; [] if nowhere.

    It takes `duration_s` at most. The commands of each step are recovered from its two states; the step is
    done again with them and must give the second state.
    """
    most = round(duration_s / DT_S) + 1
    if not 1 <= len(track) <= most:
        return [f"it has {len(track)} states, expected 1 to {most}"]
    before = track.state(0)
    if _apart(start, before):
        return [f"it does not begin as the scenario does: {_apart(start, before)}"]
    for k in range(1, len(track)):
        after = track.state(k)
        if not all(isfinite(getattr(after, f.name)) for f in fields(after)):
            return [f"the state at {k * DT_S:.1f} s holds a number that is not finite"]
        push = before.ax_mps2 + (after.ax_mps2 - before.ax_mps2) * (DT_S + ACCELERATION_LAG_S) / DT_S
        steering = after.tire_rate_radps * (DT_S + STEERING_LAG_S) / DT_S
        if not PUSH_MPS2[0] <= push <= PUSH_MPS2[1] or abs(steering) > STEERING_RADPS:
            return [f"the step to {k * DT_S:.1f} s asks for {push:.1f} m/s2 and {steering:.2f} rad/s of steering"]
        reached = bicycle.step(replace(before, time_s=round((k - 1) * DT_S, 6)), push, steering, DT_S)
        apart = _apart(reached, after)
        if apart:
            return [f"the state at {k * DT_S:.1f} s does not follow from the one before: {apart}"]
        before = after
    return []


def _apart(one: EgoState, other: EgoState) -> str:
    """How two states differ by more than rounding; '' if they do not."""
    if hypot(one.x_m - other.x_m, one.y_m - other.y_m) > PLACE_M:
        return f"places are {hypot(one.x_m - other.x_m, one.y_m - other.y_m):.3f} m apart"
    for field in fields(one):
        if field.name in ("x_m", "y_m"):
            continue
        here, there = getattr(one, field.name), getattr(other, field.name)
        difference = wrap_angle(here - there) if field.name == "heading_rad" else here - there
        if not abs(difference) <= REST:
            return f"{field.name} is {there:.4f} instead of {here:.4f}"
    return ""
