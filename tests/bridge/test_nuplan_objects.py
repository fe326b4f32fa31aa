"""Our nouns as nuPlan's objects and back, with the devkit's own classes."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest
from devkit import devkit
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.bridge.nuplan.frames import START_US
from interplan_sumo.errors import PlannerError
from interplan_sumo.tiny_worlds import cars, pedestrians, signals, straight_plan, together
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.geometry import wrap_angle
from interplan_sumo.world.trajectory import Trajectory

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")

EGO = EgoState(0.3, 331_000.25, 4_690_000.75, 2.5, 7.0, 0.1, 1.5, -0.2, 0.05, 0.01, 0.11, -0.3)
OTHER = EgoShape(length_m=4.5, width_m=1.8, height_m=1.5, wheelbase_m=2.7, rear_axle_to_center_m=1.3)


@pytest.fixture(scope="module")
def objects() -> ModuleType:
    return devkit("interplan_sumo.bridge.nuplan.objects")


@pytest.mark.parametrize("shape", [PACIFICA, OTHER])
def test_an_ego_keeps_its_centre_and_its_dynamics(objects: Any, shape: EgoShape) -> None:
    vehicle = objects.vehicle_parameters(shape)
    state = objects.nuplan_ego(EGO, START_US + 300_000, vehicle)
    axle = EGO.rear_axle(shape)
    assert (state.rear_axle.x, state.rear_axle.y) == pytest.approx((axle.x_m, axle.y_m), abs=1e-9)
    corners = np.array([(c.x, c.y) for c in state.car_footprint.all_corners()])
    np.testing.assert_allclose(corners, EGO.corners(shape), rtol=0, atol=1e-8)
    assert state.dynamic_car_state.speed == pytest.approx(np.hypot(7.0, 0.1))
    back = objects.our_ego(state)
    for name in EgoState.__slots__:
        assert getattr(back, name) == pytest.approx(getattr(EGO, name), abs=1e-12), name


def test_the_usual_car_is_nuplans_own_and_any_other_comes_back_as_it_was(objects: Any) -> None:
    assert objects.shape_of(objects.vehicle_parameters(PACIFICA)) is PACIFICA
    back = objects.shape_of(objects.vehicle_parameters(OTHER))
    for name in EgoShape.__slots__:
        assert getattr(back, name) == pytest.approx(getattr(OTHER, name), abs=1e-12), name


def test_every_kind_of_actor_comes_back_as_it_was_and_static_ones_stand(objects: Any) -> None:
    moving = together(cars((1.0, 2.0, 3.0, 0.5), (9.0, 9.0)), pedestrians((5.0, -2.0, 1.0)))
    static = together(*(cars((k, 0.0), kind=ActorKind(k), prefix=f"thing{k}") for k in range(3, 7)))
    actors = together(moving, static)
    assert len(objects.our_actors(objects.nuplan_tracks(Actors.none(), START_US, {}))) == 0
    tracks = objects.nuplan_tracks(actors, START_US, {})
    kinds = [each.tracked_object_type.value for each in tracks.tracked_objects]
    assert kinds == sorted(actors.kind.tolist())
    for each in tracks.tracked_objects.get_static_objects():
        assert (each.velocity.x, each.velocity.y) == (0.0, 0.0)
    back = objects.our_actors(tracks)
    assert back.ids == actors.ids
    for name in ("kind", "x_m", "y_m", "heading_rad", "length_m", "width_m", "vx_mps", "vy_mps"):
        np.testing.assert_array_equal(getattr(back, name), getattr(actors, name), err_msg=name)


def test_a_track_keeps_its_token_and_number_and_no_two_samples_share_a_token(objects: Any) -> None:
    numbers: dict[str, int] = {}
    first = objects.nuplan_tracks(cars((1.0, 0.0), (2.0, 0.0)), START_US, numbers).tracked_objects.tracked_objects
    second = objects.nuplan_tracks(cars((1.0, 0.0), (2.0, 0.0)), START_US + 1, numbers).tracked_objects.tracked_objects
    assert [each.track_token for each in first] == [each.track_token for each in second] == ["car00", "car01"]
    assert [each.metadata.track_id for each in first] == [each.metadata.track_id for each in second] == [0, 1]
    assert len({each.token for each in (*first, *second)}) == 4


def test_lights_come_back_as_they_were(objects: Any) -> None:
    shown = signals(red=["7"], green=["12", "3"])
    back = objects.our_signals(objects.nuplan_lights(shown, START_US))
    assert dict(zip(back.connector_ids, back.status.tolist(), strict=True)) == dict(
        zip(shown.connector_ids, shown.status.tolist(), strict=True)
    )
    assert len(objects.our_signals(None)) == 0


def test_a_plan_with_a_pose_every_tenth_of_a_second_is_taken_as_it_is(objects: Any) -> None:
    plan = straight_plan(EGO, 8.0, 0.1)
    back = objects.our_plan(objects.nuplan_plan(plan, objects.vehicle_parameters(PACIFICA)), PACIFICA)
    for name in ("time_s", "x_m", "y_m", "heading_rad"):
        np.testing.assert_allclose(getattr(back, name), getattr(plan, name), rtol=0, atol=1e-8, err_msg=name)


@settings(max_examples=25)
@given(turn=st.floats(-1.5, 1.5), step_m=st.floats(0.5, 5.0))
def test_a_coarse_plan_is_interpolated_at_the_rear_axle_as_nuplans_controller_does(turn: float, step_m: float) -> None:
    objects = devkit("interplan_sumo.bridge.nuplan.objects")
    heading = 2.8 + np.array((0.0, turn, 2 * turn))
    plan = Trajectory(np.array((0.0, 0.5, 1.0)), np.cumsum(step_m * np.cos(heading)), np.zeros(3), heading)
    sampled = objects.our_plan(objects.nuplan_plan(plan, objects.vehicle_parameters(PACIFICA)), PACIFICA)
    assert len(sampled) == 11
    d = PACIFICA.rear_axle_to_center_m
    coarse = plan.x_m - d * np.cos(heading)
    fine = sampled.x_m - d * np.cos(sampled.heading_rad)
    np.testing.assert_allclose(fine, np.interp(sampled.time_s, plan.time_s, coarse), rtol=0, atol=1e-8)
    expected = np.interp(sampled.time_s, plan.time_s, heading)
    np.testing.assert_allclose(wrap_angle(sampled.heading_rad - expected), 0.0, rtol=0, atol=1e-8)


def test_a_trajectory_of_other_objects_is_the_planners_fault(objects: Any) -> None:
    state = objects.nuplan_ego(EGO, START_US, objects.vehicle_parameters(PACIFICA))
    later = objects.nuplan_ego(EGO, START_US + 100_000, objects.vehicle_parameters(PACIFICA))
    trajectory = objects.InterpolatedTrajectory([state.waypoint, later.waypoint])
    with pytest.raises(PlannerError, match="objects of type Waypoint, expected EgoState"):
        objects.our_plan(trajectory, PACIFICA)
