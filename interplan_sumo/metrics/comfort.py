"""Comfort: did accelerations, jerks and turning stay inside what passengers accept?"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import savgol_filter

from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.result import MetricResult, extremes
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trace import EgoTrack

BOUNDS: dict[str, tuple[float, float]] = {
    "longitudinal_acceleration_mps2": (-4.05, 2.40),
    "lateral_acceleration_mps2": (-4.89, 4.89),
    "jerk_mps3": (-8.37, 8.37),
    "longitudinal_jerk_mps3": (-4.13, 4.13),
    "yaw_rate_radps": (-0.95, 0.95),
    "yaw_acceleration_radps2": (-1.93, 1.93),
}
"""nuPlan's limits; every frame of every signal must lie strictly inside."""
FEWEST_FRAMES = 4
"""The third-order filter of the yaw acceleration needs as many."""
DECIMALS = 8
"""nuPlan rounds every signal to these."""

# Windows and orders of nuPlan's Savitzky-Golay filters. The yaw signals accept a window of 15 there but use 5.
ACCELERATION_WINDOW, ACCELERATION_ORDER = 8, 2
JERK_WINDOW, JERK_ORDER = 15, 2
YAW_WINDOW, YAW_RATE_ORDER, YAW_ACCELERATION_ORDER = 5, 2, 3


def comfort(facts: Facts) -> MetricResult:
    """1 if all six signals stay inside their bounds on every frame, else 0.

    Fewer than `FEWEST_FRAMES` frames have no such signals and score 1.
    """
    if facts.frames < FEWEST_FRAMES:
        return MetricResult(1.0)
    # differences of seconds, as in nuPlan: large time stamps lose digits here that show in second derivatives
    step_s = float(np.mean(np.diff(facts.trace.ego.time_us / 1e6)))
    signals = comfort_signals(facts.trace.ego, facts.trace.shape.rear_axle_to_center_m, step_s)
    inside = {name: bool(((values > low) & (values < high)).all()) for name, values, low, high in _bounded(signals)}
    detail = {name: {**extremes(values), "within": inside[name]} for name, values in signals.items()}
    score = 1.0 if all(inside.values()) else 0.0
    return MetricResult(score, detail, signals, None if score else _reason(facts, signals))


def _bounded(signals: dict[str, Floats]) -> list[tuple[str, Floats, float, float]]:
    return [(name, values, *BOUNDS[name]) for name, values in signals.items()]


def _reason(facts: Facts, signals: dict[str, Floats]) -> str:
    excess = {n: np.maximum(low - v, v - high) / (high - low) for n, v, low, high in _bounded(signals)}
    worst = max(excess, key=lambda name: float(excess[name].max()))
    frame = int(np.argmax(excess[worst]))
    name, _, unit = worst.rpartition("_")
    units = {"mps2": "m/s2", "mps3": "m/s3", "radps": "rad/s", "radps2": "rad/s2"}
    low, high = BOUNDS[worst]
    return (
        f"{name.replace('_', ' ')} of {signals[worst][frame]:.2f} {units[unit]} at {facts.time_s[frame]:.1f} s, "
        f"allowed {low:g} to {high:g}"
    )


def comfort_signals(ego: EgoTrack, rear_axle_to_center_m: float, step_s: float) -> dict[str, Floats]:
    """The six signals (N,) that nuPlan judges, by the names of `BOUNDS`.

    Accelerations are those of the box centre in the car frame. nuPlan moves
    them there by adding d * (yaw rate squared + yaw acceleration) along the car,
    which is not what a rigid body does, and leaves the lateral part as it is.
    """
    leak = rear_axle_to_center_m * (ego.yaw_rate_radps**2 + ego.yaw_acceleration_radps2)
    longitudinal = smoothed(ego.ax_mps2 + leak)
    lateral = smoothed(ego.ay_mps2)
    magnitude = smoothed(np.hypot(ego.ax_mps2, ego.ay_mps2))
    heading = unwrapped(ego.heading_rad)
    return {
        "longitudinal_acceleration_mps2": longitudinal,
        "lateral_acceleration_mps2": lateral,
        "jerk_mps3": derivative(magnitude, step_s, JERK_WINDOW, JERK_ORDER),
        "longitudinal_jerk_mps3": derivative(longitudinal, step_s, JERK_WINDOW, JERK_ORDER),
        "yaw_rate_radps": derivative(heading, step_s, YAW_WINDOW, YAW_RATE_ORDER),
        "yaw_acceleration_radps2": derivative(heading, step_s, YAW_WINDOW, YAW_ACCELERATION_ORDER, times=2),
    }


def smoothed(values: Floats) -> Floats:
    """nuPlan's smoothing of an acceleration; its even window shifts the signal by half a sample."""
    window = min(ACCELERATION_WINDOW, len(values))
    return np.round(_filter(values, window, ACCELERATION_ORDER), DECIMALS)


def derivative(values: Floats, step_s: float, window: int, order: int, times: int = 1) -> Floats:
    """nuPlan's derivative of a signal with equal steps; windows longer than the signal shrink to it."""
    shrunk = min(window, len(values))
    return np.round(_filter(values, shrunk, order, deriv=times, delta=step_s), DECIMALS)


_filter: Callable[..., Floats] = savgol_filter


def unwrapped(angle_rad: Floats) -> Floats:
    """Angles without jumps: each step is brought to the nearest of its equals modulo a turn."""
    turns = np.round(np.diff(angle_rad, prepend=angle_rad[:1]) / (2.0 * np.pi))
    return angle_rad - 2.0 * np.pi * np.cumsum(turns)
