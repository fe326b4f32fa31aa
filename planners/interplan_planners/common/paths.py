"""Paths for the ego's box centre along lane centre lines, and plans on them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trajectory import Trajectory


def centerline(roads: Roads, lane_ids: Iterable[str]) -> Polyline:
    """The centre lines of a chain of lanes and connectors as one line; arc length 0 is where the first lane starts."""
    return Polyline(np.concatenate([roads[lane_id].centerline.points for lane_id in lane_ids]))


def plan_along(path: Polyline, time_s: ArrayLike, progress_m: ArrayLike, speed_mps: ArrayLike) -> Trajectory:
    """A plan whose poses lie on a path at arc lengths (N,), which are clamped to it."""
    x_m, y_m, heading_rad = path.poses_at(progress_m).T
    return Trajectory(np.asarray(time_s, float), x_m, y_m, heading_rad, np.asarray(speed_mps, float))


def braking_plan(ego: EgoState, deceleration_mps2: float, horizon_s: float, step_s: float) -> Trajectory:
    """A plan that brakes to a standstill straight ahead; for when there is no path to follow."""
    ahead_s: Floats = np.linspace(0.0, horizon_s, round(horizon_s / step_s) + 1)
    speed_mps = max(0.0, ego.speed_mps)
    until_stop_s = np.minimum(ahead_s, speed_mps / deceleration_mps2)
    travelled_m = speed_mps * until_stop_s - 0.5 * deceleration_mps2 * until_stop_s**2
    return Trajectory(
        ego.time_s + ahead_s,
        ego.x_m + travelled_m * np.cos(ego.heading_rad),
        ego.y_m + travelled_m * np.sin(ego.heading_rad),
        np.full_like(ahead_s, ego.heading_rad),
        speed_mps - deceleration_mps2 * until_stop_s,
    )
