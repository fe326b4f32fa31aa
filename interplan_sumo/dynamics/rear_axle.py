"""From the centre of the ego's box to its rear axle and back."""

from __future__ import annotations

from math import cos, sin

import numpy as np

from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import Floats


def rear_axle_of(x_m: float, y_m: float, heading_rad: float, shape: EgoShape) -> tuple[float, float]:
    """Position of the rear axle of a box with this centre."""
    behind_m = shape.rear_axle_to_center_m
    return x_m - behind_m * cos(heading_rad), y_m - behind_m * sin(heading_rad)


def center_of(rear_x_m: float, rear_y_m: float, heading_rad: float, shape: EgoShape) -> tuple[float, float]:
    """Position of the box centre of a car with this rear axle."""
    ahead_m = shape.rear_axle_to_center_m
    return rear_x_m + ahead_m * cos(heading_rad), rear_y_m + ahead_m * sin(heading_rad)


def rear_axles_of(x_m: Floats, y_m: Floats, heading_rad: Floats, shape: EgoShape) -> tuple[Floats, Floats]:
    """`rear_axle_of` for arrays (N,)."""
    behind_m = shape.rear_axle_to_center_m
    return x_m - behind_m * np.cos(heading_rad), y_m - behind_m * np.sin(heading_rad)
