"""nuPlan's kinematic bicycle: how the ego's state answers to acceleration and steering."""

from __future__ import annotations

from math import atan2, cos, pi, sin, tan

from interplan_sumo.dynamics.rear_axle import center_of, rear_axle_of
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.geometry import wrap_angle

# nuPlan's motion model: first-order lags and the steering stop.
ACCELERATION_LAG_S = 0.2
STEERING_LAG_S = 0.05
MAX_TIRE_ANGLE_RAD = pi / 3
MAX_ACCELERATION_MPS2 = 9.0
"""What tyres hold on a dry road, along and across. nuPlan's model has no such bound; no stored case gets there."""


def step(
    state: EgoState, acceleration_mps2: float, tire_rate_radps: float, dt_s: float, shape: EgoShape = PACIFICA
) -> EgoState:
    """The state `dt_s` later under constant commands, by one explicit Euler step at the rear axle.

    Acceleration and tyre angle follow their commands with a lag, as far as
    `MAX_ACCELERATION_MPS2` allows. Position and heading advance with the old
    speed, heading and tyre angle. Speed is not kept from turning negative;
    heading is wrapped to [-pi, pi).
    """
    acceleration = state.ax_mps2 + dt_s / (dt_s + ACCELERATION_LAG_S) * (acceleration_mps2 - state.ax_mps2)
    acceleration = max(-MAX_ACCELERATION_MPS2, min(MAX_ACCELERATION_MPS2, acceleration))
    # The commanded angle is old + dt * rate, of which the lag lets a share pass.
    tire_rate = dt_s / (dt_s + STEERING_LAG_S) * tire_rate_radps

    speed, tire_angle, heading = state.vx_mps, state.tire_angle_rad, state.heading_rad
    rear_x, rear_y = rear_axle_of(state.x_m, state.y_m, heading, shape)
    rear_x += dt_s * speed * cos(heading)
    rear_y += dt_s * speed * sin(heading)
    heading = wrap_angle(heading + dt_s * speed * tan(tire_angle) / shape.wheelbase_m)
    speed += dt_s * acceleration
    most = min(MAX_TIRE_ANGLE_RAD, atan2(MAX_ACCELERATION_MPS2 * shape.wheelbase_m, speed * speed))
    tire_angle = max(-most, min(most, tire_angle + dt_s * tire_rate))
    yaw_rate = speed * tan(tire_angle) / shape.wheelbase_m

    x_m, y_m = center_of(rear_x, rear_y, heading, shape)
    return EgoState(
        time_s=round(state.time_s + dt_s, 6),
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading,
        vx_mps=speed,
        vy_mps=0.0,
        ax_mps2=acceleration,
        ay_mps2=0.0,
        tire_angle_rad=tire_angle,
        tire_rate_radps=tire_rate,
        yaw_rate_radps=yaw_rate,
        yaw_acceleration_radps2=(yaw_rate - state.yaw_rate_radps) / dt_s,
    )
