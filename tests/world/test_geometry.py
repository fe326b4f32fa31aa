"""Angles, polylines and boxes."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.world.geometry import Polyline, box_corners, frozen, hausdorff_m, penetration_m, wrap_angle

NUMBERS = st.floats(-50.0, 50.0)
POINTS = st.lists(st.tuples(NUMBERS, NUMBERS), min_size=2, max_size=12, unique=True)


def line(*points: tuple[float, float]) -> Polyline:
    return Polyline(np.array(points, dtype=np.float64))


LINES = POINTS.filter(lambda points: np.ptp(points, axis=0).max() > 1e-3).map(lambda points: line(*points))


def test_angles_are_wrapped_to_minus_pi_included_and_pi_excluded() -> None:
    assert wrap_angle(np.pi) == pytest.approx(-np.pi)
    assert wrap_angle(-np.pi) == pytest.approx(-np.pi)
    assert wrap_angle(3.0 * np.pi / 2.0) == pytest.approx(-np.pi / 2.0)


@given(path=LINES, x=NUMBERS, y=NUMBERS)
def test_projection_finds_the_nearest_point_as_shapely_does(path: Polyline, x: float, y: float) -> None:
    arc, lateral = path.project_point(x, y)
    assert abs(lateral) == pytest.approx(path.linestring.distance(shapely.Point(x, y)), abs=1e-9)
    pose = path.pose_at(arc)
    assert np.hypot(pose.x_m - x, pose.y_m - y) == pytest.approx(abs(lateral), abs=1e-9)


@given(path=LINES, share=st.floats(0.0, 1.0), x=NUMBERS, y=NUMBERS)
def test_the_scalar_and_the_vectorised_ways_agree(path: Polyline, share: float, x: float, y: float) -> None:
    assert path.project_point(x, y) == pytest.approx([float(v[0]) for v in path.project((x, y))], abs=1e-9)
    one = path.pose_at(share * path.length_m)
    many = path.poses_at(share * path.length_m)[0]
    assert (one.x_m, one.y_m) == pytest.approx((many[0], many[1]), abs=1e-9)
    assert wrap_angle(one.heading_rad - many[2]) == pytest.approx(0.0, abs=1e-9)


def test_left_of_the_line_is_positive() -> None:
    path = line((0, 0), (10, 0))
    assert path.project_point(4.0, 2.0) == pytest.approx((4.0, 2.0))
    assert path.project_point(4.0, -2.0) == pytest.approx((4.0, -2.0))
    beside = path.pose_at(4.0, 2.0)
    assert (beside.x_m, beside.y_m) == pytest.approx((4.0, 2.0))


def test_a_projection_may_look_at_one_stretch_only() -> None:
    there_and_back = line((0, 0), (100, 0), (100, 1), (0, 1))
    assert there_and_back.project_point(10.0, 0.4)[0] == pytest.approx(10.0)
    assert there_and_back.project_point(10.0, 0.4, (150.0, 201.0))[0] == pytest.approx(191.0)


def test_beyond_its_ends_a_line_is_projected_on_its_ends() -> None:
    path = line((0, 0), (10, 0))
    assert path.project_point(-3.0, 0.0)[0] == 0.0
    assert path.project_point(14.0, 0.0)[0] == pytest.approx(10.0)


def test_a_piece_of_a_line_keeps_the_corners_in_between() -> None:
    piece = line((0, 0), (10, 0), (10, 10)).between(5.0, 15.0)
    assert piece.points.tolist() == [[5, 0], [10, 0], [10, 5]]
    with pytest.raises(ValueError, match="empty piece"):
        piece.between(4.0, 4.0)


@given(path=LINES, spacing=st.floats(0.3, 20.0))
def test_resampling_keeps_the_line_and_its_vertices(path: Polyline, spacing: float) -> None:
    fine = path.resampled(spacing)
    assert fine.length_m == pytest.approx(path.length_m)
    assert np.diff(fine.arc_m).max() <= spacing + 1e-6


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((3, 2)), "two distinct points"),
        (np.zeros((3, 3)), r"shape \(3, 3\)"),
        (np.array([[0.0, 0.0], [np.nan, 1.0]]), "not finite"),
    ],
)
def test_a_line_that_is_none_is_refused(points: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Polyline(points)


def test_corners_come_in_nuplans_order() -> None:
    (corners,) = box_corners(0.0, 0.0, np.pi / 2, 4.0, 2.0)
    assert corners == pytest.approx(np.array([(-1, 2), (-1, -2), (1, -2), (1, 2)]))


def test_the_depth_of_an_overlap_is_how_far_a_box_must_move() -> None:
    a = box_corners(0.0, 0.0, 0.0, 4.0, 2.0)
    assert penetration_m(a, box_corners(3.95, 0.0, 0.0, 4.0, 2.0)) == pytest.approx([0.05])
    assert penetration_m(a, box_corners(4.05, 0.0, 0.0, 4.0, 2.0)) == pytest.approx([-0.05])
    turned = box_corners(0.0, 2.0, np.pi / 4, 2.0, 2.0)
    assert penetration_m(a, turned) == pytest.approx([1.0 + np.sqrt(2.0) - 2.0])


def test_frozen_never_touches_the_array_it_was_given() -> None:
    mine = np.arange(3.0)
    ours = frozen(mine)
    mine[0] = 7.0
    assert ours[0] == 0.0
    assert not ours.flags.writeable
    assert frozen(ours) is ours


@pytest.mark.parametrize(("count", "pieces"), [(20, 1), (20, 4), (900, 1), (900, 4)])
def test_the_distance_of_lines_is_that_of_their_farthest_points(count: int, pieces: int) -> None:
    """Short lines and long ones, as shapely measures them; segments cut in four find what lies between vertices."""
    x_m = np.linspace(0.0, 1000.0, count)
    one = np.stack((x_m, 20.0 * np.sin(x_m / 50.0)), axis=1)
    other = np.stack((x_m[::3], 20.0 * np.sin(x_m[::3] / 40.0)), axis=1)
    expected = shapely.hausdorff_distance(shapely.LineString(one), shapely.LineString(other), densify=1.0 / pieces)
    assert hausdorff_m(one, other, pieces) == pytest.approx(expected, abs=1e-9)
    assert hausdorff_m(one, one, pieces) == pytest.approx(0.0, abs=1e-9)
