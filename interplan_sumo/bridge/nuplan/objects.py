"""Egos, actors, signals and plans as objects of nuPlan's devkit, and back."""

from __future__ import annotations

from collections.abc import Iterable
from math import nan
from typing import Any

import numpy as np
from nuplan.common.actor_state.agent import Agent
from nuplan.common.actor_state.car_footprint import CarFootprint
from nuplan.common.actor_state.dynamic_car_state import DynamicCarState
from nuplan.common.actor_state.ego_state import EgoState as NuPlanEgoState
from nuplan.common.actor_state.oriented_box import OrientedBox
from nuplan.common.actor_state.scene_object import SceneObjectMetadata
from nuplan.common.actor_state.state_representation import StateSE2, StateVector2D, TimePoint
from nuplan.common.actor_state.static_object import StaticObject
from nuplan.common.actor_state.tracked_objects import TrackedObjects
from nuplan.common.actor_state.tracked_objects_types import TrackedObjectType
from nuplan.common.actor_state.vehicle_parameters import VehicleParameters, get_pacifica_parameters
from nuplan.common.maps.maps_datatypes import TrafficLightStatusData, TrafficLightStatusType
from nuplan.planning.simulation.observation.observation_type import DetectionsTracks
from nuplan.planning.simulation.trajectory.interpolated_trajectory import InterpolatedTrajectory

from interplan_sumo.bridge.nuplan.frames import START_US, center_trajectory, grid_us, rear_axle_rows, sorted_rows
from interplan_sumo.errors import PlannerError
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.signals import Signals
from interplan_sumo.world.trajectory import Trajectory

_TYPES = tuple(TrackedObjectType(int(kind)) for kind in ActorKind)
_HEIGHTS_M = (1.6, 1.75, 1.75, 0.75, 1.0, 1.5, 1.0)
"""Per `ActorKind`: our actors are flat, nuPlan's boxes are not; no planner drives under or over them."""
_PACIFICA_COG_SHARE = 1.67 / 3.089
"""nuPlan's Pacifica: its centre of gravity lies this share of the wheelbase ahead of the rear axle."""

# --- the ego -------------------------------------------------------------------------------------


def vehicle_parameters(shape: EgoShape) -> VehicleParameters:
    """A vehicle body as nuPlan describes it; for the usual one nuPlan's own."""
    if shape == PACIFICA:
        return get_pacifica_parameters()
    return VehicleParameters(
        width=shape.width_m,
        front_length=shape.front_m,
        rear_length=shape.length_m - shape.front_m,
        cog_position_from_rear_axle=_PACIFICA_COG_SHARE * shape.wheelbase_m,
        wheel_base=shape.wheelbase_m,
        vehicle_name="custom",
        vehicle_type="custom",
        height=shape.height_m,
    )


def shape_of(vehicle: VehicleParameters) -> EgoShape:
    """The way back: nuPlan's vehicle body as ours."""
    usual = get_pacifica_parameters()
    if hash(vehicle) == hash(usual):
        return PACIFICA
    return EgoShape(
        length_m=vehicle.length,
        width_m=vehicle.width,
        height_m=usual.height if vehicle.height is None else vehicle.height,
        wheelbase_m=vehicle.wheel_base,
        rear_axle_to_center_m=vehicle.rear_axle_to_center,
    )


def nuplan_ego(ego: EgoState, time_us: int, vehicle: VehicleParameters) -> NuPlanEgoState:
    """An ego state at nuPlan's time: the same box centre, the same dynamics of the rear axle."""
    return NuPlanEgoState(
        car_footprint=CarFootprint(StateSE2(ego.x_m, ego.y_m, ego.heading_rad), vehicle),
        dynamic_car_state=DynamicCarState(
            rear_axle_to_center_dist=vehicle.rear_axle_to_center,
            rear_axle_velocity_2d=StateVector2D(ego.vx_mps, ego.vy_mps),
            rear_axle_acceleration_2d=StateVector2D(ego.ax_mps2, ego.ay_mps2),
            angular_velocity=ego.yaw_rate_radps,
            angular_acceleration=ego.yaw_acceleration_radps2,
            tire_steering_rate=ego.tire_rate_radps,
        ),
        tire_steering_angle=ego.tire_angle_rad,
        is_in_auto_mode=True,
        time_point=TimePoint(time_us),
    )


def our_ego(state: NuPlanEgoState, start_us: int = START_US) -> EgoState:
    """The way back; `start_us` is the time that becomes 0 s."""
    center, dynamics = state.center, state.dynamic_car_state
    velocity, acceleration = dynamics.rear_axle_velocity_2d, dynamics.rear_axle_acceleration_2d
    return EgoState(
        time_s=(state.time_us - start_us) * 1e-6,
        x_m=center.x,
        y_m=center.y,
        heading_rad=center.heading,
        vx_mps=velocity.x,
        vy_mps=velocity.y,
        ax_mps2=acceleration.x,
        ay_mps2=acceleration.y,
        tire_angle_rad=state.tire_steering_angle,
        tire_rate_radps=dynamics.tire_steering_rate,
        yaw_rate_radps=dynamics.angular_velocity,
        yaw_acceleration_radps2=dynamics.angular_acceleration,
    )


