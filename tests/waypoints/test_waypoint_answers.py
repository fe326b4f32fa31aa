"""From an answer to a trajectory: what is refused, and what the numbers mean."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import ego

from interplan_llm.models.protocol import ModelFailure, Reply
from interplan_llm.waypoints.answers import kept_up_with, trajectory, waypoints
from interplan_llm.waypoints.form import POINTS, STEP_S
from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.plan_check import check_plan


def said(rows: Any) -> Reply:
    return Reply("", data={"thoughts": "", "waypoints": rows}, completion_tokens=7)


STRAIGHT = [[5.0 * (k + 1), 0.0] for k in range(POINTS)]


@pytest.mark.parametrize("step_m", [5.0, 30.0])
def test_sixteen_pairs_are_places_up_to_sixty_metres_a_second(step_m: float) -> None:
    rows = [[step_m * (k + 1), 0.0] for k in range(POINTS)]
    assert waypoints(said(rows)).tolist() == rows


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (None, "no list of waypoints"),
        (STRAIGHT[:15], "15 of waypoints"),
        ([*STRAIGHT, [90.0, 0.0]], "17 of waypoints"),
        ([[30.1 * (k + 1), 0.0] for k in range(POINTS)], r"asks for 60\.2 m/s, over 60"),
        ([*STRAIGHT[:3], [20.0], *STRAIGHT[4:]], "waypoint 3 is not a pair"),
        ([*STRAIGHT[:3], [20.0, "x"], *STRAIGHT[4:]], "waypoint 3 is not a pair"),
        ([*STRAIGHT[:3], [True, 0.0], *STRAIGHT[4:]], "waypoint 3 is not a pair"),
    ],
)
def test_anything_else_is_refused(rows: Any, message: str) -> None:
    with pytest.raises(ModelFailure, match=message) as failure:
        waypoints(said(rows))
    assert failure.value.cause == "parse"
    assert failure.value.reply is not None
    assert failure.value.reply.completion_tokens == 7


def test_x_is_ahead_and_y_is_left_of_the_car() -> None:
    state = ego(100.0, 50.0, 10.0, heading_rad=np.pi / 2, time_s=3.0)
    rows = [[5.0 * (k + 1), 1.0] for k in range(POINTS)]
    plan = trajectory(waypoints(said(rows)), state)
    assert (plan.x_m[0], plan.y_m[0]) == (100.0, 50.0)
    assert (plan.x_m[1], plan.y_m[1]) == pytest.approx((99.0, 55.0))
    assert plan.time_s.tolist() == pytest.approx([3.0 + STEP_S * k for k in range(POINTS + 1)])
    assert plan.heading_rad[-1] == pytest.approx(np.pi / 2)


def test_headings_follow_the_way_and_stay_where_the_car_stands_or_backs() -> None:
    rows = [[5.0, 0.0], [10.0, 5.0], *[[10.0, 5.0]] * (POINTS - 3), [9.0, 4.0]]
    plan = trajectory(waypoints(said(rows)), ego(0.0, 0.0, 10.0))
    assert plan.heading_rad[1:4].tolist() == pytest.approx([0.0, np.pi / 4, np.pi / 4])
    assert plan.heading_rad[-1] == pytest.approx(np.pi / 4)


@settings(max_examples=25)
@given(st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=POINTS, max_size=POINTS))
def test_every_answer_that_is_accepted_can_be_followed_however_little_a_car_can_do_of_it(
    steps: list[tuple[float, float]],
) -> None:
    state = ego(10.0, -4.0, 8.0, heading_rad=2.0)
    plan = trajectory(waypoints(said(np.cumsum(np.array(steps), axis=0).tolist())), state)
    for _ in range(15):
        plan = kept_up_with(plan, state)
        check_plan(plan, state, state.time_s)
        state = follow(state, plan, 0.1)


@pytest.mark.parametrize(("off_m", "moved_m"), [(1.9, 0.0), (2.1, 0.1), (-5.0, -3.0)])
def test_a_plan_is_moved_only_as_far_as_it_must_be(off_m: float, moved_m: float) -> None:
    plan = trajectory(waypoints(said(STRAIGHT)), ego(0.0, 0.0, 10.0))
    moved = kept_up_with(plan, ego(10.0, off_m, 10.0, time_s=1.0))
    assert moved.y_m.tolist() == pytest.approx([moved_m] * (POINTS + 1))
    assert moved.x_m.tolist() == pytest.approx(plan.x_m.tolist())
    assert (moved is plan) == (moved_m == 0.0)


@settings(max_examples=40)
@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(), lambda s: st.lists(s) | st.dictionaries(st.text(), s)
    )
)
def test_no_answer_raises_anything_else(data: Any) -> None:
    with pytest.raises(ModelFailure):
        waypoints(Reply("", data=data))
