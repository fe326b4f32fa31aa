"""How a recorded road user moved: positions smoothed in one way for all sources, and differentiated."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from interplan_sumo.realism.tracks import Track
from interplan_sumo.world.geometry import Floats, frozen, wrap_angle
from interplan_sumo.world.savitzky_golay import weights

WINDOW_S: Final = 1.5
"""Of the Savitzky-Golay filter, order 2. Half of it is dropped at both ends, where it has but one side."""
STANDING_MPS: Final = 0.3
"""What is slower stands: boxes of standing vehicles creep with up to 0.4 m/s (p95) in the recordings we have seen."""
STANDING_M: Final = 0.5
"""... and what leaves its place by more than this in a window does not."""
MOVING_MPS: Final = 1.0
"""The course of what moves faster tells where it heads."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """One road user on a time grid of its own, evenly spaced. Arrays (N,) are made read-only.

    Standing means speed, acceleration, jerk and yaw rate of exactly 0.
    """

    track: Track
    step_s: float
    time_s: Floats
    x_m: Floats
    y_m: Floats
    heading_rad: Floats
    """Of the box; turned round for a box that was recorded back to front."""
    speed_mps: Floats
    acceleration_mps2: Floats
    """Of the speed, smoothed once more: the second derivative of positions is mostly noise."""
    jerk_mps3: Floats
    yaw_rate_radps: Floats
    """Of the course, counter-clockwise; 0 below `MOVING_MPS`."""

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            object.__setattr__(self, name, frozen(getattr(self, name)))


_ARRAYS: Final = (
    "time_s", "x_m", "y_m", "heading_rad", "speed_mps", "acceleration_mps2", "jerk_mps3", "yaw_rate_radps"
)  # fmt: skip


def motions(tracks: Iterable[Track]) -> list[Motion]:
    """The motions of all tracks that are long enough to have one."""
    return [found for track in tracks if (found := motion_of(track)) is not None]


def motion_of(track: Track) -> Motion | None:
    """The smoothed motion of a track; None where it is shorter than the filter's window.

    Positions are put on the track's usual step first, along straight lines.
    """
    if len(track.time_s) < 3:
        return None
    step_s = float(np.median(np.diff(track.time_s)))
    half = max(1, int(WINDOW_S / 2.0 / step_s + 1e-6))
    rows = round((track.time_s[-1] - track.time_s[0]) / step_s) + 1
    if rows < 2 * half + 1:
        return None
    time_s = track.time_s[0] + step_s * np.arange(rows)
    position_m = np.stack([np.interp(time_s, track.time_s, each) for each in (track.x_m, track.y_m)])
    heading_rad = np.interp(time_s, track.time_s, np.unwrap(track.heading_rad))

    def smooth(values: Floats, derivative: int = 0) -> Floats:
        return _inside(values, half, step_s, derivative)

    (x_m, y_m), (vx, vy), (ax, ay) = (smooth(position_m, derivative) for derivative in (0, 1, 2))
    speed_mps = np.hypot(vx, vy)
    standing = _standing(speed_mps, x_m, y_m, half)
    speed_mps = np.where(standing, 0.0, speed_mps)
    acceleration_mps2, jerk_mps3 = (_derivative(speed_mps, half, step_s, order) for order in (1, 2))
    heading_rad = smooth(heading_rad)
    fast = speed_mps > MOVING_MPS
    if fast.any() and np.median(np.cos(np.arctan2(vy, vx) - heading_rad)[fast]) < 0.0:
        heading_rad = heading_rad + np.pi
    return Motion(
        track,
        step_s,
        time_s[half : rows - half],
        x_m,
        y_m,
        wrap_angle(heading_rad),
        speed_mps,
        np.where(standing, 0.0, acceleration_mps2),
        np.where(standing, 0.0, jerk_mps3),
        np.where(fast, (vx * ay - vy * ax) / np.where(fast, speed_mps, 1.0) ** 2, 0.0),
    )


def _derivative(speed_mps: Floats, half: int, step_s: float, order: int) -> Floats:
    """Of a speed, by the same filter again, which stays whole at the ends; 0 where there is too little of it."""
    half = min(half, (len(speed_mps) - 1) // 2)
    if half < 2:
        return np.zeros(len(speed_mps))
    at_place, window = _weights(half, order, step_s), 2 * half + 1
    return np.concatenate([
        at_place[:half] @ speed_mps[:window],
        _inside(speed_mps, half, step_s, order),
        at_place[half + 1 :] @ speed_mps[-window:],
    ])  # fmt: skip


def _inside(values: Floats, half: int, step_s: float, derivative: int) -> Floats:
    """Filtered along the last axis where the window has both its sides."""
    return sliding_window_view(values, 2 * half + 1, axis=-1) @ _weights(half, derivative, step_s)[half]


@lru_cache(maxsize=256)
def _weights(half: int, derivative: int, step_s: float) -> Floats:
    """(2 half + 1, 2 half + 1) row k: what the values of a window weigh in the parabola through them at its place k."""
    window = 2 * half + 1
    rows = [weights(window, 2, derivative, place, step_s) for place in range(window)]
    return frozen(rows)


def _standing(speed_mps: Floats, x_m: Floats, y_m: Floats, half: int) -> NDArray[np.bool_]:
    """Where a box stands: it is slow, and stays in its place from half a window before to half a window after."""
    last = len(x_m) - 1
    before, after = np.maximum(np.arange(last + 1) - half, 0), np.minimum(np.arange(last + 1) + half, last)
    left_m = np.hypot(x_m[after] - x_m[before], y_m[after] - y_m[before])
    return (speed_mps < STANDING_MPS) & (left_m < STANDING_M)
