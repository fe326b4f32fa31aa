from __future__ import annotations

from dataclasses import replace
from math import cos, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import ego

from interplan_sumo.dynamics import bicycle
from interplan_sumo.dynamics.rear_axle import center_of, rear_axle_of, rear_axles_of
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.geometry import wrap_angle

moderate = st.floats(-1.0, 1.0)
states = st.builds(
    EgoState,
    time_s=st.just(0.0),
    x_m=st.floats(-1e3, 1e3),
    y_m=st.floats(-1e3, 1e3),
    heading_rad=st.floats(-pi, pi - 1e-9),
    vx_mps=st.floats(-5.0, 30.0),
    ax_mps2=st.floats(-5.0, 5.0),
    tire_angle_rad=moderate,
    yaw_rate_radps=moderate,
)


def rear_axle_at(x_m: float, y_m: float, heading_rad: float = 0.0, **dynamics: float) -> EgoState:
    centre = center_of(x_m, y_m, heading_rad, PACIFICA)
    return EgoState(0.0, *centre, heading_rad, **dynamics)


def turned(state: EgoState, angle_rad: float, dx_m: float, dy_m: float) -> EgoState:
    c, s = cos(angle_rad), sin(angle_rad)
    return replace(
        state,
        x_m=c * state.x_m - s * state.y_m + dx_m,
        y_m=s * state.x_m + c * state.y_m + dy_m,
        heading_rad=wrap_angle(state.heading_rad + angle_rad),
    )


def test_the_acceleration_lags_by_a_third_and_the_tyres_by_two_thirds_of_a_step() -> None:
    state = bicycle.step(ego(speed_mps=10.0), 3.0, 0.3, 0.1)
    assert state.ax_mps2 == pytest.approx(1.0)
    assert state.tire_rate_radps == pytest.approx(0.2)


def test_position_and_heading_advance_with_the_old_speed_and_tyre_angle() -> None:
    state = bicycle.step(rear_axle_at(5.0, 2.0, vx_mps=8.0), 3.0, 1.0, 0.1)
    rear = state.rear_axle(PACIFICA)
    assert (rear.x_m, rear.y_m, state.heading_rad) == pytest.approx((5.8, 2.0, 0.0))


def test_the_car_turns_about_its_rear_axle_so_that_the_centre_swings_out() -> None:
    state = bicycle.step(rear_axle_at(0.0, 0.0, vx_mps=10.0, tire_angle_rad=0.2), 0.0, 0.0, 0.1)
    assert state.rear_axle(PACIFICA).y_m == pytest.approx(0.0, abs=1e-12)
    assert state.y_m == pytest.approx(PACIFICA.rear_axle_to_center_m * sin(state.heading_rad))


@pytest.mark.parametrize(("rate", "angle"), [(0.6, 1.04), (0.8, pi / 3), (-0.6, -1.04), (-0.8, -pi / 3)])
def test_the_tyres_stop_at_sixty_degrees(rate: float, angle: float) -> None:
    start = replace(ego(), tire_angle_rad=1.0 if rate > 0 else -1.0)
    assert bicycle.step(start, 0.0, rate, 0.1).tire_angle_rad == pytest.approx(angle)


@pytest.mark.parametrize(("command", "reached"), [(26.0, 26.0 / 3.0), (30.0, 9.0), (-30.0, -9.0)])
def test_no_command_takes_more_than_tyres_hold_along(command: float, reached: float) -> None:
    assert bicycle.step(ego(speed_mps=10.0), command, 0.0, 0.1).ax_mps2 == pytest.approx(reached)


@pytest.mark.parametrize(("turned_rad", "held"), [(0.06, True), (0.08, False), (-0.08, False)])
def test_nor_across(turned_rad: float, held: bool) -> None:
    state = bicycle.step(replace(ego(speed_mps=20.0), tire_angle_rad=turned_rad), 0.0, 0.0, 0.1)
    across_mps2 = abs(state.yaw_rate_radps) * state.vx_mps
    assert (state.tire_angle_rad == turned_rad) is held
    assert across_mps2 == pytest.approx(9.0) if not held else across_mps2 < 9.0


def test_braking_past_a_standstill_rolls_backwards() -> None:
    assert bicycle.step(replace(ego(speed_mps=0.1), ax_mps2=-3.0), -3.0, 0.0, 0.1).vx_mps == pytest.approx(-0.2)


def test_the_heading_wraps_at_pi() -> None:
    state = bicycle.step(replace(ego(speed_mps=10.0, heading_rad=pi - 0.01), tire_angle_rad=0.2), 0.0, 0.0, 0.1)
    assert -pi <= state.heading_rad < -pi + 0.1


@given(state=states, push=moderate, rate=moderate, angle=st.floats(-pi, pi), dx=st.floats(-1e3, 1e3), dy=moderate)
def test_moving_the_world_moves_the_drive(
    state: EgoState, push: float, rate: float, angle: float, dx: float, dy: float
) -> None:
    there = bicycle.step(turned(state, angle, dx, dy), push, rate, 0.1)
    here = turned(bicycle.step(state, push, rate, 0.1), angle, dx, dy)
    assert (there.x_m, there.y_m) == pytest.approx((here.x_m, here.y_m), abs=1e-8)
    assert wrap_angle(there.heading_rad - here.heading_rad) == pytest.approx(0.0, abs=1e-9)
    assert there.vx_mps == here.vx_mps
    assert there.tire_angle_rad == here.tire_angle_rad


@given(state=states, push=moderate, rate=moderate)
def test_left_is_the_mirror_of_right(state: EgoState, push: float, rate: float) -> None:
    mirrored = replace(
        state, y_m=-state.y_m, heading_rad=-state.heading_rad, tire_angle_rad=-state.tire_angle_rad,
        yaw_rate_radps=-state.yaw_rate_radps,
    )  # fmt: skip
    one, two = bicycle.step(state, push, rate, 0.1), bicycle.step(mirrored, push, -rate, 0.1)
    assert (one.x_m, one.y_m) == pytest.approx((two.x_m, -two.y_m), abs=1e-9)
    assert one.yaw_acceleration_radps2 == pytest.approx(-two.yaw_acceleration_radps2)


@given(x=st.floats(-1e6, 1e6), y=st.floats(-1e6, 1e6), heading=st.floats(-10.0, 10.0))
def test_centre_and_rear_axle_convert_both_ways(x: float, y: float, heading: float) -> None:
    shape = EgoShape(4.0, 2.0, 1.5, 2.5, 1.2)
    rear = rear_axle_of(x, y, heading, shape)
    assert center_of(*rear, heading, shape) == pytest.approx((x, y), abs=1e-8)
    many = rear_axles_of(np.array([x]), np.array([y]), np.array([heading]), shape)
    assert (many[0][0], many[1][0]) == pytest.approx(rear, abs=1e-8)