# --- everybody else ------------------------------------------------------------------------------


def nuplan_tracks(actors: Actors, time_us: int, numbers: dict[str, int]) -> DetectionsTracks:
    """Actors as tracked objects: agents with their velocity, static objects without.

    `numbers` gives every id the number that nuPlan's tracks have besides their
    token, the same through an episode; new ids are added.
    """
    rows = zip(
        actors.ids,
        actors.kind.tolist(),
        actors.x_m.tolist(),
        actors.y_m.tolist(),
        actors.heading_rad.tolist(),
        actors.length_m.tolist(),
        actors.width_m.tolist(),
        actors.vx_mps.tolist(),
        actors.vy_mps.tolist(),
        strict=True,
    )
    objects: list[Agent | StaticObject] = []
    for id_, kind, x_m, y_m, heading_rad, length_m, width_m, vx_mps, vy_mps in rows:
        track = _TYPES[kind]
        number = numbers.setdefault(id_, len(numbers))
        metadata = SceneObjectMetadata(time_us, f"{id_}@{time_us}", number, id_, track.fullname)
        box = OrientedBox(StateSE2(x_m, y_m, heading_rad), length_m, width_m, _HEIGHTS_M[kind])
        if kind <= ActorKind.BICYCLE:
            # nuPlan's logs know no yaw rates of agents either: not a number, as its database hands them over.
            objects.append(Agent(track, box, StateVector2D(vx_mps, vy_mps), metadata, angular_velocity=nan))
        else:
            objects.append(StaticObject(track, box, metadata))
    return DetectionsTracks(TrackedObjects(objects))


def our_actors(tracks: DetectionsTracks) -> Actors:
    """The way back: tracked objects by their track token, the ego left out."""
    objects = [each for each in tracks.tracked_objects.tracked_objects if each.tracked_object_type.value < len(_TYPES)]
    ids = [str(each.track_token or each.token) for each in objects]
    rows = sorted_rows(ids)
    numbers = np.array([_numbers(objects[row]) for row in rows]).reshape(len(rows), 7)
    kinds = np.array([objects[row].tracked_object_type.value for row in rows], dtype=np.int8)
    return Actors(tuple(ids[row] for row in rows), kinds, *numbers.T)


def _numbers(track: Any) -> tuple[float, ...]:
    center, box, velocity = track.center, track.box, track.velocity
    return center.x, center.y, center.heading, box.length, box.width, velocity.x, velocity.y


def nuplan_lights(signals: Signals, time_us: int) -> list[TrafficLightStatusData]:
    """What every connector under a traffic light shows."""
    shown = zip(signals.connector_ids, signals.status.tolist(), strict=True)
    return [TrafficLightStatusData(TrafficLightStatusType(status), int(id_), time_us) for id_, status in shown]


def our_signals(lights: Iterable[TrafficLightStatusData] | None) -> Signals:
    """The way back; of several states of one connector the last holds."""
    shown = {str(light.lane_connector_id): int(light.status.value) for light in lights or ()}
    ids = sorted(shown)
    return Signals(tuple(ids), np.array([shown[id_] for id_ in ids], dtype=np.int8))


# --- plans ---------------------------------------------------------------------------------------


def our_plan(trajectory: Any, shape: EgoShape) -> Trajectory:
    """A trajectory of nuPlan's at the instants at which nuPlan's controller would look at it.

    PlannerError if its states are not those of an ego.
    """
    start_us, end_us = trajectory.start_time.time_us, trajectory.end_time.time_us
    times = grid_us(start_us, end_us).tolist()
    states = trajectory.get_sampled_trajectory()
    if [state.time_point.time_us for state in states] != times:
        states = trajectory.get_state_at_times([TimePoint(time) for time in times])
    if not isinstance(states[0], NuPlanEgoState):
        raise PlannerError(f"the trajectory holds objects of type {type(states[0]).__name__}, expected EgoState")
    rows = [
        (s.time_us, axle.x, axle.y, axle.heading, s.dynamic_car_state.rear_axle_velocity_2d.x)
        for s in states
        for axle in (s.rear_axle,)
    ]
    return center_trajectory(np.array(rows, dtype=np.float64), shape)


def nuplan_plan(plan: Trajectory, vehicle: VehicleParameters, start_us: int = START_US) -> InterpolatedTrajectory:
    """A plan of ours as a trajectory of ego states; `start_us` is the time of 0 s.

    Ours have no acceleration, yaw rate or tyre angle: these are 0 in it.
    """
    rows = rear_axle_rows(plan, shape_of(vehicle), start_us).tolist()
    return InterpolatedTrajectory(
        [
            NuPlanEgoState.build_from_rear_axle(
                rear_axle_pose=StateSE2(x_m, y_m, heading_rad),
                rear_axle_velocity_2d=StateVector2D(speed_mps, 0.0),
                rear_axle_acceleration_2d=StateVector2D(0.0, 0.0),
                tire_steering_angle=0.0,
                time_point=TimePoint(int(time_us)),
                vehicle_parameters=vehicle,
            )
            for time_us, x_m, y_m, heading_rad, speed_mps in rows
        ]
    )
