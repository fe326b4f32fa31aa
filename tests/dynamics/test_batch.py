from __future__ import annotations

from dataclasses import astuple
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import ego

from interplan_sumo.dynamics.batch import follow_all
from interplan_sumo.dynamics.lqr import follow
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats, wrap_angle
from interplan_sumo.world.trajectory import Trajectory

STEP_S = 0.1


def wild_plans(
    rng: np.random.Generator, start: EgoState, count: int, steps: int, speed_mps: float
) -> tuple[Floats, Floats, Floats]:
    """Plans that begin near the ego and wander off."""
    speed = np.maximum(0.0, rng.normal(speed_mps, 0.5 * speed_mps, (count, 1)) + rng.normal(0, 0.1, (count, steps)))
    turns = np.cumsum(rng.normal(0.0, 0.03, (count, steps + 1)), axis=1)
    heading = start.heading_rad + rng.normal(0.0, 0.1, (count, 1)) + turns
    way_x = np.cumsum(STEP_S * speed * np.cos(heading[:, :-1]), axis=1)
    way_y = np.cumsum(STEP_S * speed * np.sin(heading[:, :-1]), axis=1)
    nothing = np.zeros((count, 1))
    x_m = start.x_m + rng.normal(0.0, 0.3, (count, 1)) + np.concatenate((nothing, way_x), axis=1)
    y_m = start.y_m + rng.normal(0.0, 0.3, (count, 1)) + np.concatenate((nothing, way_y), axis=1)
    return x_m, y_m, wrap_angle(heading)


def apart(one: EgoState, other: EgoState) -> float:
    """Largest difference in any field, headings the short way round."""
    difference = np.array(astuple(one)) - np.array(astuple(other))
    difference[3] = wrap_angle(difference[3])
    return float(np.abs(difference).max())


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**31),
    steps=st.integers(1, 45),
    speed=st.sampled_from([0.0, 0.1, 3.0, 12.0]),
    heading=st.floats(-pi, pi),
)
def test_every_drive_is_what_following_its_plan_step_by_step_gives(
    seed: int, steps: int, speed: float, heading: float
) -> None:
    rng = np.random.default_rng(seed)
    start = EgoState(
        7.3, 400.0, -90.0, heading, vx_mps=speed, ax_mps2=0.4, tire_angle_rad=-0.05, tire_rate_radps=0.01,
        yaw_rate_radps=0.02, yaw_acceleration_radps2=0.03,
    )  # fmt: skip
    plans = wild_plans(rng, start, 3, steps, speed + 0.05)
    drives = follow_all(start, *plans)
    for n in range(len(drives)):
        state = start
        plan = Trajectory(7.3 + STEP_S * np.arange(steps + 1.0), *(column[n] for column in plans))
        assert apart(drives.state(n, 0), state) == 0.0
        for k in range(steps):
            state = follow(state, plan, STEP_S)
            assert apart(drives.state(n, k + 1), state) < 1e-9


def test_fewer_steps_are_the_beginning_of_the_same_drive() -> None:
    start = ego(speed_mps=8.0)
    plans = wild_plans(np.random.default_rng(1), start, 4, 30, 8.0)
    short, long = follow_all(start, *plans, steps=12), follow_all(start, *plans)
    assert short.x_m.shape == (4, 13)
    assert (short.vx_mps == long.vx_mps[:, :13]).all()


def test_drives_do_not_depend_on_their_company() -> None:
    start = ego(speed_mps=8.0)
    plans = wild_plans(np.random.default_rng(2), start, 5, 20, 8.0)
    x_m, y_m, heading_rad = (column[3:4] for column in plans)
    alone = follow_all(start, x_m, y_m, heading_rad)
    assert alone.y_m[0] == pytest.approx(follow_all(start, *plans).y_m[3], abs=1e-12)


def test_drives_cannot_be_changed() -> None:
    start = ego(speed_mps=8.0)
    drives = follow_all(start, *wild_plans(np.random.default_rng(3), start, 1, 5, 8.0))
    with pytest.raises(ValueError, match="read-only"):
        drives.x_m[0, 0] = 1.0


@pytest.mark.parametrize(("poses", "steps"), [(1, None), (11, 11), (11, -1)])
def test_plans_that_are_too_short_are_refused(poses: int, steps: int | None) -> None:
    nothing = np.zeros((2, poses))
    with pytest.raises(ValueError, match="cannot be followed"):
        follow_all(ego(), nothing, nothing, nothing, steps)
