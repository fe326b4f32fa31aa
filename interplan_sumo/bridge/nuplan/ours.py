"""A planner of ours as one of nuPlan's, for nuPlan's own simulation and metrics."""

from __future__ import annotations

from pathlib import Path

from nuplan.planning.simulation.observation.observation_type import DetectionsTracks
from nuplan.planning.simulation.observation.observation_type import Observation as NuPlanObservation
from nuplan.planning.simulation.planner.abstract_planner import AbstractPlanner, PlannerInitialization, PlannerInput
from nuplan.planning.simulation.trajectory.abstract_trajectory import AbstractTrajectory

from interplan_sumo.bridge.nuplan.map_api import roads_behind
from interplan_sumo.bridge.nuplan.objects import nuplan_plan, our_actors, our_ego, our_signals, shape_of
from interplan_sumo.planner import Mission, Observation, Past, load_planner
from interplan_sumo.world.geometry import Pose

PAST_STEPS = 20
"""What our planners are given of the past: 2 s, the present not included."""
SIGHT_M = 100.0
"""And how far they see."""


class InterplanSumoPlanner(AbstractPlanner):
    """Any planner of ours, by the name that `--planner` takes, in nuPlan's simulation.

    Needs the GeoPackage of the map, in `maps_root` or where the variable
    NUPLAN_MAPS_ROOT names it. Our planner's time begins at the first step.
    """

    requires_scenario = False

    def __init__(self, planner: str, maps_root: str | Path | None = None) -> None:
        self._spec = planner
        self._maps_root = None if maps_root is None else Path(maps_root)
        self._planner = load_planner(planner)

    def __reduce__(self) -> tuple[type[InterplanSumoPlanner], tuple[str, Path | None]]:
        """nuPlan's logs hold the planner: its name is all that they need of it."""
        return type(self), (self._spec, self._maps_root)

    def name(self) -> str:
        return f"interplan-sumo {self._spec}"

    def observation_type(self) -> type[NuPlanObservation]:
        return DetectionsTracks

    def initialize(self, initialization: PlannerInitialization) -> None:
        goal = initialization.mission_goal
        self._roads = roads_behind(initialization.map_api, self._maps_root)
        self._route = tuple(initialization.route_roadblock_ids)
        self._goal = Pose(goal.x, goal.y, goal.heading)
        self._start_us: int | None = None

    def compute_planner_trajectory(self, current_input: PlannerInput) -> AbstractTrajectory:
        ego = current_input.history.ego_states[-1]
        vehicle = ego.car_footprint.vehicle_parameters
        if self._start_us is None:
            self._start_us = int(ego.time_us)
            self._planner.start(Mission(self._roads, self._route, self._goal, shape_of(vehicle)))
        plan = self._planner.plan(_seen(current_input, self._start_us))
        return nuplan_plan(plan, vehicle, self._start_us)


def _seen(current_input: PlannerInput, start_us: int) -> Observation:
    """What nuPlan shows its planners as what we show ours."""
    history = current_input.history
    egos = [our_ego(state, start_us) for state in history.ego_states[-PAST_STEPS - 1 :]]
    others = [our_actors(tracks) for tracks in history.observations[-PAST_STEPS - 1 :]]
    actors = [each.within(ego.x_m, ego.y_m, SIGHT_M) for ego, each in zip(egos, others, strict=True)]
    return Observation(
        time_s=egos[-1].time_s,
        ego=egos[-1],
        actors=actors[-1],
        signals=our_signals(current_input.traffic_light_data),
        past=Past(tuple(egos[:-1]), tuple(actors[:-1])),
    )
