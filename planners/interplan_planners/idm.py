"""nuPlan's IDM planner: keep to one lane, keep a gap, stop at red."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

import numpy as np
import shapely

from interplan_planners.common.corridor import Corridor
from interplan_planners.common.idm_policy import IdmDriver, idm_step
from interplan_planners.common.paths import braking_plan, centerline, plan_along
from interplan_planners.common.route_search import lane_chain, lanes_of_route, starting_lane
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Polyline, Pose
from interplan_sumo.world.signals import SignalStatus
from interplan_sumo.world.trajectory import Trajectory

FARTHEST_FROM_PATH_M = 2.0
"""Beyond this the ego has lost its path; a plan from the path would be a teleport."""


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
class _Obstacle:
    """Something that touches the corridor or the ego; it does not move while a plan is rolled out."""

    id: str
    shape: shapely.Polygon
    speed_mps: float
    heading_rad: float
    occupied_m: tuple[tuple[float, float], ...]
    """Stretches of the path."""


class IdmPlanner:
    """Follows the centre line on which it starts; never changes lane.

    At the first step a breadth-first search over the lanes of the route fixes
    the path for the whole episode; the target speed becomes the limit of the
    first lane, or the ego's speed if that is higher. The lead is the nearest
    thing in the corridor ahead: actors, and connectors of the route that show
    red. It stands still while 16 Euler steps of 0.5 s roll the plan out. With
    nothing ahead, the end of the path is a standing lead.

    As in nuPlan, positions are those of the box centre: it is projected on the
    path, and the plan's poses put it there without lateral error. An ego
    farther than 2 m from its path (nuPlan would jump back) brakes straight ahead.
    """

    def __init__(
        self,
        target_speed_mps: float = 10.0,
        min_gap_m: float = 1.0,
        headway_s: float = 1.5,
        max_acceleration_mps2: float = 1.0,
        max_deceleration_mps2: float = 3.0,
        samples: int = 16,
        sample_interval_s: float = 0.5,
        radius_m: float = 40.0,
    ) -> None:
        """`target_speed_mps` holds only where the map knows no limit; `radius_m` is how far actors are considered."""
        positive = {
            "target_speed_mps": target_speed_mps,
            "max_acceleration_mps2": max_acceleration_mps2,
            "max_deceleration_mps2": max_deceleration_mps2,
            "samples": samples,
            "sample_interval_s": sample_interval_s,
        }
        for name, value in positive.items():
            if not value > 0:
                raise ValueError(f"{name} is {value}, expected more than 0")
        self.target_speed_mps = target_speed_mps
        self.min_gap_m = min_gap_m
        self.headway_s = headway_s
        self.max_acceleration_mps2 = max_acceleration_mps2
        self.max_deceleration_mps2 = max_deceleration_mps2
        self.samples = samples
        self.sample_interval_s = sample_interval_s
        self.radius_m = radius_m
        self.decision: IdmDecision | None = None

    def start(self, mission: Mission) -> None:
        self._mission = mission
        self._route_lanes = lanes_of_route(mission.roads, mission.route)
        self._corridor: Corridor | None = None
        self._driver = self._driver_for(self.target_speed_mps)
        self.decision = None

    def plan(self, seen: Observation) -> Trajectory:
        ego = seen.ego
        if self._corridor is None:
            self._corridor = self._begin(ego)
        progress_m, left_m = self._corridor.path.project_point(ego.x_m, ego.y_m)
        if abs(left_m) > FARTHEST_FROM_PATH_M:  # beyond the ends of the path this is the distance to them
            self.decision = None
            horizon_s = self.samples * self.sample_interval_s
            return braking_plan(ego, self.max_deceleration_mps2, horizon_s, self.sample_interval_s)
        return self._roll_out(ego, progress_m, self._obstacles(seen, self._corridor), self._corridor.path)

    def _begin(self, ego: EgoState) -> Corridor:
        """Fix path and target speed for the episode."""
        roads, shape = self._mission.roads, self._mission.shape
        index, lane_id = starting_lane(roads, self._mission.route, ego, shape)
        limit_mps = roads[lane_id].speed_limit_mps or self.target_speed_mps
        self._driver = self._driver_for(max(limit_mps, abs(ego.speed_mps)))
        path = centerline(roads, lane_chain(roads, self._mission.route, index, lane_id))
        # nuPlan's path lacks its last vertex, so that it ends up to 1 m early.
        return Corridor(Polyline(path.points[:-1]) if len(path.points) > 2 else path, shape.width_m / 2)

    def _driver_for(self, target_speed_mps: float) -> IdmDriver:
        return IdmDriver(
            target_speed_mps, self.min_gap_m, self.headway_s, self.max_acceleration_mps2, self.max_deceleration_mps2
        )

    def _obstacles(self, seen: Observation, corridor: Corridor) -> list[_Obstacle]:
        """Actors within the radius and red connectors of the route that touch the corridor or the ego."""
        ego, actors, roads = seen.ego, seen.actors, self._mission.roads
        rows = np.flatnonzero(np.hypot(actors.x_m - ego.x_m, actors.y_m - ego.y_m) < self.radius_m)
        red = sorted(seen.signals.with_status(SignalStatus.RED) & self._route_lanes)
        shapes = np.array([*actors.polygons[rows], *(roads[connector].polygon for connector in red)], dtype=object)
        if not shapes.size:
            return []
        occupied = corridor.occupied_m(shapes)
        touching = np.flatnonzero(shapely.intersects(shapes, ego.polygon(self._mission.shape)))
        obstacles: list[_Obstacle] = []
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
            obstacles.append(_Obstacle(obstacle_id, shapes[i], speed_mps, heading_rad, occupied.get(i, ())))
        return obstacles

    def _roll_out(self, ego: EgoState, progress_m: float, obstacles: list[_Obstacle], path: Polyline) -> Trajectory:
        """IDM along the path from the ego's progress; the first decision is kept for inspection."""
        shape, dt_s = self._mission.shape, self.sample_interval_s
        reach_m = self._driver.target_speed_mps * self.samples * dt_s + shape.width_m / 2  # square cap, as in nuPlan
        shapes = np.array([obstacle.shape for obstacle in obstacles], dtype=object)
        speed_mps = max(0.0, ego.speed_mps)
        progress, speeds = [progress_m], [speed_mps]
        pose = ego.pose  # nuPlan, too, measures the first gap from where the ego really is
        for k in range(self.samples):
            decision = IdmDecision(progress_m, None, path.length_m - progress_m - shape.length_m / 2, 0.0)
            if obstacles:
                gaps_m = shapely.distance(_box(pose, shape), shapes)
                for i in np.argsort(gaps_m, kind="stable").tolist():
                    gap_m, obstacle = float(gaps_m[i]), obstacles[i]
                    ahead = any(b >= progress_m and a <= progress_m + reach_m for a, b in obstacle.occupied_m)
                    if gap_m == 0.0 or ahead:
                        along_mps = obstacle.speed_mps * cos(obstacle.heading_rad - pose.heading_rad)
                        decision = IdmDecision(progress_m, obstacle.id, gap_m, along_mps)
                        break
            if k == 0:
                self.decision = decision
            moved_m, speed_mps = idm_step(self._driver, speed_mps, decision.gap_m, decision.lead_speed_mps, dt_s)
            progress_m += moved_m
            pose = path.pose_at(progress_m)
            progress.append(progress_m)
            speeds.append(speed_mps)
        time_s = ego.time_s + dt_s * np.arange(self.samples + 1)
        return plan_along(path, time_s, progress, speeds)


def _box(pose: Pose, shape: EgoShape) -> shapely.Polygon:
    """The ego's box at a pose of its centre; in plain floats, several times faster than `box_corners` for one box."""
    forward_x, forward_y = cos(pose.heading_rad) * shape.length_m / 2, sin(pose.heading_rad) * shape.length_m / 2
    left_x, left_y = -sin(pose.heading_rad) * shape.width_m / 2, cos(pose.heading_rad) * shape.width_m / 2
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    return shapely.Polygon(
        [(pose.x_m + f * forward_x + s * left_x, pose.y_m + f * forward_y + s * left_y) for f, s in signs]
    )
