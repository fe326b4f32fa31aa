"""The loop step by step: what `run_loop` does, by hand."""

from __future__ import annotations

import pytest
from test_episode import ROADS, run, scenario, straight

from interplan_planners.straight_ahead import StraightAhead
from interplan_sumo.errors import PlannerError
from interplan_sumo.simulation.episode import Loop
from interplan_sumo.simulation.scripted import ScriptedTraffic


def test_a_loop_that_is_advanced_by_hand_gives_the_trace_of_a_run() -> None:
    loop, planner = Loop(scenario(), ROADS, ScriptedTraffic()), StraightAhead()
    planner.start(loop.open())
    while loop.begin_frame():
        loop.advance(planner.plan(loop.observation))
    by_hand, at_once = loop.trace(), run(StraightAhead()).trace
    assert by_hand is not None
    assert at_once is not None
    assert by_hand.hash() == at_once.hash()
    assert not loop.reached_goal


def test_it_ends_past_the_goal_line_with_that_frame_written_down() -> None:
    loop = Loop(scenario(goal_m=34.9), ROADS, ScriptedTraffic())
    loop.open()
    while loop.begin_frame():
        loop.advance(straight(loop.observation))
    assert loop.reached_goal
    trace = loop.trace()
    assert trace is not None
    assert (len(trace), len(trace.plans)) == (16, 15)
    assert trace.ego.x_m[-1] == loop.ego.x_m > 34.9


def test_before_the_first_frame_there_is_no_trace() -> None:
    loop = Loop(scenario(), ROADS, ScriptedTraffic())
    mission = loop.open()
    assert mission.route == ("1",)
    assert loop.trace() is None
    assert loop.observation.time_s == 0.0


def test_a_plan_that_cannot_be_followed_moves_nothing() -> None:
    loop = Loop(scenario(), ROADS, ScriptedTraffic())
    loop.open()
    loop.begin_frame()
    with pytest.raises(PlannerError, match="100 m/s"):
        loop.advance(straight(loop.observation, speed_mps=100.0))
    assert loop.ego.time_s == 0.0
    trace = loop.trace()
    assert trace is not None
    assert (len(trace), len(trace.plans)) == (1, 0)
