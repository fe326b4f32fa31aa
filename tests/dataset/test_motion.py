"""Motion: poses as the track of an ego, and which motions a car can have made."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.dataset.motion import MOST_MOVED_M, SMOOTHED_FRAMES, body, ego_track, roadworthy, rolled, smoothed
from interplan_sumo.dynamics.bicycle import step
from interplan_sumo.world.ego import PACIFICA, EgoState
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trace import EgoTrack

LANE_M = 3.5


def bicycle_drive(frames: int = 120) -> EgoTrack:
    """A drive of nuPlan's bicycle: it speeds up, turns left, then right, and brakes."""
    state = EgoState(0.0, 10.0, 20.0, 0.3, vx_mps=6.0)
    states = [state]
    for k in range(frames - 1):
        push = 1.0 if k < 40 else 0.0 if k < 80 else -1.5
        turn = 0.08 if 20 <= k < 30 else -0.08 if 50 <= k < 65 else 0.0
        states.append(state := step(state, push, turn, 0.1))
    return EgoTrack.of(states)


def poses_of(track: EgoTrack) -> Floats:
    return np.stack((track.x_m, track.y_m, track.heading_rad), axis=1)


def along(x_m: Floats, y_m: Floats | None = None) -> Floats:
    return np.stack((x_m, np.zeros_like(x_m) if y_m is None else y_m, np.zeros_like(x_m)), axis=1)


def steady(speed_mps: float, frames: int = 120) -> Floats:
    return 0.1 * speed_mps * np.arange(frames, dtype=np.float64)


def lane_change(lateral_mps: float = LANE_M / 3.0, speed_mps: float = 12.0) -> Floats:
    """(120, 3) as SUMO draws it: sideways at one speed from one step to the next, the heading that of the lane."""
    y_m = np.clip(0.1 * lateral_mps * (np.arange(120) - 40), 0.0, LANE_M).astype(np.float64)
    return along(steady(speed_mps), y_m)


def test_dynamics_told_from_poses_are_those_that_made_them() -> None:
    track = bicycle_drive()
    found = ego_track(track.time_us, poses_of(track), PACIFICA)
    inner = slice(1, -1)  # the first frame has no past, the last no future
    for name in ("x_m", "y_m", "heading_rad", "vx_mps", "vy_mps", "ay_mps2", "yaw_rate_radps", "tire_angle_rad"):
        np.testing.assert_allclose(getattr(found, name)[inner], getattr(track, name)[inner], atol=1e-6, err_msg=name)
    np.testing.assert_allclose(found.ax_mps2[inner], track.ax_mps2[inner], atol=1e-6)
    np.testing.assert_allclose(found.yaw_acceleration_radps2[2:-1], track.yaw_acceleration_radps2[2:-1], atol=1e-5)
    assert (found.time_us == track.time_us).all()


def test_who_stands_holds_the_wheel() -> None:
    poses = np.concatenate((poses_of(bicycle_drive(30)), np.repeat(poses_of(bicycle_drive(30))[-1:], 20, axis=0)))
    found = ego_track(np.arange(50) * 100_000, poses, PACIFICA)
    assert found.tire_angle_rad[40] == found.tire_angle_rad[29 - 1]
    assert (found.vx_mps[31:] == 0.0).all()


def test_a_single_frame_stands_still() -> None:
    found = ego_track(np.zeros(1, dtype=np.int64), np.zeros((1, 3)), PACIFICA)
    assert (found.vx_mps[0], found.ax_mps2[0], found.yaw_rate_radps[0]) == (0.0, 0.0, 0.0)


def test_a_body_has_the_proportions_of_nuplans_ego() -> None:
    assert body(PACIFICA.length_m, PACIFICA.width_m) == PACIFICA
    half = body(PACIFICA.length_m / 2.0, 1.0)
    assert half.wheelbase_m == pytest.approx(PACIFICA.wheelbase_m / 2.0)
    assert half.width_m == 1.0


def test_a_body_led_through_the_places_of_a_bicycle_turns_as_the_bicycle_did() -> None:
    track = bicycle_drive()
    found = rolled(poses_of(track)[:, :2], float(track.heading_rad[0]), PACIFICA)
    np.testing.assert_allclose(found, track.heading_rad, atol=1e-9)


def test_the_rear_axle_of_a_rolled_body_never_slides() -> None:
    places = smoothed(lane_change()[:, :2])
    heading = rolled(places, 0.0, PACIFICA)
    track = ego_track(np.arange(120) * 100_000, np.column_stack((places, heading)), PACIFICA)
    x_m, y_m = track.rear_axle(PACIFICA)
    sideways = -np.diff(x_m) * np.sin(heading[:-1]) + np.diff(y_m) * np.cos(heading[:-1])
    assert np.abs(sideways).max() < 1e-9


