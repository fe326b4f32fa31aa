"""PDM-Open's inputs by hand, from any network's poses to a plan, and the errors of plans against what was driven."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given as any_of
from hypothesis import strategies as st
from tiny_dataset import empty_sample

from interplan_learned.driving import MOST_MPS, plan_through, without_leaps
from interplan_learned.pdm_open.planner import inputs
from interplan_sumo import tiny_worlds
from interplan_sumo.features.view import Arrays, EgoView
from tools.train.metrics import constant_velocity, plan_errors, wanted_poses


def arrays() -> Arrays:
    return empty_sample("ego_history", "route_centerline", "route_centerline_valid")


def ego_rows(given: Arrays, history_s: float = 2.0) -> np.ndarray:
    return inputs(given, history_s)["ego"].reshape(11, 9)


def test_the_past_is_every_second_frame_oldest_first() -> None:
    given = arrays()
    given["ego_history"][0, :, 0] = np.arange(-20, 1)
    np.testing.assert_array_equal(ego_rows(given)[:, 0], np.arange(-20, 1, 2))


def test_velocities_and_accelerations_are_the_bodys_own() -> None:
    given = arrays()
    given["ego_history"][0, 0, 2] = np.pi / 2  # two seconds ago it headed to the left of where it heads now,
    given["ego_history"][0, 0, 3:7] = (0.0, 8.0, -0.5, 2.0)  # drove that way, sped up, and turned left
    oldest = ego_rows(given)[0]
    np.testing.assert_allclose(oldest[2], np.pi / 2)
    np.testing.assert_allclose(oldest[3:5], (8.0, 0.0), atol=1e-6)
    np.testing.assert_allclose(oldest[6:8], (2.0, 0.5), atol=1e-6)


def test_yaw_acceleration_is_the_change_of_the_yaw_rate_since_the_row_before() -> None:
    given = arrays()
    given["ego_history"][0, 18, 7], given["ego_history"][0, 20, 7] = 0.1, 0.16
    rows = ego_rows(given)
    np.testing.assert_allclose(rows[9:, 5], (0.1, 0.16))
    np.testing.assert_allclose(rows[9:, 8], (0.5, 0.3), atol=1e-6)


def test_less_past_leaves_older_rows_empty() -> None:
    given = arrays()
    given["ego_history"][:] = 1.0
    assert np.flatnonzero(ego_rows(given, 0.4)[:, 0]).tolist() == [8, 9, 10]
    present = ego_rows(given, 0.0)
    assert np.flatnonzero(present.any(axis=1)).tolist() == [10]
    assert present[10, 5] == 1.0
    assert present[10, 8] == 0.0  # a difference would tell of the past


def test_the_line_stays_at_its_last_pose_where_it_has_ended_and_is_empty_without_a_route() -> None:
    given = arrays()
    given["route_centerline"][0, :3] = ((0.5, 1.0, 0.1), (1.5, 1.1, 0.1), (2.5, 1.2, 0.2))
    given["route_centerline_valid"][0, :3] = True
    line = inputs(given)["centerline"].reshape(120, 3)
    np.testing.assert_allclose(line[:3], given["route_centerline"][0, :3])
    np.testing.assert_allclose(line[3:], np.tile((2.5, 1.2, 0.2), (117, 1)), rtol=1e-6)
    assert not inputs(arrays())["centerline"].any()


def test_poses_in_the_ego_frame_become_a_plan_of_the_box_centre_in_the_map() -> None:
    roads = tiny_worlds.straight_road()
    view = EgoView(tiny_worlds.mission(roads, list(roads.lanes)))
    ego = tiny_worlds.ego(30.0, 1.0, 5.0, heading_rad=np.pi / 2, time_s=2.0)  # across the road
    ahead_m = view.mission.shape.rear_axle_to_center_m
    plan = plan_through(np.array(((3.0, 0.0, 0.0), (6.0, 2.0, np.pi / 2))), view, tiny_worlds.observation(ego))
    np.testing.assert_allclose(plan.time_s, (2.0, 2.5, 3.0))
    np.testing.assert_allclose(plan.x_m, (30.0, 30.0, 28.0 - ahead_m), atol=1e-9)
    np.testing.assert_allclose(plan.y_m, (1.0, 4.0, 7.0 - ahead_m), atol=1e-9)
    assert plan.heading_rad[-1] == pytest.approx(-np.pi)


def test_a_path_without_leaps_stays_as_it_is_and_after_a_shortened_one_all_moves_along() -> None:
    path = np.array([[0.0, 0.0, 0.0], [0.5 * MOST_MPS, 0.0, 0.1], [0.5 * MOST_MPS, 3.0, 0.2]])
    assert without_leaps(path, 0.5) is path
    path = np.array([[0.0, 0.0, 0.0], [0.0, 100.0, 0.1], [1.0, 102.0, 0.2]])
    found = without_leaps(path, 0.5)
    np.testing.assert_allclose(found, [[0.0, 0.0, 0.0], [0.0, 22.5, 0.1], [1.0, 24.5, 0.2]])


@any_of(st.integers(0, 2**32 - 1), st.sampled_from((0.1, 0.5)))
def test_whatever_a_network_says_no_step_is_faster_than_allowed(seed: int, step_s: float) -> None:
    path = np.random.default_rng(seed).normal(0.0, 40.0, (17, 3))
    found = without_leaps(path, step_s)
    assert np.hypot(*np.diff(found[:, :2], axis=0).T).max() < MOST_MPS * step_s + 1e-9
    np.testing.assert_array_equal(found[:, 2], path[:, 2])


def future(frames: int = 80) -> np.ndarray:
    """Straight on at 10 m/s, known for so many frames."""
    table = np.zeros((1, 80, 4), dtype=np.float32)
    table[0, :frames, 0] = np.arange(1, frames + 1)
    table[0, :frames, 3] = 1.0
    return table


def test_plans_and_constant_velocity_are_held_against_every_fifth_frame() -> None:
    wanted, valid = wanted_poses(future())
    np.testing.assert_array_equal(wanted[0, :, 0], np.arange(5.0, 81.0, 5.0))
    assert valid.all()
    history = np.zeros((1, 21, 10))
    history[0, -1, 3:5] = (10.0, 0.2)
    plans = constant_velocity(history)
    np.testing.assert_allclose(plans[0, 1], (10.0, 0.2, 0.0))
    assert plan_errors(plans, future())["fde_8_s"] == pytest.approx(1.6)


def test_errors_grow_with_the_horizon_headings_turn_the_short_way_and_undriven_steps_do_not_count() -> None:
    plans = wanted_poses(future())[0].astype(np.float64)
    plans[0, :, 1] += np.arange(1, 17)  # half a metre per second... per pose a metre
    plans[0, :, 2] += 2.0 * np.pi - 0.1
    errors = plan_errors(plans, future())
    assert errors["fde_3_s"] == pytest.approx(6.0)
    assert errors["ade_3_s"] == pytest.approx(3.5)
    assert errors["fde_8_s"] == pytest.approx(16.0)
    assert errors["heading_5_s"] == pytest.approx(0.1)
    plans = wanted_poses(future())[0].astype(np.float64)
    plans[0, 6:] += 100.0
    errors = plan_errors(plans, future(frames=30))
    assert errors["ade"] == 0.0
    assert errors["ade_3_s"] == 0.0
    assert np.isnan(errors["ade_5_s"])
