"""A perfect tracker: the ego is wherever its plan says."""

from __future__ import annotations

from math import atan, cos, sin

from interplan_sumo.dynamics.bicycle import MAX_TIRE_ANGLE_RAD
from interplan_sumo.dynamics.rear_axle import rear_axle_of
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.trajectory import Trajectory

STANDING_MPS = 0.05
"""Below this speed a turn says nothing about the tyres; they stay as they were."""


def follow(state: EgoState, plan: Trajectory, dt_s: float, shape: EgoShape = PACIFICA) -> EgoState:
    """The ego at the plan's pose `dt_s` from now; ValueError if the plan does not reach that far.

    The plan's speeds are ignored. Dynamics are backward differences over the
    step: speed is the rear axle's displacement along the mean heading
    (negative when backing), acceleration and yaw acceleration the change of
    speed and yaw rate, the tyre angle that of a bicycle with this speed and yaw
    rate. Lateral speed and acceleration of the rear axle are 0, as in the
    bicycle model, even if the plan moves sideways.
    """
    time_s = round(state.time_s + dt_s, 6)
    pose = plan.at(time_s)
    turn_rad = wrap_angle(pose.heading_rad - state.heading_rad)
    mean_heading = state.heading_rad + turn_rad / 2
    old_x, old_y = rear_axle_of(state.x_m, state.y_m, state.heading_rad, shape)
    new_x, new_y = rear_axle_of(pose.x_m, pose.y_m, pose.heading_rad, shape)
    speed = ((new_x - old_x) * cos(mean_heading) + (new_y - old_y) * sin(mean_heading)) / dt_s
    yaw_rate = turn_rad / dt_s
    if abs(speed) > STANDING_MPS:
        tire_angle = atan(shape.wheelbase_m * yaw_rate / speed)
        tire_angle = max(-MAX_TIRE_ANGLE_RAD, min(MAX_TIRE_ANGLE_RAD, tire_angle))
    else:
        tire_angle = state.tire_angle_rad
    return EgoState(
        time_s=time_s,
        x_m=pose.x_m,
        y_m=pose.y_m,
        heading_rad=pose.heading_rad,
        vx_mps=speed,
        ax_mps2=(speed - state.vx_mps) / dt_s,
        tire_angle_rad=tire_angle,
        tire_rate_radps=(tire_angle - state.tire_angle_rad) / dt_s,
        yaw_rate_radps=yaw_rate,
        yaw_acceleration_radps2=(yaw_rate - state.yaw_rate_radps) / dt_s,
    )