def test_smoothing_leaves_steady_and_braking_cars_where_they_were() -> None:
    braking = 12.0 * 0.1 * np.arange(60) - 0.5 * 1.5 * (0.1 * np.arange(60)) ** 2
    for x_m in (steady(12.0), braking):
        np.testing.assert_allclose(smoothed(along(x_m)[:, :2]), along(x_m)[:, :2], atol=1e-6)


def test_a_car_that_is_there_for_less_than_the_window_is_left_alone() -> None:
    places = lane_change()[: SMOOTHED_FRAMES - 1, :2]
    assert smoothed(places) is places
    assert smoothed(lane_change()[30 : 30 + SMOOTHED_FRAMES, :2]) is not places


def test_the_kinks_of_a_lane_change_are_rounded_and_it_takes_as_long() -> None:
    recorded = lane_change()
    places = smoothed(recorded[:, :2])
    lateral_mps2 = np.diff(places[:, 1], 2) / 0.01
    assert np.abs(np.diff(recorded[:, 1], 2) / 0.01).max() > 10.0
    assert np.abs(lateral_mps2).max() < 2.5
    assert np.abs(places - recorded[:, :2]).max() < MOST_MOVED_M
    np.testing.assert_allclose(places[[20, 110], 1], recorded[[20, 110], 1], atol=1e-9)


def judged(recorded: Floats) -> tuple[EgoTrack, np.ndarray]:
    places = smoothed(recorded[:, :2])
    poses = np.column_stack((places, rolled(places, float(recorded[0, 2]), PACIFICA)))
    track = ego_track(np.arange(len(poses)) * 100_000, poses, PACIFICA)
    return track, roadworthy(track, recorded)


def test_a_smooth_drive_and_a_usual_lane_change_are_roadworthy() -> None:
    assert judged(poses_of(bicycle_drive()))[1].all()
    assert judged(lane_change())[1].all()


def test_a_hop_to_the_next_lane_is_not_roadworthy_and_the_rest_of_the_drive_is() -> None:
    y_m = np.where(np.arange(120) < 60, 0.0, LANE_M)
    good = judged(along(steady(12.0), y_m))[1]
    assert not good[55:65].any()
    assert good[:50].all()


@pytest.mark.parametrize(("hop_m", "fine"), [(0.25, True), (0.8, False)])
def test_a_small_correction_is_no_hop(hop_m: float, fine: bool) -> None:
    recorded = along(steady(12.0), np.where(np.arange(120) < 60, 0.0, hop_m))
    assert judged(recorded)[1].all() == fine


@pytest.mark.parametrize(
    ("left_m", "turned_rad", "fine"),
    [(MOST_MOVED_M - 0.001, 0.0, True), (MOST_MOVED_M + 0.001, 0.0, False), (0.0, 0.299, True), (0.0, 0.301, False)],
)
def test_a_place_or_heading_too_far_from_the_recorded_one_is_a_hop(
    left_m: float, turned_rad: float, fine: bool
) -> None:
    poses = along(steady(10.0))
    track = ego_track(np.arange(120) * 100_000, poses, PACIFICA)
    assert roadworthy(track, poses + np.array((0.0, left_m, turned_rad))).all() == fine


@pytest.mark.parametrize(("braking_mps2", "fine"), [(4.0, True), (4.1, False)])
def test_braking_beyond_comfort_is_not_roadworthy(braking_mps2: float, fine: bool) -> None:
    time_s = 0.1 * np.arange(40)
    poses = along(20.0 * time_s - braking_mps2 * time_s**2 / 2.0)
    track = ego_track(np.arange(40) * 100_000, poses, PACIFICA)
    assert roadworthy(track, poses)[1:-1].all() == fine


@pytest.mark.parametrize(("lateral_mps2", "fine"), [(4.8, True), (5.0, False)])
def test_a_bend_taken_too_fast_is_not_roadworthy(lateral_mps2: float, fine: bool) -> None:
    speed_mps = 15.0
    radius_m = speed_mps**2 / lateral_mps2
    angle = speed_mps * 0.1 * np.arange(50) / radius_m
    poses = np.stack((radius_m * np.sin(angle), radius_m * (1.0 - np.cos(angle)), angle), axis=1)
    rear = poses - PACIFICA.rear_axle_to_center_m * np.stack((-np.cos(angle), -np.sin(angle), 0 * angle), axis=1)
    track = ego_track(np.arange(50) * 100_000, rear, PACIFICA)  # the rear axle on the circle
    assert roadworthy(track, rear).all() == fine
