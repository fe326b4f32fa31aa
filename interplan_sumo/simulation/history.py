"""The two seconds before an episode begins: recorded for the ego, or extrapolated backwards along the lanes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from interplan_sumo.scenario.recorded_parts import PAST_STEPS, EgoPast
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Polyline, wrap_angle
from interplan_sumo.world.roads import Roads


def backcast(roads: Roads, x_m: float, y_m: float, heading_rad: float, distances_m: np.ndarray) -> np.ndarray:
    """(K, 3) x, y, heading of something that has come along its lane, `distances_m` (K,) ago.

    It keeps its lateral offset and its angle to the lane; before the first
    lane of the map, and off all lanes, it has come straight.
    """
    poses = np.empty((len(distances_m), 3))
    found = [(*_along(roads[lane].centerline, x_m, y_m, heading_rad), lane) for lane in roads.at(x_m, y_m)]
    angle, arc_m, left_m, lane = min(found, key=lambda each: abs(each[0]), default=(np.pi, 0.0, 0.0, ""))
    if abs(angle) > np.pi / 2:
        poses[:, 0] = x_m - distances_m * np.cos(heading_rad)
        poses[:, 1] = y_m - distances_m * np.sin(heading_rad)
        poses[:, 2] = heading_rad
        return poses
    poses[:] = line_poses(roads[lane].centerline, arc_m - distances_m, left_m, angle)
    for row in np.flatnonzero(distances_m > arc_m):
        back_m, here = arc_m - distances_m[row], lane
        while back_m < 0.0 and roads.incoming(here):
            here = roads.incoming(here)[0]
            back_m += roads[here].centerline.length_m
        poses[row] = line_poses(roads[here].centerline, np.array([back_m]), left_m, angle)[0]
    return poses


def line_poses(line: Polyline, arc_m: np.ndarray, left_m: float, angle_rad: float) -> np.ndarray:
    """(K, 3) poses beside a line; before its start, straight on backwards."""
    poses = line.poses_at(arc_m)
    heading = poses[:, 2]
    missing_m = np.maximum(0.0, -arc_m)
    poses[:, 0] -= left_m * np.sin(heading) + missing_m * np.cos(heading)
    poses[:, 1] += left_m * np.cos(heading) - missing_m * np.sin(heading)
    poses[:, 2] = wrap_angle(heading + angle_rad)
    return poses


def _along(line: Polyline, x_m: float, y_m: float, heading_rad: float) -> tuple[float, float, float]:
    """Angle to a line, arc length on it and offset to its left."""
    arc_m, left_m = line.project_point(x_m, y_m)
    return float(wrap_angle(heading_rad - line.pose_at(arc_m).heading_rad)), arc_m, left_m


def extrapolated_egos(roads: Roads, ego: EgoState, dt_s: float, driven: EgoPast | None = None) -> tuple[EgoState, ...]:
    """The 2 s before an episode: the ego has come at its present speed, unless its past is known."""
    ago_s = dt_s * np.arange(PAST_STEPS, 0, -1)
    if driven is None:
        ego_poses = backcast(roads, ego.x_m, ego.y_m, ego.heading_rad, ego.speed_mps * ago_s)
        speeds_mps = np.full(PAST_STEPS, ego.vx_mps)
    else:
        ego_poses = np.stack((driven.x_m, driven.y_m, driven.heading_rad), axis=1)
        speeds_mps = np.array(driven.speed_mps)
    return tuple(
        replace(
            ego, time_s=ego.time_s - float(s), x_m=float(x), y_m=float(y), heading_rad=float(heading), vx_mps=float(v)
        )
        for s, (x, y, heading), v in zip(ago_s, ego_poses, speeds_mps, strict=True)
    )


def extrapolated_actors(roads: Roads, actors: Actors, dt_s: float, steps: int = PAST_STEPS) -> tuple[Actors, ...]:
    """So many steps before an episode: everyone has come at their present speed."""
    ago_s = dt_s * np.arange(steps, 0, -1)
    poses = np.empty((steps, 3, len(actors)))
    for row in range(len(actors)):
        gone_m = actors.speed_mps[row] * ago_s
        poses[:, :, row] = backcast(roads, actors.x_m[row], actors.y_m[row], actors.heading_rad[row], gone_m)
    vx, vy = actors.speed_mps * np.cos(poses[:, 2]), actors.speed_mps * np.sin(poses[:, 2])
    same = (actors.length_m, actors.width_m)
    return tuple(Actors.trusted(actors.ids, actors.kind, *poses[k], *same, vx[k], vy[k]) for k in range(steps))
