"""Trajectory: what a planner returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from interplan_sumo.world.geometry import Floats, Pose, wrap_angle

_COLUMNS = ("time_s", "x_m", "y_m", "heading_rad", "speed_mps")


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses of the ego's box centre over time, at least two, times strictly increasing.

    Between samples positions are interpolated linearly and headings the short
    way round. Speeds are informative: the controller follows the poses.
    """

    time_s: Floats  # (N,)
    x_m: Floats  # (N,)
    y_m: Floats  # (N,)
    heading_rad: Floats  # (N,)
    speed_mps: Floats | None = None  # (N,)

    def __post_init__(self) -> None:
        count = np.size(self.time_s)
        given = {name: value for name in _COLUMNS if (value := getattr(self, name)) is not None}
        for name, value in given.items():
            if np.shape(value) != (count,):
                raise ValueError(f"Trajectory.{name} has shape {np.shape(value)}, expected ({count},)")
            if np.iscomplexobj(value) or isinstance(value, np.ma.MaskedArray):
                raise ValueError(f"Trajectory.{name} holds complex or masked numbers, expected plain ones")
        columns = np.array([*given.values()], dtype=np.float64)
        columns.setflags(write=False)
        self.__dict__.update(zip(given, columns, strict=True))  # the rows; planners make a plan in every step
        if np.count_nonzero(np.isfinite(columns)) < columns.size:
            bad = next(name for name, column in zip(given, columns, strict=True) if not np.isfinite(column).all())
            raise ValueError(f"Trajectory.{bad} holds a number that is not finite")
        if count < 2:
            raise ValueError(f"a Trajectory needs at least two poses, got {count}")
        if np.count_nonzero(self.time_s[1:] > self.time_s[:-1]) < count - 1:
            raise ValueError("Trajectory.time_s must increase from sample to sample")

    def __len__(self) -> int:
        return len(self.time_s)

    def at(self, time_s: float) -> Pose:
        """The pose at one time; ValueError outside the trajectory."""
        x, y, heading = self.poses_at(np.asarray([time_s]))[0]
        return Pose(float(x), float(y), float(heading))

    def poses_at(self, time_s: Floats) -> Floats:
        """(K, 3) x, y, heading at times (K,); ValueError outside the trajectory."""
        slack_s = 1e-6
        if np.min(time_s) < self.time_s[0] - slack_s or np.max(time_s) > self.time_s[-1] + slack_s:
            raise ValueError(
                f"time {np.min(time_s):.3f} to {np.max(time_s):.3f} s lies outside the trajectory "
                f"({self.time_s[0]:.3f} to {self.time_s[-1]:.3f} s)"
            )
        return np.stack(
            (
                np.interp(time_s, self.time_s, self.x_m),
                np.interp(time_s, self.time_s, self.y_m),
                wrap_angle(np.interp(time_s, self.time_s, np.unwrap(self.heading_rad))),
            ),
            axis=1,
        )
