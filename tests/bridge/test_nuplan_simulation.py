"""Planners of ours in nuPlan's own simulation drive as they do here: its loop, tracker, bicycle and history."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from devkit import devkit

from interplan_sumo.bridge.nuplan.frames import START_US, STEP_US
from interplan_sumo.planner import load_planner
from interplan_sumo.tiny_worlds import cars, ego_on, mission, straight_road
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Floats
from tests.planners.staging_planners import driven

ROADS = straight_road(lanes=2, length_m=300.0, cuts_m=((100.0, 120.0),))
MISSION = mission(ROADS, ("11", "21", "31"))
PARKED = cars((70.0, 0.5))
START = ego_on(ROADS, "11", 5.0, 8.0)
ITERATIONS = 41


def scenario() -> Any:
    """What nuPlan's simulation asks of a scenario: an ego that came along the lane, and a parked car."""
    objects = devkit("interplan_sumo.bridge.nuplan.objects")
    api = devkit("interplan_sumo.bridge.nuplan.map_api").map_api(ROADS)
    vehicle = objects.vehicle_parameters(PACIFICA)

    def ego(step: int) -> Any:
        return objects.nuplan_ego(ego_on(ROADS, "11", 5.0 + 0.8 * step, 8.0), START_US + step * STEP_US, vehicle)

    def tracks(step: int) -> Any:
        return objects.nuplan_tracks(PARKED, START_US + step * STEP_US, {})

    return SimpleNamespace(
        database_interval=0.1,
        map_api=api,
        initial_ego_state=ego(0),
        get_number_of_iterations=lambda: ITERATIONS,
        get_time_point=lambda step: objects.TimePoint(START_US + step * STEP_US),
        get_tracked_objects_at_iteration=tracks,
        get_traffic_light_status_at_iteration=lambda _step: iter(()),
        get_past_tracked_objects=lambda iteration, time_horizon, num_samples: map(tracks, range(-num_samples, 0)),  # noqa: ARG005
        get_ego_past_trajectory=lambda iteration, time_horizon, num_samples: map(ego, range(-num_samples, 0)),  # noqa: ARG005
        get_mission_goal=lambda: objects.StateSE2(MISSION.goal.x_m, MISSION.goal.y_m, MISSION.goal.heading_rad),
        get_route_roadblock_ids=lambda: list(MISSION.route),
    )


def lqr_tracker() -> Any:
    """nuPlan's tracker with nuPlan's numbers; NumPy 2.4 takes no array of one number where it hands one over."""

    theirs: Any = devkit("nuplan.planning.simulation.controller.tracker.lqr").LQRTracker

    class Tracker(theirs):
        def _solve_one_step_lqr(self, *args: Any, **kwargs: Any) -> float:
            return np.asarray(super()._solve_one_step_lqr(*args, **kwargs)).item()

    return Tracker([10.0], [1.0], [1.0, 10.0, 0.0], [1.0], 0.1, 10, 1e-4, 1e-2, 0.5, 0.2)


def simulated(planner: Any) -> Floats:
    """(40, 4) x, y, heading and speed of the ego in nuPlan's simulation, from its history."""
    part = "nuplan.planning.simulation."
    staged = scenario()
    pacifica = devkit("interplan_sumo.bridge.nuplan.objects").vehicle_parameters(PACIFICA)
    tracker = lqr_tracker()
    bicycle = devkit(part + "controller.motion_model.kinematic_bicycle").KinematicBicycleModel(pacifica)
    setup = devkit(part + "simulation_setup").SimulationSetup(
        time_controller=devkit(
            part + "simulation_time_controller.step_simulation_time_controller"
        ).StepSimulationTimeController(staged),
        observations=devkit(part + "observation.tracks_observation").TracksObservation(staged),
        ego_controller=devkit(part + "controller.two_stage_controller").TwoStageController(staged, tracker, bicycle),
        scenario=staged,
    )
    simulation = devkit(part + "simulation").Simulation(setup, simulation_history_buffer_duration=2.0)
    planner.initialize(simulation.initialize())
    while simulation.is_simulation_running():
        simulation.propagate(planner.compute_trajectory(simulation.get_planner_input()))
    states = simulation.history.extract_ego_state
    return np.array([(*s.center, s.dynamic_car_state.rear_axle_velocity_2d.x) for s in states])


def here(name: str) -> Floats:
    """The same with our loop."""
    planner = load_planner(name)
    planner.start(MISSION)
    states = driven(planner, START, ITERATIONS - 1, PARKED, may_touch=True)[:-1]
    return np.array([(state.x_m, state.y_m, state.heading_rad, state.vx_mps) for state in states])


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["straight_ahead", "idm", "pdm_closed"])
def test_nuplans_simulation_moves_the_ego_as_ours_does(name: str) -> None:
    planner = devkit("interplan_sumo.bridge.nuplan.ours").InterplanSumoPlanner(name)
    np.testing.assert_allclose(simulated(planner), here(name), rtol=0, atol=1e-6)
