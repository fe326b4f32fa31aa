"""nuPlan's IDM along one path: all others stand still while a plan is rolled out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin

import numpy as np
import shapely

from interplan_planners.common.corridor import Corridor
from interplan_planners.common.idm_policy import IdmDriver, idm_step
from interplan_planners.common.paths import plan_along
from interplan_sumo.planner import Observation
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Polyline, Pose
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import SignalStatus
from interplan_sumo.world.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class IdmDecision:
    """Why the last plan is as it is."""

    progress_m: float
    """Of the ego's centre along the path."""
    lead_id: str | None
    """An actor, a red connector, or None: nothing but the end of the path."""
    gap_m: float
    """From the ego's box to the lead's, or from its front bumper to the end of the path."""
    lead_speed_mps: float
    """Along the ego's heading."""


@dataclass(frozen=True, slots=True)
class FrozenObstacle:
    """Something that touches the corridor or the ego; it does not move while a plan is rolled out."""

    id: str
    shape: shapely.Polygon
    speed_mps: float
    heading_rad: float
    occupied_m: tuple[tuple[float, float], ...]
    """Stretches of the path."""
    leads: bool = False
    """Whether it counts as ahead wherever it is, as a phantom does."""


def obstacles(
    observation: Observation,
    corridor: Corridor,
    roads: Roads,
    route_lanes: frozenset[str],
    shape: EgoShape,
    radius_m: float,
) -> list[FrozenObstacle]:
    """Actors within the radius and red connectors of the route that touch the corridor or the ego."""
    ego, actors = observation.ego, observation.actors
    rows = np.flatnonzero(np.hypot(actors.x_m - ego.x_m, actors.y_m - ego.y_m) < radius_m)
    red = sorted(observation.signals.with_status(SignalStatus.RED) & route_lanes)
    shapes = np.array([*actors.polygons[rows], *(roads[connector].polygon for connector in red)], dtype=object)
    if not shapes.size:
        return []
    occupied = corridor.occupied_m(shapes)
    touching = np.flatnonzero(shapely.intersects(shapes, ego.polygon(shape)))
    found: list[FrozenObstacle] = []
    for i in sorted({*occupied, *touching.tolist()}):
        if i < len(rows):
            row = int(rows[i])
            obstacle_id = actors.ids[row]
            # nuPlan's rule: an agent's speed is taken along its box, whichever way it moves.
            is_agent = ActorKind(int(actors.kind[row])).is_agent
            speed_mps = float(actors.speed_mps[row]) if is_agent else 0.0
            heading_rad = float(actors.heading_rad[row])
        else:
            obstacle_id, speed_mps, heading_rad = red[i - len(rows)], 0.0, 0.0
        found.append(FrozenObstacle(obstacle_id, shapes[i], speed_mps, heading_rad, occupied.get(i, ())))
    return found


def roll_out(
    ego: EgoState,
    progress_m: float,
    found: Sequence[FrozenObstacle],
    path: Polyline,
    driver: IdmDriver,
    samples: int,
    dt_s: float,
    shape: EgoShape,
) -> tuple[Trajectory, IdmDecision]:
    """IDM along the path from the ego's progress in explicit Euler steps; the plan, and the first step's decision.

    The lead is whatever is nearest to the ego's box among those that touch it
    or occupy the corridor ahead; with nothing ahead, the end of the path is a
    standing lead.
    """
    reach_m = driver.target_speed_mps * samples * dt_s + shape.width_m / 2  # square cap, as in nuPlan
    shapes = np.array([obstacle.shape for obstacle in found], dtype=object)
    speed_mps = max(0.0, ego.speed_mps)
    progress, speeds = [progress_m], [speed_mps]
    pose = ego.pose  # nuPlan, too, measures the first gap from where the ego really is
    decisions: list[IdmDecision] = []
    for _ in range(samples):
        decision = IdmDecision(progress_m, None, path.length_m - progress_m - shape.length_m / 2, 0.0)
        if found:
            gaps_m = shapely.distance(_box(pose, shape), shapes)
            for i in np.argsort(gaps_m, kind="stable").tolist():
                gap_m, obstacle = float(gaps_m[i]), found[i]
                ahead = any(b >= progress_m and a <= progress_m + reach_m for a, b in obstacle.occupied_m)
                if gap_m == 0.0 or ahead or obstacle.leads:
                    along_mps = obstacle.speed_mps * cos(obstacle.heading_rad - pose.heading_rad)
                    decision = IdmDecision(progress_m, obstacle.id, gap_m, along_mps)
                    break
        decisions.append(decision)
        moved_m, speed_mps = idm_step(driver, speed_mps, decision.gap_m, decision.lead_speed_mps, dt_s)
        progress_m += moved_m
        pose = path.pose_at(progress_m)
        progress.append(progress_m)
        speeds.append(speed_mps)
    return plan_along(path, ego.time_s + dt_s * np.arange(samples + 1), progress, speeds), decisions[0]


def _box(pose: Pose, shape: EgoShape) -> shapely.Polygon:
    """The ego's box at a pose of its centre; in plain floats, several times faster than `box_corners` for one box."""
    forward_x, forward_y = cos(pose.heading_rad) * shape.length_m / 2, sin(pose.heading_rad) * shape.length_m / 2
    left_x, left_y = -sin(pose.heading_rad) * shape.width_m / 2, cos(pose.heading_rad) * shape.width_m / 2
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    return shapely.Polygon(
        [(pose.x_m + f * forward_x + s * left_x, pose.y_m + f * forward_y + s * left_y) for f, s in signs]
    )
