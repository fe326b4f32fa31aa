"""Time to collision: straight on, in steps of a tenth of a second."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.metrics.metric import MetricResult
from interplan_sumo.metrics.time_to_collision import first_step_s, overlap_span_s, time_to_collision
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.geometry import box_corners, penetration_m
from tests.metrics.staging import drive_at, facts_of
from tests.worlds import cars, straight_road

ROAD = straight_road(lanes=2, length_m=400.0)
CONTACT_M = (5.176 + 4.8) / 2
"""Distance of centres at which bumpers touch."""


def result_of(actors: Actors, *, y_m: float = 0.0, speed_mps: float = 10.0, x_m: object = 50.0) -> MetricResult:
    return time_to_collision(facts_of(drive_at(x_m, y_m, speed_mps, actors=actors), ROAD))


@pytest.mark.parametrize(("gap_m", "time_s", "score"), [(9.0, 0.9, 0.0), (9.001, 1.0, 1.0), (29.1, np.inf, 1.0)])
def test_a_parked_car_ahead_of_an_ego_at_10_mps(gap_m: float, time_s: float, score: float):
    result = result_of(cars((50.0 + CONTACT_M + gap_m, 0.0)))
    assert (result.detail["least_s"], result.score) == (pytest.approx(time_s), score)


def test_the_reason_names_time_track_and_frame():
    facts = facts_of(drive_at([50.0, 51.0, 46.0], actors=cars((50.0 + CONTACT_M + 5.0, 0.0))), ROAD)
    result = time_to_collision(facts)
    assert str(result.reason).startswith("close call, 0.4 s from vehicle car00 at 0.1 s; the ego was at ")
    assert time_to_collision.lost_at(facts, result) == 1


@pytest.mark.parametrize(("degrees", "counts"), [(100.0, True), (149.9, True), (150.1, False)])
def test_astride_two_lanes_those_at_the_side_count_too(degrees: float, counts: bool):
    overtaking = np.deg2rad(degrees)
    x, y = 50.0 - 1.461 + 6.5 * np.cos(overtaking), -0.9 - 6.5 * np.sin(overtaking)
    closing = cars((float(x), float(y), 18.0, np.arctan2(-0.9 - y, 62.0 - x)))
    assert (result_of(closing, y_m=-0.9).detail["least_s"] < np.inf) is counts
    assert result_of(closing).detail["least_s"] == np.inf


def test_a_collision_at_fault_leaves_no_time_and_one_without_fault_no_trace():
    assert result_of(cars((50.0 + CONTACT_M - 0.5, 0.0))).detail["least_s"] == 0.0
    rear_ended = cars((50.0 - CONTACT_M + 0.5, 0.0, 15.0))
    assert result_of(rear_ended).score == 1.0


@given(
    st.tuples(*[st.floats(-25.0, 25.0)] * 2),
    st.tuples(*[st.floats(-np.pi, np.pi)] * 2),
    st.tuples(*[st.floats(-12.0, 12.0)] * 4),
)
def test_spans_agree_with_stepping_the_boxes(
    offset: tuple[float, float], headings: tuple[float, float], velocities: tuple[float, float, float, float]
):
    size_a, size_b = (5.2, 2.3), (4.8, 2.0)
    va, vb = np.array([velocities[:2]]), np.array([velocities[2:]])
    begin, cease = overlap_span_s(
        np.zeros((1, 2)), np.array(headings[:1]), np.array([size_a]), va,
        np.array([offset]), np.array(headings[1:]), np.array([size_b]), vb,
    )  # fmt: skip
    time_s = np.arange(-30, 31) * 0.1
    ones = np.ones_like(time_s)
    boxes_a = box_corners(va[0, 0] * time_s, va[0, 1] * time_s, headings[0] * ones, size_a[0] * ones, size_a[1] * ones)
    x, y = offset[0] + vb[0, 0] * time_s, offset[1] + vb[0, 1] * time_s
    boxes_b = box_corners(x, y, headings[1] * ones, size_b[0] * ones, size_b[1] * ones)
    depth = penetration_m(boxes_a, boxes_b)
    clear = np.abs(depth) > 1e-6
    inside = (begin[0] <= time_s) & (time_s <= cease[0])
    assert (inside == (depth >= 0))[clear].all()


@pytest.mark.parametrize(
    ("begin", "cease", "step"),
    [
        (0.25, 5.0, 0.3),
        (0.3, 5.0, 0.3),
        (-1.0, 5.0, 0.1),
        (0.31, 0.39, np.inf),
        (2.9, 9.0, 2.9),
        (2.91, 9.0, np.inf),
        (1.0, 0.5, np.inf),
        (-2.0, -1.0, np.inf),
        (np.inf, -np.inf, np.inf),
        (-np.inf, np.inf, 0.1),
    ],
)
def test_the_first_step_inside_a_span(begin: float, cease: float, step: float):
    assert first_step_s(np.array([begin]), np.array([cease]))[0] == pytest.approx(step)
