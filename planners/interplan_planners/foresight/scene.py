"""One step as the planner sees it: the ego, the others with their forecast, and who of them stays where it is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import tan

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.paths import DrivingPath
from interplan_planners.foresight.prediction import PredictedTraffic
from interplan_sumo.planner import Observation
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, Pose


@dataclass(frozen=True, eq=False)
class PlanningScene:
    """What all parts of the planner need of one step."""

    seen: Observation
    shape: EgoShape
    traffic: PredictedTraffic
    stays: NDArray[np.bool_]
    """(A,) who is taken to stay where it is."""
    doubtful: NDArray[np.bool_]
    """(A,) of whom that cannot be told yet."""
    balks: NDArray[np.bool_]
    """(A,) who brakes or has just stopped, and nothing is seen that would make it."""

    @property
    def ego(self) -> EgoState:
        return self.seen.ego

    @property
    def speed_mps(self) -> float:
        """The ego's, never negative."""
        return max(self.seen.ego.speed_mps, 0.0)

    @cached_property
    def axle(self) -> Pose:
        """The ego's rear axle, the point that follows paths."""
        return self.seen.ego.rear_axle(self.shape)

    @property
    def curvature_per_m(self) -> float:
        """Of the rear axle's way, left positive."""
        return curvature_per_m(self.seen.ego, self.shape)


def corners_along(
    path: DrivingPath, corners: Floats, between_m: tuple[float, float] | None = None
) -> tuple[Floats, Floats]:
    """Arc lengths and offsets to the left (n, 4) of the corners of boxes (n, 4, 2); `between_m` narrows the search."""
    s, d = path.project(corners[..., 0].ravel(), corners[..., 1].ravel(), between_m)
    return s.reshape(-1, 4), d.reshape(-1, 4)


def curvature_per_m(ego: EgoState, shape: EgoShape) -> float:
    """Curvature of the rear axle's way, left positive."""
    return tan(ego.tire_angle_rad) / shape.wheelbase_m
