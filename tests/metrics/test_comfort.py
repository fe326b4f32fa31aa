"""Comfort and the signals behind it, against figures of nuPlan's own filters."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.metrics.comfort import BOUNDS, comfort
from interplan_sumo.metrics.comfort_signals import comfort_signals, unwrapped
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.world.trace import EgoTrack
from tests.metrics.staging import drive_at, facts_of
from tests.worlds import drive, straight_road

ROAD = straight_road(length_m=500.0)


def track(frames: int, **columns: object) -> EgoTrack:
    still = drive(*[0.0] * frames).ego
    wide: dict[str, Any] = {name: np.broadcast_to(np.asarray(v, np.float64), frames) for name, v in columns.items()}
    return replace(still, **wide)


def facts_with(**columns: object) -> Facts:
    trace = drive(*[0.0] * 40)
    return facts_of(replace(trace, ego=track(40, **columns)), ROAD)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("signal", ["longitudinal_acceleration_mps2", "lateral_acceleration_mps2"])
def test_accelerations_must_stay_strictly_inside(signal: str, side: int):
    limit, column = BOUNDS[signal][side], "ax_mps2" if signal.startswith("long") else "ay_mps2"
    assert comfort(facts_with(**{column: limit * (1 - 1e-6)})).score == 1.0
    at_limit = comfort(facts_with(**{column: limit}))
    assert at_limit.score == 0.0
    assert [name for name in BOUNDS if not at_limit.detail[name]["within"]] == [signal]


@pytest.mark.parametrize(("factor", "score"), [(0.999, 1.0), (1.001, 0.0)])
@pytest.mark.parametrize(
    ("column", "offset", "hertz", "signal"),
    [("ax_mps2", 0.0, 0.5, "longitudinal_jerk_mps3"), ("ay_mps2", 2.4, 0.7, "jerk_mps3")],
)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_both_sides_of_the_jerk_limits(
    column: str, offset: float, hertz: float, signal: str, sign: float, factor: float, score: float
):
    wave = sign * 1e-3 * np.sin(2 * np.pi * hertz * 0.1 * np.arange(40))
    small = comfort_signals(track(40, **{column: offset + wave}), 1.461, 0.1)[signal]
    wave *= factor * BOUNDS[signal][1] / np.abs(small).max()
    assert comfort(facts_with(**{column: offset + wave})).score == score


@pytest.mark.parametrize(("factor", "score"), [(0.999, 1.0), (1.001, 0.0)])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_both_sides_of_the_yaw_rate_limit(factor: float, score: float, sign: float):
    heading = sign * factor * 0.95 * 0.1 * np.arange(40)
    assert comfort(facts_with(heading_rad=heading)).score == score


@pytest.mark.parametrize(("factor", "score"), [(0.999, 1.0), (1.001, 0.0)])
def test_both_sides_of_the_yaw_acceleration_limit(factor: float, score: float):
    t = np.arange(8) * 0.1 - 0.35
    trace = drive(*[0.0] * 8)
    ego = replace(trace.ego, heading_rad=factor * 1.93 * t**2 / 2)
    assert comfort(facts_of(replace(trace, ego=ego), ROAD)).score == score


@given(st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=30), st.integers(-3, 3))
def test_unwrapping_undoes_wrapping(steps: list[float], turns: int):
    smooth = np.cumsum(steps)
    wrapped = (smooth + np.pi) % (2 * np.pi) - np.pi + 2 * np.pi * turns
    np.testing.assert_allclose(np.diff(unwrapped(wrapped)), np.diff(smooth), atol=1e-9)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_a_drive_too_short_for_the_filters_is_comfortable(frames: int):
    result = comfort(facts_of(drive_at(np.arange(float(frames))), ROAD))
    assert (result.score, result.series) == (1.0, {})


def test_points_are_lost_where_a_signal_is_farthest_beyond_its_bounds():
    ramp = np.where(np.arange(40) < 20, 0.0, -6.0)
    facts = facts_with(ax_mps2=ramp, ay_mps2=np.where(np.arange(40) < 30, 0.0, 30.0))
    assert comfort.lost_at(facts, comfort(facts)) > 30  # across the road it is farther beyond than along it


def test_the_reason_names_the_worst_signal():
    result = comfort(facts_with(ax_mps2=-6.0))
    assert (
        str(result.reason).partition(";")[0] == "longitudinal acceleration of -6.00 m/s2 at 0.0 s, allowed -4.05 to 2.4"
    )
