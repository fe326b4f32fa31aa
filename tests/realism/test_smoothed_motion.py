"""Smoothed motions: known ones come out as they are, and a standing box stands."""

from __future__ import annotations

import numpy as np
import pytest
from tracking import DT_S, moved, steady, track

from interplan_sumo.realism import motion
from interplan_sumo.realism.motion import motion_of

T_S = DT_S * np.arange(101.0)


def test_even_acceleration_is_found_to_the_last_digit() -> None:
    found = moved(track("a", 2.0 * T_S + 0.5 * 1.5 * T_S**2))
    assert found.acceleration_mps2 == pytest.approx(1.5)
    assert found.jerk_mps3 == pytest.approx(0.0, abs=1e-6)
    assert found.speed_mps == pytest.approx(2.0 + 1.5 * found.time_s)


def test_half_a_window_is_lost_at_either_end() -> None:
    found = moved(steady("a", 0.0, 10.0))
    assert (found.time_s[0], found.time_s[-1]) == pytest.approx((0.7, 9.3))
    assert found.x_m[0] == pytest.approx(7.0)


def test_what_is_shorter_than_the_window_has_no_motion() -> None:
    assert motion_of(steady("a", 0.0, 10.0, seconds=1.3)) is None
    assert moved(steady("a", 0.0, 10.0, seconds=1.4)).speed_mps == pytest.approx([10.0])


def test_a_standing_box_that_trembles_stands_and_a_crawling_one_does_not() -> None:
    noise_m = np.random.default_rng(0).normal(0.0, 0.1, len(T_S))
    standing, crawling = moved(track("a", noise_m)), moved(track("b", 0.5 * T_S))
    for name in ("speed_mps", "acceleration_mps2", "jerk_mps3", "yaw_rate_radps"):
        assert not getattr(standing, name).any(), name
    assert crawling.speed_mps == pytest.approx(0.5)


def test_a_circle_is_turned_at_its_rate() -> None:
    angle_rad = 0.2 * T_S
    found = moved(track("a", 50.0 * np.sin(angle_rad), 50.0 * (1.0 - np.cos(angle_rad))))
    assert found.yaw_rate_radps == pytest.approx(0.2, rel=0.01)
    assert found.speed_mps == pytest.approx(10.0, rel=0.01)


def test_a_box_recorded_back_to_front_is_turned_round() -> None:
    assert moved(track("a", 10.0 * T_S, heading_rad=np.pi)).heading_rad == pytest.approx(0.0)


def test_missing_boxes_are_filled_along_a_line() -> None:
    whole = steady("a", 0.0, 10.0)
    seen = np.delete(np.arange(len(whole.time_s)), [40, 41, 42])
    parts = {name: getattr(whole, name)[seen] for name in ("time_s", "x_m", "y_m", "heading_rad", "speed_mps")}
    found = moved(type(whole)("a", "vehicle", **parts, length_m=4.0, width_m=2.0))
    assert found.speed_mps == pytest.approx(10.0)
    assert len(found.time_s) == len(moved(whole).time_s)


@pytest.mark.parametrize("rows", [5, 9, 15, 80])
def test_the_filter_is_scipys(rows: int) -> None:
    from scipy.signal import savgol_filter  # half a second that only this test should wait

    values = np.random.default_rng(0).normal(size=rows)
    half = min(7, (rows - 1) // 2)
    for order in (1, 2):
        expected = savgol_filter(values, 2 * half + 1, 2, order, delta=0.1)
        assert motion._derivative(values, 7, 0.1, order) == pytest.approx(expected, abs=1e-9)
