from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds import curved_road

from interplan_planners.common.paths import (
    DrivingPath,
    center_poses,
    lane_change_path,
    quintic_offset,
    rear_axle_plan,
    shifted,
)
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Polyline, Pose
from tests.planners.staging_planners import wavy_line

LINE = wavy_line()
PATH = DrivingPath(LINE)
STRAIGHT = Polyline(np.array(((0.0, 0.0), (200.0, 0.0)))).resampled(1.0)


@given(seed=st.integers(0, 2**31))
def test_the_quick_projection_is_the_exact_one_near_the_line(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = LINE.poses_at(rng.uniform(0.0, LINE.length_m, 200))[:, :2] + rng.uniform(-5.0, 5.0, (200, 2))
    arc_m, left_m = PATH.project(points[:, 0], points[:, 1])
    exact_arc_m, exact_left_m = LINE.project(points)
    assert arc_m == pytest.approx(exact_arc_m, abs=1e-9)
    assert left_m == pytest.approx(exact_left_m, abs=1e-9)


def test_beyond_the_ends_a_projection_stops_there() -> None:
    line = Polyline(np.array(((0.0, 0.0), (200.0, 0.0))))
    for path in (DrivingPath(STRAIGHT), DrivingPath(line)):
        arc_m, left_m = path.project(np.array((-3.0, 4.0, 204.0)), np.array((4.0, 2.0, -3.0)))
        assert arc_m == pytest.approx([0.0, 4.0, 200.0])
        assert left_m == pytest.approx([5.0, 2.0, -5.0])


@pytest.mark.parametrize("left_m", [-3.5, -1.0, 1.0, 3.5])
def test_a_shifted_line_keeps_its_distance(left_m: float) -> None:
    _, found = LINE.project(shifted(LINE, left_m).points[1:-1])
    assert found == pytest.approx(left_m, abs=0.05)


def test_shifted_into_a_bend_that_is_narrower_it_still_runs_forward() -> None:
    bend = curved_road(radius_m=3.0, run_in_m=20.0)["11"].centerline
    line = shifted(bend, 5.0)
    assert (np.diff(bend.project(line.points)[0]) > -1e-9).all()


def test_offsets_may_differ_from_vertex_to_vertex() -> None:
    line = shifted(STRAIGHT, np.linspace(0.0, 2.0, len(STRAIGHT.points)))
    assert line.points[-1] == pytest.approx((200.0, 2.0), abs=0.1)


def test_a_rear_axle_plan_puts_the_box_ahead_of_the_path() -> None:
    plan = rear_axle_plan(STRAIGHT, [0.0, 1.0], [10.0, 20.0], [10.0, 10.0], PACIFICA)
    assert plan.x_m == pytest.approx([11.461, 21.461])
    x_m, y_m, heading_rad = center_poses(
        [PATH, DrivingPath(STRAIGHT)], np.array([1]), np.array([[10.0, 20.0]]), PACIFICA
    )
    assert (x_m[0] == plan.x_m).all()
    assert (y_m[0] == plan.y_m).all()
    assert (heading_rad[0] == plan.heading_rad).all()


def test_a_lane_change_starts_at_the_ego_and_arrives_along_the_lane() -> None:
    path = lane_change_path(STRAIGHT, Pose(50.0, -3.5, 0.0), 40.0)
    arc_m, left_m = path.project_point(50.0, -3.5)
    assert left_m == pytest.approx(0.0, abs=1e-6)
    assert path.pose_at(arc_m).heading_rad == pytest.approx(0.0, abs=0.01)
    crossing = path.points[np.abs(path.points[:, 0] - 70.0) < 0.6][:, 1]
    assert crossing == pytest.approx(-1.75, abs=0.15)
    after = path.points[path.points[:, 0] > 90.0][:, 1]
    assert after == pytest.approx(0.0, abs=1e-9)
    assert np.abs(path.vertex_heading_rad).max() == pytest.approx(np.arctan(1.875 * 3.5 / 40.0), rel=0.02)


def test_an_ego_that_is_turned_leaves_in_its_own_direction() -> None:
    path = lane_change_path(STRAIGHT, Pose(50.0, -3.5, 0.1), 40.0)
    arc_m, _ = path.project_point(50.0, -3.5)
    assert path.pose_at(arc_m + 0.5).heading_rad == pytest.approx(0.1, abs=0.02)


@given(offset=st.floats(-4.0, 4.0), slope=st.floats(-10.0, 10.0))
def test_a_quintic_meets_its_ends(offset: float, slope: float) -> None:
    step = 1e-5
    start, near_start, near_end, end, beyond = quintic_offset(
        np.array((0.0, step, 1.0 - step, 1.0, 1.5)), offset, slope
    )
    assert start == pytest.approx(offset)
    assert (near_start - start) / step == pytest.approx(slope, abs=0.01)
    assert (near_end, end, beyond) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_on_a_bend_the_change_stays_between_the_lanes() -> None:
    lane = curved_road(radius_m=40.0, run_in_m=60.0)["11"].centerline
    start = lane.pose_at(40.0, 3.5)
    offsets = lane.project(lane_change_path(lane, start, 30.0).points)[1]
    assert offsets.max() < 3.55
    assert offsets.min() > -0.05
