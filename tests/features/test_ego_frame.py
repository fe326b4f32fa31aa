"""The ego's frame: there and back, signs, and what a planner returns."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import ego

from interplan_sumo.features.frame import EgoFrame, nearest
from interplan_sumo.world.ego import PACIFICA

REAR_M = 1.461  # PACIFICA's rear axle behind its centre
METRES = st.floats(-1e4, 1e4)
RADIANS = st.floats(-pi, pi)


def test_the_origin_is_the_rear_axle() -> None:
    frame = EgoFrame.of(ego(10.0, 20.0, heading_rad=pi / 2))
    np.testing.assert_allclose(frame.origin, (10.0, 20.0 - REAR_M, pi / 2))


def test_ahead_is_x_and_left_is_y() -> None:
    frame = EgoFrame(0.0, 0.0, pi / 2)  # northwards
    np.testing.assert_allclose(frame.points(np.array(((0.0, 3.0), (-2.0, 0.0)))), ((3.0, 0.0), (0.0, 2.0)), atol=1e-12)


@pytest.mark.parametrize("wobble_rad", [-1e-9, 0.0, 1e-9])
def test_dead_against_the_ego_is_plus_pi_however_it_was_rounded(wobble_rad: float) -> None:
    assert EgoFrame(0.0, 0.0, 0.3).yaws(np.array([0.3 + pi + wobble_rad]))[0] == pytest.approx(pi)


@settings(max_examples=30)
@given(METRES, METRES, RADIANS, METRES, METRES, RADIANS)
def test_into_the_frame_and_back_is_where_it_was(
    x: float, y: float, heading: float, px: float, py: float, turn: float
) -> None:
    frame = EgoFrame(x, y, heading)
    back = frame.to_map(frame.poses(np.array((px, py, turn))))
    np.testing.assert_allclose(back[:2], (px, py), atol=1e-8)
    assert np.cos(back[2] - turn) == pytest.approx(1.0)


def test_a_plan_of_the_rear_axle_becomes_one_of_the_centre() -> None:
    frame = EgoFrame.of(ego(0.0, 0.0))
    plan = frame.plan(np.array(((0.0, 0.0, 0.0), (4.0, 1.0, pi / 2))), np.array((0.0, 1.0)), PACIFICA)
    np.testing.assert_allclose((plan.x_m[0], plan.y_m[0]), (0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose((plan.x_m[1], plan.y_m[1]), (4.0 - REAR_M, 1.0 + REAR_M), atol=1e-12)


def test_ties_to_the_millimetre_go_by_id() -> None:
    distance_m, ids = np.array((2.0, 1.0 + 1e-7, 1.0, 0.5)), np.array((1, 2, 3, 4))
    assert nearest(distance_m, ids, 3).tolist() == [3, 1, 2]
