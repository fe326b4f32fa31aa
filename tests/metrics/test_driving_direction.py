"""Driving direction: backward motion within one second, summed over one value too many as nuPlan does."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.metrics.driving_direction import along_lanes_m, driving_direction, window_steps, window_sums
from tests.metrics.staging import drive_at, facts_of, lane_y_m
from tests.worlds import straight_road

ROAD = straight_road(lanes=2, length_m=300.0)


def backing(speed_mps: float, frames: int = 41):
    """Backwards along the lane at a constant speed."""
    x_m = 200.0 - speed_mps * 0.1 * np.arange(frames)
    return driving_direction(facts_of(drive_at(x_m, 0.0, -speed_mps), ROAD))


@pytest.mark.parametrize(("lowest_m", "score"), [(1.9999, 1.0), (2.0001, 0.5), (5.9999, 0.5), (6.0001, 0.0)])
def test_both_sides_of_both_limits(lowest_m: float, score: float):
    assert backing(lowest_m / 1.1).score == score


def test_the_reason_names_distance_and_time_and_the_frame_is_that_one():
    x_m = 200.0 - np.concatenate((np.zeros(5), np.linspace(0.0, 7.7, 12), np.full(20, 7.7)))
    facts = facts_of(drive_at(x_m, 0.0, 5.0), ROAD)
    result = driving_direction(facts)
    assert result.reason == "drove 7.7 m against the traffic in the 1 s before 1.6 s"
    assert driving_direction.lost_at(facts, result) == 16


def test_driving_forwards_or_standing_costs_nothing():
    assert driving_direction(facts_of(drive_at(np.arange(50.0, 90.0)), ROAD)).score == 1.0
    assert driving_direction(facts_of(drive_at(np.full(20, 50.0), 0.0, 0.0), ROAD)).detail["lowest_progress_m"] == 0.0


def test_the_frame_of_a_lane_change_and_the_next_one_count_nothing():
    x_m = 200.0 - 1.0 * np.arange(8)
    y_m = np.where(np.arange(8) < 4, 0.0, lane_y_m(1))
    facts = facts_of(drive_at(x_m, y_m), ROAD)
    np.testing.assert_allclose(
        along_lanes_m(ROAD, facts.places, facts.centre), [0, -1, -1, -1, 0, 0, -1, -1], atol=1e-9
    )


def test_off_the_lanes_nothing_counts_and_the_way_back_counts_in_full():
    x_m = np.array([100.0, 99.0, 98.0, 97.0])
    facts = facts_of(drive_at(x_m, [0.0, 30.0, 30.0, 0.0]), ROAD)
    np.testing.assert_allclose(along_lanes_m(ROAD, facts.places, facts.centre), [0.0, 0.0, 0.0, -3.0], atol=1e-9)


def test_the_start_of_a_lane_counts_nothing():
    # a projection of exactly 0 is taken for none by nuPlan
    places = (("11",), ("11",), ("11",))
    moved = along_lanes_m(ROAD, places, np.array([[2.0, 0.0], [-1.0, 0.0], [1.0, 0.0]]))
    np.testing.assert_allclose(moved, [0.0, 0.0, 1.0])


@pytest.mark.parametrize(("step_us", "steps"), [(100_000.0, 10), (50_000.0, 20), (100_001.0, 9), (99_999.0, 10)])
def test_the_window_counts_whole_steps(step_us: float, steps: int):
    assert window_steps(step_us) == steps


@given(st.lists(st.integers(-9, 9), max_size=30), st.integers(0, 12))
def test_window_sums_are_sums_of_slices(values: list[int], steps: int):
    expected = [sum(values[max(0, i - steps) : i + 1]) for i in range(len(values))]
    np.testing.assert_allclose(window_sums(np.array(values, dtype=np.float64), steps), expected, atol=1e-12)
