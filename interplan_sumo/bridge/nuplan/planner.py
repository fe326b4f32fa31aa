"""A planner of nuPlan's as one of ours: what it is told, what it sees, and its trajectory as a plan."""

from __future__ import annotations

import gc
from collections import deque
from collections.abc import Callable
from typing import Any

from nuplan.common.actor_state.state_representation import StateSE2, TimePoint
from nuplan.planning.simulation.history.simulation_history_buffer import SimulationHistoryBuffer
from nuplan.planning.simulation.observation.observation_type import DetectionsTracks
from nuplan.planning.simulation.planner.abstract_planner import AbstractPlanner, PlannerInitialization, PlannerInput
from nuplan.planning.simulation.simulation_time_controller.simulation_iteration import SimulationIteration

from interplan_sumo.bridge.nuplan.frames import SAMPLES, samples, time_us
from interplan_sumo.bridge.nuplan.map_api import map_api
from interplan_sumo.bridge.nuplan.objects import (
    nuplan_ego,
    nuplan_lights,
    nuplan_tracks,
    our_plan,
    vehicle_parameters,
)
from interplan_sumo.errors import PlannerLoadError
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.trajectory import Trajectory


class NuPlanPlanner:
    """Drives with an `AbstractPlanner`, unmodified: a new one for every episode, as nuPlan makes them.

    It gets nuPlan's own map classes over the roads of the mission, and a history
    of 22 samples. Time begins at `frames.START_US`.
    """

    def __init__(self, make: Callable[[], AbstractPlanner]) -> None:
        """`make` is called once here, so that what is wrong with it shows at once; PlannerLoadError if it must not."""
        self._make = make
        self._next: AbstractPlanner | None = make()
        _check_kind(self._next)

    def start(self, mission: Mission) -> None:
        self._planner = self._make() if self._next is None else self._next
        self._next = None
        self._shape = mission.shape
        self._dt_s = mission.dt_s
        self._step = 0
        self._vehicle = vehicle_parameters(mission.shape)
        self._numbers: dict[str, int] = {}
        self._history: SimulationHistoryBuffer | None = None
        goal = mission.goal
        self._planner.initialize(
            PlannerInitialization(
                route_roadblock_ids=_route(mission.route),
                mission_goal=StateSE2(goal.x_m, goal.y_m, goal.heading_rad),
                map_api=map_api(mission.roads),
            )
        )

    def plan(self, observation: Observation) -> Trajectory:
        asked = self._input(observation)
        self._step += 1
        collecting = gc.isenabled()
        try:
            trajectory = self._planner.compute_trajectory(asked)
        finally:
            if collecting:  # some planners switch it off for good, which would starve whoever drives after them
                gc.enable()
        return our_plan(trajectory, self._shape)

    def _input(self, observation: Observation) -> PlannerInput:
        now_us = time_us(observation.time_s)
        if self._history is not None and now_us - self._seen_us == round(self._dt_s * 1e6):
            self._history.append(*self._sample(observation.ego, observation.actors))
        else:
            past = [self._sample(ego, actors) for ego, actors in samples(observation, self._dt_s)]
            egos, tracks = zip(*past, strict=True)
            self._history = SimulationHistoryBuffer(deque(egos, SAMPLES), deque(tracks, SAMPLES), self._dt_s)
        self._seen_us = now_us
        return PlannerInput(
            iteration=SimulationIteration(TimePoint(now_us), self._step),
            history=self._history,
            traffic_light_data=nuplan_lights(observation.signals, now_us),
        )

    def _sample(self, ego: EgoState, actors: Actors) -> tuple[Any, DetectionsTracks]:
        at_us = time_us(ego.time_s)
        return nuplan_ego(ego, at_us, self._vehicle), nuplan_tracks(actors, at_us, self._numbers)


def _route(blocks: tuple[str, ...]) -> list[str]:
    """A route as nuPlan's planners can take it: some count on two blocks, and none minds a repeated one."""
    return [*blocks] if len(blocks) > 1 else [*blocks, *blocks]


def _check_kind(planner: Any) -> None:
    """PlannerLoadError for what cannot drive here."""
    name = type(planner).__name__
    if not isinstance(planner, AbstractPlanner):
        raise PlannerLoadError(f"{name} is no nuPlan planner: it does not inherit from AbstractPlanner")
    if planner.requires_scenario:
        raise PlannerLoadError(f"{name} asks for the scenario itself, which no planner is given here")
    if planner.observation_type() is not DetectionsTracks:
        raise PlannerLoadError(f"{name} asks for {planner.observation_type().__name__}; there are tracks only")
