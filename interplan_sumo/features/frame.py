"""The ego's frame: from the map into it and back."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

import numpy as np

from interplan_sumo.features.schema import YAW_SLACK_RAD
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, wrap_angle
from interplan_sumo.world.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class EgoFrame:
    """Origin on the rear axle, x forward along the heading, y to the left."""

    x_m: float
    y_m: float
    heading_rad: float

    @classmethod
    def of(cls, ego: EgoState, shape: EgoShape = PACIFICA) -> EgoFrame:
        """The frame of an ego at one instant."""
        pose = ego.rear_axle(shape)
        return cls(pose.x_m, pose.y_m, pose.heading_rad)

    @property
    def origin(self) -> Floats:
        """(3,) x, y, heading in the map frame."""
        return np.array((self.x_m, self.y_m, self.heading_rad))

    def points(self, xy: Floats) -> Floats:
        """Points (..., 2) of the map frame in this one."""
        return self.vectors(xy - (self.x_m, self.y_m))

    def vectors(self, xy: Floats) -> Floats:
        """Velocities and the like (..., 2) of the map frame in this one."""
        c, s = cos(self.heading_rad), sin(self.heading_rad)
        x, y = xy[..., 0], xy[..., 1]
        return np.stack((c * x + s * y, c * y - s * x), axis=-1)

    def yaws(self, heading_rad: Floats) -> Floats:
        """Headings of the map frame in this one."""
        return wrap_angle(heading_rad - self.heading_rad - YAW_SLACK_RAD) + YAW_SLACK_RAD

    def poses(self, poses: Floats) -> Floats:
        """Poses (..., 3) of the map frame in this one."""
        return np.concatenate((self.points(poses[..., :2]), self.yaws(poses[..., 2:])), axis=-1)

    def to_map(self, poses: Floats) -> Floats:
        """Poses (..., 3) of this frame in the map frame, headings in [-pi, pi)."""
        c, s = cos(self.heading_rad), sin(self.heading_rad)
        x, y = poses[..., 0], poses[..., 1]
        heading = wrap_angle(poses[..., 2] + self.heading_rad)
        return np.stack((self.x_m + c * x - s * y, self.y_m + s * x + c * y, heading), axis=-1)

    def plan(self, rear_axle: Floats, time_s: Floats, shape: EgoShape = PACIFICA) -> Trajectory:
        """What a planner returns, from poses (N, 3) of the rear axle in this frame at times (N,)."""
        x_m, y_m, heading_rad = np.moveaxis(self.to_map(np.asarray(rear_axle, dtype=np.float64)), -1, 0)
        ahead_m = shape.rear_axle_to_center_m
        return Trajectory(time_s, x_m + ahead_m * np.cos(heading_rad), y_m + ahead_m * np.sin(heading_rad), heading_rad)


def nearest(distance_m: Floats, ids: np.ndarray, count: int) -> np.ndarray:
    """Rows of the `count` nearest, the nearest first; ties, to the millimetre, go by id."""
    return np.lexsort((ids, np.rint(distance_m * 1e3)))[:count]
