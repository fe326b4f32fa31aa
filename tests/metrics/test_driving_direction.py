"""Driving direction: backward motion within one second, summed over one value too many as nuPlan does."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.metrics.driving_direction import along_lanes_m, driving_direction, window_steps, window_sums
from tests.metrics.staging import drive_at, facts_of
from tests.worlds import straight_road

ROAD = straight_road(lanes=2, length_m=300.0)


def test_the_reason_names_distance_and_time_and_the_frame_is_that_one():
    x_m = 200.0 - np.concatenate((np.zeros(5), np.linspace(0.0, 7.7, 12), np.full(20, 7.7)))
    facts = facts_of(drive_at(x_m, 0.0, 5.0), ROAD)
    result = driving_direction(facts)
    assert str(result.reason).startswith(
        "drove 7.7 m against the traffic of lane 11 in the 1 s before 1.6 s; the ego was"
    )
    assert driving_direction.lost_at(facts, result) == 16


def test_the_frame_of_a_lane_change_and_the_next_one_count_nothing():
    places = (("11",),) * 4 + (("12",),) * 4
    moved = along_lanes_m(ROAD, places, np.array([[200.0 - k, 0.0] for k in range(8)]))
    np.testing.assert_allclose(moved, [0, -1, -1, -1, 0, 0, -1, -1], atol=1e-9)


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
