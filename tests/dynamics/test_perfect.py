from __future__ import annotations

from math import atan, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import ego, straight_plan

from interplan_sumo.dynamics import lqr, perfect
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.trajectory import Trajectory


def test_the_ego_is_where_the_plan_says() -> None:
    plan = Trajectory(np.array([0.0, 0.5]), np.array([0.0, 5.0]), np.array([0.0, 1.0]), np.array([0.0, 0.2]))
    state = perfect.follow(ego(speed_mps=8.0), plan, 0.1)
    assert (state.time_s, state.x_m, state.y_m, state.heading_rad) == pytest.approx((0.1, 1.0, 0.2, 0.04))


def test_speed_and_acceleration_are_differences_over_the_step() -> None:
    plan = straight_plan(ego(speed_mps=10.0, heading_rad=1.0))
    state = perfect.follow(ego(speed_mps=9.0, heading_rad=1.0), plan, 0.1)
    assert (state.vx_mps, state.ax_mps2) == pytest.approx((10.0, 10.0))
    assert (state.yaw_rate_radps, state.tire_angle_rad) == pytest.approx((0.0, 0.0))


def test_backing_has_a_negative_speed() -> None:
    assert perfect.follow(ego(), straight_plan(ego(speed_mps=-2.0)), 0.1).vx_mps == pytest.approx(-2.0)


def test_on_a_circle_speed_and_tyres_are_those_of_the_bicycle() -> None:
    radius_m, speed_mps = 20.0, 5.0  # of the rear axle
    time_s = np.linspace(0.0, 0.2, 3)
    heading = speed_mps / radius_m * time_s
    d = PACIFICA.rear_axle_to_center_m
    x = radius_m * np.sin(heading) + d * np.cos(heading)
    y = radius_m * (1 - np.cos(heading)) + d * np.sin(heading)
    state = perfect.follow(ego(x[0], y[0], speed_mps), Trajectory(time_s, x, y, heading), 0.1)
    assert state.vx_mps == pytest.approx(speed_mps, rel=1e-4)
    assert state.yaw_rate_radps == pytest.approx(speed_mps / radius_m)
    assert state.tire_angle_rad == pytest.approx(atan(PACIFICA.wheelbase_m / radius_m), rel=1e-3)


@pytest.mark.parametrize(("speed", "angle"), [(0.04, 0.3), (0.06, 0.0)])
def test_a_standing_car_keeps_its_tyres_where_they_were(speed: float, angle: float) -> None:
    state = ego(speed_mps=speed)
    turned = type(state)(0.0, 0.0, 0.0, 0.0, vx_mps=speed, tire_angle_rad=0.3)
    assert perfect.follow(turned, straight_plan(state), 0.1).tire_angle_rad == pytest.approx(angle)


def test_the_turn_is_the_short_way_round() -> None:
    plan = Trajectory(np.array([0.0, 0.1]), np.zeros(2), np.zeros(2), np.array([pi - 0.01, -pi + 0.01]))
    assert perfect.follow(ego(heading_rad=pi - 0.01), plan, 0.1).yaw_rate_radps == pytest.approx(0.2)


def test_a_plan_too_short_for_the_step_is_refused() -> None:
    with pytest.raises(ValueError, match="outside the trajectory"):
        perfect.follow(ego(), straight_plan(ego(), horizon_s=0.05, step_s=0.05), 0.1)


@given(speed=st.floats(1.0, 20.0), heading=st.floats(-pi, pi))
def test_on_a_plan_that_holds_speed_both_trackers_agree(speed: float, heading: float) -> None:
    state = ego(10.0, -5.0, speed, heading)
    plan = straight_plan(state, horizon_s=8.0)
    one, two = perfect.follow(state, plan, 0.1), lqr.follow(state, plan, 0.1)
    assert (one.x_m, one.y_m, one.vx_mps) == pytest.approx((two.x_m, two.y_m, two.vx_mps), abs=1e-6)
