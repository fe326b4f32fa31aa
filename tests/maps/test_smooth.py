"""Smooth centre lines."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.maps.importers.smooth import FARTHEST_M, smoothed
from interplan_sumo.world.geometry import Polyline, wrap_angle


def even(*points: tuple[float, float]) -> Polyline:
    """A line through points with vertices about 0.9 m apart, corners cut by less than half of that."""
    line = Polyline(np.array(points))
    return Polyline(line.poses_at(np.linspace(0.0, line.length_m, 1 + round(line.length_m / 0.9)))[:, :2])


def sharpest_deg(line: Polyline) -> float:
    return float(np.degrees(np.abs(wrap_angle(np.diff(line.segment_heading_rad))).max()))


def test_a_kink_is_spread_over_several_metres() -> None:
    kinked = even((0.0, 0.0), (20.0, 0.0), (40.0, 20.0 * np.tan(np.radians(12.0))))
    line = smoothed(kinked)
    assert sharpest_deg(kinked) > 5.0
    assert sharpest_deg(line) < 0.6 * sharpest_deg(kinked)


def test_a_straight_line_stays_as_it_is() -> None:
    straight = even((0.0, 0.0), (30.0, 10.0))
    assert np.allclose(smoothed(straight).points, straight.points, atol=1e-6)


def test_a_wide_bend_keeps_its_radius() -> None:
    angles = np.linspace(0.0, np.pi / 2.0, 60)
    bend = Polyline(np.stack((30.0 * np.sin(angles), 30.0 - 30.0 * np.cos(angles)), axis=1))
    off = np.hypot(*(smoothed(bend).points - (0.0, 30.0)).T) - 30.0
    assert np.abs(off).max() < 0.1


def test_a_way_leaves_and_arrives_in_the_direction_of_its_neighbours() -> None:
    """A straight way that begins and ends with a kink of 11 degrees becomes an S."""
    before, after = even((-20.0, 0.0), (0.0, 0.0)), even((25.0, 5.0), (45.0, 5.0))
    across = even((0.0, 0.0), (25.0, 5.0))
    alone, between = smoothed(across), smoothed(across, before, after, 0.8)
    assert abs(np.degrees(alone.segment_heading_rad[0])) > 11.0
    assert abs(np.degrees(between.segment_heading_rad[0])) < 7.0
    assert abs(np.degrees(between.segment_heading_rad[-1])) < 7.0


@given(st.lists(st.floats(-60.0, 60.0), min_size=1, max_size=6))
@settings(max_examples=20)
def test_ends_stay_and_nothing_moves_far(turns_deg: list[float]) -> None:
    points, heading = [np.zeros(2)], 0.0
    for turn in turns_deg:
        heading += np.radians(turn)
        points.append(points[-1] + 9.0 * np.array((np.cos(heading), np.sin(heading))))
    line = even(*((float(x), float(y)) for x, y in points))
    moved = smoothed(line)
    assert np.array_equal(moved.points[[0, -1]], line.points[[0, -1]])
    assert np.hypot(*(moved.points - line.points).T).max() <= FARTHEST_M + 1e-9


@pytest.mark.parametrize("length_m", [0.2, 0.9, 1.9])
def test_the_shortest_lines_pass(length_m: float) -> None:
    line = even((0.0, 0.0), (length_m, 0.0)) if length_m > 0.5 else Polyline(np.array([[0.0, 0.0], [length_m, 0.0]]))
    assert smoothed(line, line, line).length_m == pytest.approx(length_m)
