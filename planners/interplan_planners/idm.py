"""nuPlan's IDM planner: keep to one lane, keep a gap, stop at red."""

from __future__ import annotations

from typing import ClassVar

from interplan_planners.common.corridor import Corridor
from interplan_planners.common.frozen_world import IdmDecision, obstacles, roll_out
from interplan_planners.common.idm_policy import IdmDriver
from interplan_planners.common.option_checks import at_least_0, more_than_0
from interplan_planners.common.paths import braking_plan, centerline
from interplan_planners.common.route_search import lane_chain, lanes_of_route, starting_lane
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.trajectory import Trajectory

FARTHEST_FROM_PATH_M = 2.0
"""Beyond this the ego has lost its path; a plan from the path would be a teleport."""


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

    paper: ClassVar[str] = "Treiber, Hennecke, Helbing 2000; as in nuPlan"

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
        more_than_0(
            target_speed_mps=target_speed_mps,
            max_acceleration_mps2=max_acceleration_mps2,
            max_deceleration_mps2=max_deceleration_mps2,
            samples=samples,
            sample_interval_s=sample_interval_s,
        )
        at_least_0(min_gap_m=min_gap_m, headway_s=headway_s, radius_m=radius_m)
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

    def plan(self, observation: Observation) -> Trajectory:
        ego = observation.ego
        if self._corridor is None:
            self._corridor = self._begin(ego)
        progress_m, left_m = self._corridor.path.project_point(ego.x_m, ego.y_m)
        if abs(left_m) > FARTHEST_FROM_PATH_M:  # beyond the ends of the path this is the distance to them
            self.decision = None
            horizon_s = self.samples * self.sample_interval_s
            return braking_plan(ego, self.max_deceleration_mps2, horizon_s, self.sample_interval_s)
        found = obstacles(
            observation, self._corridor, self._mission.roads, self._route_lanes, self._mission.shape, self.radius_m
        )
        plan, self.decision = roll_out(
            ego, progress_m, found, self._corridor.path, self._driver, self.samples, self.sample_interval_s,
            self._mission.shape,
        )  # fmt: skip
        return plan

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
