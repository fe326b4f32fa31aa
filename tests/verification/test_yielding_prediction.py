"""When it is worth a try to count on who comes towards the ego to let it pass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from problems import laid_out, start_of, steady
from stages import ONE_LANE, car, staged, widened

from interplan_sumo.scenario.scenario import Behaviour, TrafficDemand
from interplan_sumo.verification.drivable_paths import Swerve
from interplan_sumo.verification.planning_problem import CALM, Margins
from interplan_sumo.verification.yielding_prediction import yielding_profiles


@pytest.mark.parametrize(
    ("behaviour", "apart_m", "steps"),
    [
        ("conservative", 140.0, [1, 2]),
        ("conservative", 120.0, [1]),
        ("conservative", 100.0, []),
        ("assertive", 140.0, []),
    ],
)
def test_the_ego_may_pull_out_early_and_before_a_cautious_driver_who_has_room_to_brake(
    behaviour: Behaviour, apart_m: float, steps: list[int]
) -> None:
    demand = TrafficDemand(oncoming="low", behaviour=behaviour)
    scenario = staged(start_speed_mps=8.0, obstacles=(car(60.0),), exempt=("driving_direction",), traffic=demand)
    problem = laid_out(scenario, widened(ONE_LANE), Swerve(over="left"))
    start = start_of(problem.corridor)
    coming = steady(start.arc_m + apart_m, -9.0, left_m=3.5)
    problem = replace(problem, others=replace(coming, behaviour=np.array([behaviour], dtype=object)))
    found = yielding_profiles(problem, problem.paths[0], start, Margins(), CALM)
    assert [gate.step for _, gate in found] == steps
    assert all(profile.to_goal for profile, _ in found)
