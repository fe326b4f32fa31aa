"""The waypoints planner: what it asks, what it does with answers, and without."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from worlds import cars, ego, mission, observation, pedestrians, straight_road, together

from interplan_llm.models.protocol import ModelFailure, Reply, Request
from interplan_llm.models.scripted import ScriptedModel
from interplan_llm.waypoints.form import POINTS
from interplan_llm.waypoints.planner import KEPT_S, LlmWaypointsPlanner
from interplan_llm.waypoints.prompt import NEAREST
from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.planner import Past
from interplan_sumo.world.actors import ActorKind, Actors
from tests.planners.staging_planners import driven

ROAD = straight_road(lanes=2, length_m=600.0, limit_mps=12.0)
TO_THE_LEFT = mission(ROAD, ("11",), goal_arc_m=400.0)


def answer(speed_mps: float) -> str:
    return json.dumps({"thoughts": "on", "waypoints": [[0.5 * speed_mps * (k + 1), 0.0] for k in range(POINTS)]})


def planner(*answers: str | ModelFailure, **options: Any) -> LlmWaypointsPlanner:
    made = LlmWaypointsPlanner("scripted:unused", **options)
    made.model = ScriptedModel(list(answers))
    made.start(TO_THE_LEFT)
    return made


def asked(actors: Actors | None = None, *, centerline: bool = True, y_m: float = -3.5) -> str:
    made = planner(centerline=centerline)
    state = ego(100.0, y_m, 8.0)
    past = tuple(ego(100.0 - 0.8 * k, y_m, 8.0) for k in range(20, 0, -1))
    return made.request(observation(state, actors, None, Past(past, ()))).messages[1].text


def test_places_are_told_in_the_cars_frame_with_their_motion() -> None:
    text = asked(cars((120.0, 0.0, 6.0)))
    assert "Agents: vehicle at (20.0, 3.5) moving (6.0, 0.0)." in text


def test_static_things_are_told_apart() -> None:
    text = asked(cars((120.0, -3.5), kind=ActorKind.TRAFFIC_CONE, length_m=0.4, width_m=0.4))
    assert "Agents: none." in text
    assert "Things in the way: cone at (20.0, 0.0)." in text


def test_only_the_five_nearest_within_fifty_metres_are_told() -> None:
    text = asked(together(cars(*((100.0 + 8.0 * k, 0.0, 5.0) for k in range(1, 9))), pedestrians((151.0, -3.5))))
    assert text.count("vehicle at") == NEAREST
    assert "(48.0" not in text
    assert "pedestrian" not in text


def test_the_past_and_the_goal_are_told() -> None:
    text = asked()
    assert "Car's past, every 0.5 s: (-16.0, 0.0) (-12.0, 0.0) (-8.0, 0.0) (-4.0, 0.0)." in text
    assert "Goal: left, 300 m ahead." in text
    assert "Goal: forward" in asked(y_m=0.0)


def test_the_lanes_line_is_told_unless_it_is_switched_off() -> None:
    assert "Lane ahead: (5.0, 0.0) (10.0, 0.0)" in asked()
    assert "Lane ahead" not in asked(centerline=False)


def test_a_plan_holds_for_a_second_and_is_followed() -> None:
    made = planner(*[answer(8.0)] * 10)
    end = driven(made, ego(100.0, -3.5, 8.0), 35)[-1]
    assert len(made.exchanges) == 4
    assert end.x_m == pytest.approx(128.0, abs=0.5)


def test_without_an_answer_the_last_plan_is_driven_on_and_then_the_car_brakes() -> None:
    made = planner(answer(8.0), *[ModelFailure("timeout", "slow")] * 30)
    speeds = [state.vx_mps for state in driven(made, ego(100.0, -3.5, 8.0), 90)]
    assert min(speeds[: round(10 * KEPT_S)]) > 7.5
    assert speeds[-1] < 0.5
    assert made.report()["fallbacks"]["timeout"] == 8


class Slow(ScriptedModel):
    """Takes 1.5 s for an answer."""

    def ask(self, request: Request) -> Reply:
        return replace(super().ask(request), latency_s=1.5)


@pytest.mark.parametrize(("real_time", "asked_at_s"), [(False, [0, 1, 2, 3]), (True, [0, 1, 2.5])])
def test_in_real_time_an_answer_counts_when_it_has_come_and_no_question_before_that(
    real_time: bool, asked_at_s: list[float]
) -> None:
    made = planner(real_time=real_time)
    made.model = Slow([answer(speed) for speed in (8.0, 6.0, 4.0, 2.0)])
    state, asked_for = ego(100.0, -3.5, 8.0), list[float]()
    for _ in range(35):
        plan = made.plan(observation(state))
        asked_for.append(round(float(np.hypot(np.diff(plan.x_m)[0], np.diff(plan.y_m)[0])) / 0.5, 1))
        state = follow(state, plan, 0.1)
    assert [each.time_s for each in made.exchanges] == pytest.approx(asked_at_s)
    changes_s = [k / 10 for k in range(1, 35) if asked_for[k] != asked_for[k - 1]]
    assert changes_s == ([2.5] if real_time else [1.0, 2.0, 3.0])


def test_what_no_car_can_do_is_driven_as_far_as_it_can_be() -> None:
    leap = json.dumps({"thoughts": "on", "waypoints": [[20.0, 3.0], *[[30.0, 3.0], [10.0, 0.0]] * 7, [30.0, 0.0]]})
    made = planner(*[leap] * 6)
    driven(made, ego(100.0, -3.5, 8.0), 50)
    assert made.report()["fallback_share"] == 0.0


def test_nonsense_is_counted_and_not_driven() -> None:
    made = planner("turn left!", json.dumps({"thoughts": "", "waypoints": [[1e9, 0.0]] * POINTS}))
    made.plan(observation(ego(100.0, -3.5, 8.0)))
    made.plan(observation(ego(108.0, -3.5, 8.0, time_s=1.0)))
    assert [each.failure and each.failure.cause for each in made.exchanges] == ["parse"] * 2


@pytest.mark.parametrize("timeout_s", [0.0, -1.0, math.inf, math.nan, 1e7])
def test_nobody_can_wait_for_no_time_or_for_ever(timeout_s: float) -> None:
    with pytest.raises(ValueError, match="expected more than 0 and at most 1e"):
        planner(timeout_s=timeout_s)


def test_every_question_asks_for_json_of_a_closed_form() -> None:
    request = planner().request(observation(ego(100.0, -3.5, 8.0)))
    assert request.schema is not None
    assert request.schema["additionalProperties"] is False
    assert request.grammar is not None


def test_an_example_for_fine_tuning_is_the_question_with_an_answer_that_can_be_read_back() -> None:
    made = planner()
    seen = observation(ego(100.0, -3.5, 8.0), cars((120.0, -3.5)))
    places = np.array([[4.0 * k, 0.0] for k in range(1, POINTS + 1)])
    system, user, assistant = made.example(seen, places, "keep going")
    assert (system, user) == made.request(seen).messages
    assert assistant.role == "assistant"
    assert json.loads(assistant.text) == {"thoughts": "keep going", "waypoints": places.tolist()}
    told = made.example(seen, places)[2]  # without thoughts it gets them by rules
    assert json.loads(told.text)["thoughts"] == "Mind vehicle ahead. Keep speed, forward."
