"""The ego's past: from a recording into the scenario, moved to end in the start, and before the planner's eyes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from interplan_sumo.errors import ScenarioError
from interplan_sumo.scenario.recorded import scene
from interplan_sumo.scenario.recorded_parts import PAST_COLUMNS, PAST_STEPS, EgoPast
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.history import extrapolated_egos
from interplan_sumo.simulation.setup import start_state
from interplan_sumo.tiny_worlds import straight_road
from tests.scenario.made_recordings import drives, poses_along, recording, track

ROADS = straight_road(lanes=2, length_m=300.0)


def made(at_s: float, *, y_m: float = 0.0, step_s: float = 0.1, start_step: int = 0) -> Scenario:
    """The ego at 10 m/s along the left lane, from x = 20 m on."""
    ego = drives("ego", 20.0, y_m, 10.0 * step_s / 0.1, 100, step_s=step_s)
    log = replace(recording(ego, drives("a", 60.0, -3.5, 10.0, 100), step_s=step_s), start_step=start_step)
    return scene(log, ROADS, at_s=at_s).scenario


@pytest.mark.parametrize(
    ("at_s", "step_s", "known"), [(1.9, 0.1, False), (2.0, 0.1, True), (4.0, 0.1, True), (4.0, 0.2, True)]
)
def test_a_scenario_has_a_past_where_the_track_has_two_seconds(at_s: float, step_s: float, known: bool) -> None:
    past = made(at_s, step_s=step_s).past
    assert (past is not None) is known
    if past is not None:
        ends_m = 20.0 + 10.0 * at_s
        assert_allclose(past.x_m, ends_m + 1.0 * np.arange(-20, 0), atol=1e-3)
        assert past.speed_mps == (10.0,) * PAST_STEPS


def test_scenes_begin_where_the_recording_says_and_are_named_after_the_time_since() -> None:
    scenario = made(0.0, start_step=20)
    assert scenario.id.endswith("ego-0.0s-sumo")
    assert scenario.start.arc_m == pytest.approx(40.0, abs=0.01)
    assert scenario.past is not None
    with pytest.raises(ScenarioError, match=r"lasts from 0 to 7\.9 s"):
        made(8.0, start_step=20)


@given(left_m=st.floats(-1.6, 1.6), turned_rad=st.floats(-0.5, 0.5))
def test_the_past_ends_in_the_start_whatever_the_ego_did_to_get_there(left_m: float, turned_rad: float) -> None:
    way = (np.cos(turned_rad), np.sin(turned_rad))
    begin = (100.0 - 30.0 * way[0], left_m - 30.0 * way[1])
    poses = poses_along((begin, (begin[0] + 90.0 * way[0], begin[1] + 90.0 * way[1])), 10.0, 60)
    log = recording(track("ego", poses), drives("a", 160.0, -3.5, 10.0, 60))
    scenario = scene(log, ROADS, at_s=3.0).scenario
    start, past = scenario.start.pose(ROADS), scenario.past
    assert past is not None
    gap_m = np.hypot(past.x_m[-1] - start.x_m, past.y_m[-1] - start.y_m)
    assert gap_m == pytest.approx(1.0, abs=0.01)  # a step at 10 m/s
    assert_allclose(past.heading_rad, start.heading_rad, atol=1e-4)


def test_planners_see_the_past_of_the_scenario() -> None:
    scenario = made(4.0)
    ego = start_state(scenario, ROADS)
    seen = extrapolated_egos(ROADS, ego, 0.1, scenario.past)
    assert scenario.past is not None
    assert tuple(each.x_m for each in seen) == scenario.past.x_m
    assert [each.time_s for each in seen] == pytest.approx(np.arange(-20, 0) * 0.1)
    slower = replace(scenario.past, speed_mps=(7.0,) * PAST_STEPS)
    assert {each.vx_mps for each in extrapolated_egos(ROADS, ego, 0.1, slower)} == {7.0}


@pytest.mark.parametrize("name", PAST_COLUMNS)
def test_a_past_that_cannot_be_is_one_line(name: str) -> None:
    whole = dict.fromkeys(PAST_COLUMNS, (0.0,) * PAST_STEPS)
    with pytest.raises(ScenarioError, match=f"past: {name} has 19 numbers, expected 20"):
        EgoPast(**(whole | {name: (0.0,) * 19}))
    with pytest.raises(ScenarioError, match=f"past: {name} holds a number that is not finite"):
        EgoPast(**(whole | {name: (float("nan"),) * PAST_STEPS}))
