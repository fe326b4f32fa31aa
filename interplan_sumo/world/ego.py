"""The ego: its body and its state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from interplan_sumo.world.geometry import Floats, Pose, box_corners


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
        return Pose(self.x_m, self.y_m, self.heading_rad)

    def rear_axle(self, shape: EgoShape) -> Pose:
        """Pose of the rear axle."""
        d = shape.rear_axle_to_center_m
        return Pose(
            float(self.x_m - d * np.cos(self.heading_rad)),
            float(self.y_m - d * np.sin(self.heading_rad)),
            self.heading_rad,
        )

    def corners(self, shape: EgoShape) -> Floats:
        """(4, 2) box corners: front left, rear left, rear right, front right."""
        return box_corners(self.x_m, self.y_m, self.heading_rad, shape.length_m, shape.width_m)[0]

    def polygon(self, shape: EgoShape) -> shapely.Polygon:
        """The box as a shapely polygon."""
        return shapely.Polygon(self.corners(shape))
