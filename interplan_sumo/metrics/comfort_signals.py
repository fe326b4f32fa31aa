"""Motion: the six signals of comfort, filtered as nuPlan does."""

from __future__ import annotations

import numpy as np

from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.savitzky_golay import savitzky_golay
from interplan_sumo.world.trace import EgoTrack

FEWEST_FRAMES = 4
"""The third-order filter of the yaw acceleration needs as many."""
DECIMALS = 8
"""nuPlan rounds every signal to these."""

# Windows and orders of nuPlan's Savitzky-Golay filters. The yaw signals accept a window of 15 there but use 5.
ACCELERATION_WINDOW, ACCELERATION_ORDER = 8, 2
JERK_WINDOW, JERK_ORDER = 15, 2
YAW_WINDOW, YAW_RATE_ORDER, YAW_ACCELERATION_ORDER = 5, 2, 3


def comfort_signals(ego: EgoTrack, rear_axle_to_center_m: float, step_s: float) -> dict[str, Floats]:
    """The six signals (N,) that nuPlan judges, for `FEWEST_FRAMES` frames or more, `step_s` apart on average.

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
    return np.round(savitzky_golay(values, window, ACCELERATION_ORDER), DECIMALS)


def derivative(values: Floats, step_s: float, window: int, order: int, times: int = 1) -> Floats:
    """nuPlan's derivative of a signal with equal steps; windows longer than the signal shrink to it."""
    shrunk = min(window, len(values))
    return np.round(savitzky_golay(values, shrunk, order, times, step_s), DECIMALS)


def unwrapped(angle_rad: Floats) -> Floats:
    """Angles without jumps: each step is brought to the nearest of its equals modulo a turn."""
    turns = np.round(np.diff(angle_rad, prepend=angle_rad[:1]) / (2.0 * np.pi))
    return angle_rad - 2.0 * np.pi * np.cumsum(turns)
