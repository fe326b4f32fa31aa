"""The nominal drive: along the route at the limit, through lights and whoever is there.

It stands in for the certificate of a scene that has none, as the drive that
progress is measured against. A driver in the scene's own traffic would not do:
one that is stuck makes every planner that is stuck beside it look good.
"""

from __future__ import annotations

import numpy as np

from interplan_sumo.scenario.route import goal_arc_m, route_centerline, route_lanes
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import EgoTrack

STEP_S = 0.1
GRID_M = 1.0
ACCELERATES_MPS2 = 1.5
BRAKES_MPS2 = 2.0
ACROSS_MPS2 = 2.5
"""Bends are taken with this acceleration to the side."""
USUAL_LIMIT_MPS = 13.9
"""Where a lane says none: 50 km/h."""
TO_ROUTE_M = 60.0
"""On this way the drive comes from the lane that it starts in to the line of the route."""


def nominal_drive(roads: Roads, scenario: Scenario) -> EgoTrack:
    """From the start to the first frame past the goal line, or one frame longer than the scenario lasts.

    ScenarioError if the goal cannot be reached along the route.
    """
    line, goal_m = route_centerline(roads, scenario), goal_arc_m(roads, scenario)
    start = scenario.start.pose(roads)
    first_m, left_m = line.project_point(start.x_m, start.y_m)
    arc_m, speed = _motion(_fastest_mps(roads, scenario, line), first_m, scenario)
    beyond = np.flatnonzero(arc_m > goal_m)
    frames = int(beyond[0]) + 1 if len(beyond) else len(arc_m)
    arc_m, speed = arc_m[:frames], speed[:frames]
    gone = np.clip((arc_m - first_m) / TO_ROUTE_M, 0.0, 1.0)
    aside_m = left_m * (1.0 - gone * gone * (3.0 - 2.0 * gone))
    poses = line.poses_at(np.minimum(arc_m, line.length_m))
    x_m = poses[:, 0] - aside_m * np.sin(poses[:, 2])
    y_m = poses[:, 1] + aside_m * np.cos(poses[:, 2])
    heading = np.unwrap(poses[:, 2])
    rate = np.gradient(heading, STEP_S) if frames > 1 else np.zeros(frames)
    along = np.gradient(speed, STEP_S) if frames > 1 else np.zeros(frames)
    none = np.zeros(frames)
    time_us = np.round(np.arange(frames) * STEP_S * 1e6).astype(np.int64)
    return EgoTrack(time_us, x_m, y_m, heading, speed, none, along, none, none, none, rate, none)


def reaches_goal(roads: Roads, scenario: Scenario, track: EgoTrack) -> bool:
    """Whether a drive ends past the goal line."""
    arc_m, _ = route_centerline(roads, scenario).project_point(float(track.x_m[-1]), float(track.y_m[-1]))
    return arc_m > goal_arc_m(roads, scenario)


def _fastest_mps(roads: Roads, scenario: Scenario, line: Polyline) -> Floats:
    """Every metre of the line the speed that limits, bends and braking for those ahead allow."""
    grid_m = np.arange(0.0, line.length_m + GRID_M, GRID_M)
    fastest = np.full(len(grid_m), np.inf)
    for lane_id in route_lanes(roads, scenario):
        piece = roads[lane_id].centerline.points
        begin_m, end_m = (line.project_point(*point)[0] for point in (piece[0].tolist(), piece[-1].tolist()))
        inside = (grid_m >= begin_m) & (grid_m <= end_m)
        fastest[inside] = np.minimum(fastest[inside], roads[lane_id].speed_limit_mps or USUAL_LIMIT_MPS)
    fastest[~np.isfinite(fastest)] = USUAL_LIMIT_MPS
    heading = np.unwrap(line.poses_at(np.minimum(grid_m, line.length_m))[:, 2])
    bend = np.abs(np.gradient(heading, GRID_M)) if len(heading) > 1 else np.zeros(len(heading))
    fastest = np.minimum(fastest, np.sqrt(ACROSS_MPS2 / np.maximum(bend, 1e-6)))
    for i in range(len(fastest) - 2, -1, -1):
        fastest[i] = min(fastest[i], np.sqrt(fastest[i + 1] ** 2 + 2.0 * BRAKES_MPS2 * GRID_M))
    return fastest


def _motion(fastest_mps: Floats, first_m: float, scenario: Scenario) -> tuple[Floats, Floats]:
    """Arc length and speed in every frame, one more than the scenario has."""
    arc_m, speed = first_m, scenario.start_speed_mps
    arcs, speeds = [arc_m], [speed]
    for _ in range(round(scenario.duration_s / STEP_S)):
        most = float(np.interp(arc_m, np.arange(len(fastest_mps)) * GRID_M, fastest_mps))
        speed = min(speed + ACCELERATES_MPS2 * STEP_S, max(most, speed - BRAKES_MPS2 * STEP_S))
        arc_m += speed * STEP_S
        arcs.append(arc_m)
        speeds.append(speed)
    return np.array(arcs), np.array(speeds)
