"""Driven route: a mission's route from where the ego begins, and what planners ask of it."""

from __future__ import annotations

from functools import cached_property

from interplan_planners.common.ground import Ground
from interplan_planners.common.lane_routes import Ways
from interplan_planners.common.red_lights import RedLights
from interplan_planners.common.route_correction import corrected_route
from interplan_planners.common.route_search import LaneFinder, lanes_of_route
from interplan_sumo.planner import Mission
from interplan_sumo.world.geometry import Pose


class DrivenRoute:
    """One mission's; each part is made when it is first asked for, and kept."""

    def __init__(self, mission: Mission, at: Pose, fallback_limit_mps: float) -> None:
        """`at` is where the route is to begin; `fallback_limit_mps` holds where the map knows no limit."""
        self.mission = mission
        self.blocks = corrected_route(mission.roads, mission.route, at)
        self._fallback_limit_mps = fallback_limit_mps

    def lane_at(self, pose: Pose) -> tuple[int, str]:
        """Index of the route's block at a pose, and the lane or connector there."""
        return self._lanes.at(pose.x_m, pose.y_m, pose.heading_rad)

    def limit_mps(self, lane_id: str) -> float:
        """The speed limit of a lane or connector."""
        return self.mission.roads[lane_id].speed_limit_mps or self._fallback_limit_mps

    @cached_property
    def ways(self) -> Ways:
        return Ways(self.mission, self.blocks, self._fallback_limit_mps)

    @cached_property
    def ground(self) -> Ground:
        return Ground(self.mission.roads, self._lane_ids)

    @cached_property
    def red_lights(self) -> RedLights:
        return RedLights(self.mission.roads, self._lane_ids, self.mission.shape.width_m / 2)

    @cached_property
    def _lanes(self) -> LaneFinder:
        return LaneFinder(self.mission.roads, self.blocks)

    @cached_property
    def _lane_ids(self) -> frozenset[str]:
        return lanes_of_route(self.mission.roads, self.blocks)
