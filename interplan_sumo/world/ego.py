"""The ego: its body and its state."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

import numpy as np
import shapely

from interplan_sumo.world.geometry import Floats, Pose


@dataclass(frozen=True, slots=True)
class EgoShape:
    """A vehicle body: a rectangle with a rear axle."""

    length_m: float
    width_m: float
    height_m: float
    wheelbase_m: float
    rear_axle_to_center_m: float
    """How far the box centre lies ahead of the rear axle."""

    @property
    def front_m(self) -> float:
        """Rear axle to front bumper."""
        return self.length_m / 2 + self.rear_axle_to_center_m


PACIFICA = EgoShape(length_m=5.176, width_m=2.297, height_m=1.777, wheelbase_m=3.089, rear_axle_to_center_m=1.461)
"""nuPlan's ego vehicle."""


@dataclass(frozen=True, slots=True)
class EgoState:
    """Pose of the box centre in the map frame; dynamics of the rear axle in the car frame (x forward, y left)."""

    time_s: float
    x_m: float
    y_m: float
    heading_rad: float
    vx_mps: float = 0.0
    vy_mps: float = 0.0
    ax_mps2: float = 0.0
    ay_mps2: float = 0.0
    tire_angle_rad: float = 0.0
    tire_rate_radps: float = 0.0
    yaw_rate_radps: float = 0.0
    yaw_acceleration_radps2: float = 0.0

    @property
    def speed_mps(self) -> float:
        """Signed speed along the heading, at the rear axle: negative when backing."""
        return self.vx_mps

    @property
    def pose(self) -> Pose:
        """Of the centre of its box, map frame."""
        return Pose(self.x_m, self.y_m, self.heading_rad)

    @property
    def velocity_mps(self) -> tuple[float, float]:
        """In the map frame."""
        c, s = cos(self.heading_rad), sin(self.heading_rad)
        return self.vx_mps * c - self.vy_mps * s, self.vx_mps * s + self.vy_mps * c

    def rear_axle(self, shape: EgoShape) -> Pose:
        """Pose of the rear axle."""
        d = shape.rear_axle_to_center_m
        return Pose(self.x_m - d * cos(self.heading_rad), self.y_m - d * sin(self.heading_rad), self.heading_rad)

    def corners(self, shape: EgoShape) -> Floats:
        """(4, 2) box corners: front left, rear left, rear right, front right."""
        c, s = cos(self.heading_rad), sin(self.heading_rad)
        ahead_x, ahead_y = c * shape.length_m / 2, s * shape.length_m / 2
        left_x, left_y = -s * shape.width_m / 2, c * shape.width_m / 2
        return np.array(
            (
                (self.x_m + ahead_x + left_x, self.y_m + ahead_y + left_y),
                (self.x_m - ahead_x + left_x, self.y_m - ahead_y + left_y),
                (self.x_m - ahead_x - left_x, self.y_m - ahead_y - left_y),
                (self.x_m + ahead_x - left_x, self.y_m + ahead_y - left_y),
            )
        )

    def polygon(self, shape: EgoShape) -> shapely.Polygon:
        """The box as a shapely polygon."""
        return shapely.Polygon(self.corners(shape))
