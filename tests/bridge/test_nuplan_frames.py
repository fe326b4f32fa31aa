"""Numbers between nuPlan and us: times, the grid of its controller, centre and rear axle, the past."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.bridge.nuplan.frames import (
    SAMPLES,
    START_US,
    center_trajectory,
    grid_us,
    rear_axle_rows,
    samples,
    sorted_rows,
    time_us,
)
from interplan_sumo.planner import Observation, Past
from interplan_sumo.tiny_worlds import cars, ego, signals
from interplan_sumo.world.ego import PACIFICA, EgoShape
from interplan_sumo.world.trajectory import Trajectory

D = PACIFICA.rear_axle_to_center_m


def test_times_are_whole_microseconds_and_never_negative_in_the_past_of_an_episode() -> None:
    assert time_us(0.0) == START_US
    assert time_us(0.1 * 3) == START_US + 300_000
    assert time_us(-2.1) > 0


@pytest.mark.parametrize(
    ("start_us", "end_us", "grid"),
    [
        (5, 300_005, [5, 100_005, 200_005, 300_005]),
        (5, 300_004, [5, 100_005, 200_005]),
        (0, 99_999, [0, 99_999]),  # shorter than the grid: the end is kept
        (0, 100_000, [0, 100_000]),
    ],
)
def test_a_plan_is_looked_at_every_tenth_of_a_second_from_its_start(
    start_us: int, end_us: int, grid: list[int]
) -> None:
    assert grid_us(start_us, end_us).tolist() == grid


def test_the_centre_lies_ahead_of_the_rear_axle() -> None:
    rows = np.array([[START_US, 10.0, 5.0, np.pi / 2, 3.0], [START_US + 100_000, 10.0, 5.3, np.pi / 2, 3.0]])
    plan = center_trajectory(rows, PACIFICA)
    np.testing.assert_allclose(plan.time_s, (0.0, 0.1), atol=1e-12)
    np.testing.assert_allclose(plan.x_m, (10.0, 10.0), atol=1e-12)
    np.testing.assert_allclose(plan.y_m, (5.0 + D, 5.3 + D), atol=1e-12)
    assert plan.speed_mps is not None
    assert plan.speed_mps.tolist() == [3.0, 3.0]


@settings(max_examples=25)
@given(
    x_m=st.floats(-1e6, 1e6), y_m=st.floats(-1e6, 1e6), heading_rad=st.floats(-4.0, 4.0), ahead_m=st.floats(0.0, 3.0),
    start_us=st.integers(0, 2_000_000_000_000_000),
)  # fmt: skip
def test_a_plan_that_goes_to_nuplan_and_back_is_the_same(
    x_m: float, y_m: float, heading_rad: float, ahead_m: float, start_us: int
) -> None:
    shape = EgoShape(5.0, 2.0, 1.5, 3.0, ahead_m)
    plan = Trajectory(
        np.array((0.3, 0.4, 0.9)), x_m + np.array((0.0, 1.0, 2.0)), np.full(3, y_m), np.full(3, heading_rad), np.ones(3)
    )
    back = center_trajectory(rear_axle_rows(plan, shape, start_us), shape, start_us)
    for name in ("x_m", "y_m", "heading_rad", "speed_mps", "time_s"):
        np.testing.assert_allclose(getattr(back, name), getattr(plan, name), rtol=0, atol=1e-9)


def test_a_plan_without_speeds_gets_those_of_its_steps_negative_ones_where_it_backs() -> None:
    plan = Trajectory(np.array((0.0, 0.1, 0.3, 0.4)), np.array((0.0, 1.0, 2.0, 1.8)), np.zeros(4), np.zeros(4))
    np.testing.assert_allclose(rear_axle_rows(plan, PACIFICA)[:, 4], (10.0, 5.0, -2.0, -2.0))


def test_without_a_past_everybody_has_come_at_constant_velocity() -> None:
    seen = Observation(0.0, ego(x_m=0.0, speed_mps=5.0), cars((30.0, 0.0, 2.0)), signals())
    got = samples(seen, 0.1)
    assert len(got) == SAMPLES
    np.testing.assert_allclose([e.time_s for e, _ in got], 0.1 * np.arange(-SAMPLES + 1, 1), atol=1e-12)
    np.testing.assert_allclose([e.x_m for e, _ in got], 0.5 * np.arange(-SAMPLES + 1, 1), atol=1e-12)
    np.testing.assert_allclose([a.x_m[0] for _, a in got], 30.0 + 0.2 * np.arange(-SAMPLES + 1, 1), atol=1e-12)


@pytest.mark.parametrize(("known", "oldest_s"), [(20, -2.1), (21, -2.1), (22, -2.1)])
def test_a_history_holds_two_seconds_and_one_sample_more(known: int, oldest_s: float) -> None:
    now = ego(x_m=0.0, speed_mps=5.0)
    past = tuple(ego(x_m=-0.5 * k, speed_mps=5.0, time_s=-0.1 * k) for k in range(known, 0, -1))
    seen = Observation(0.0, now, cars(), signals(), Past(past, (cars(),) * known))
    got = samples(seen, 0.1)
    assert len(got) == SAMPLES
    assert got[0][0].time_s == pytest.approx(oldest_s)
    assert got[-1] == (now, seen.actors)


def test_tracks_are_sorted_by_their_names_and_named_once() -> None:
    assert sorted_rows(["b", "a", "c", "a"]) == [1, 0, 2]
    assert sorted_rows([]) == []
