"""Augmentation: a start beside the driven line is one smooth drive, seen from where it then is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny_dataset import samples_of

from interplan_sumo.dataset.columns import Columns, picked
from interplan_sumo.features.schema import BY_NAME
from tools.train.augment import Perturbation, perturbed_start, without_agents, without_past

BENDS = {name: samples_of(name, 8.0) for name in ("left", "right")}
STRAIGHT = picked(samples_of("gentle", 8.0), np.array([4]))  # 2 s into the drive, with 3 s of straight road ahead
SIDEWAYS = Perturbation(share=1.0, forward_m=0.0, left_m=1.0, turned_rad=0.0)


class Fixed(np.random.Generator):
    """Draws the numbers it was told to."""

    def __init__(self, *draws: float) -> None:
        super().__init__(np.random.PCG64(0))
        self._draws = draws

    def uniform(self, *_: object, **__: object) -> np.ndarray:  # type: ignore[override]
        return np.array([self._draws])


def moved(*draws: float, columns: Columns = STRAIGHT, how: Perturbation = SIDEWAYS) -> Columns:
    return perturbed_start(columns, Fixed(*draws), how)


def test_an_ego_that_is_a_metre_to_the_left_sees_its_line_a_metre_to_the_right() -> None:
    beside = moved(0.0, 1.0, 0.0)
    np.testing.assert_allclose(beside["route_centerline"][0, :20, 1], -1.0, atol=1e-4)
    np.testing.assert_allclose(beside["agents"][0, 0, -1, 1], STRAIGHT["agents"][0, 0, -1, 1] - 1.0, atol=1e-4)
    np.testing.assert_allclose(beside["ego_history"][0, -1, :3], 0.0, atol=1e-6)
    np.testing.assert_allclose(beside["ego_history"][0, 0, 1], -1.0, atol=1e-4)  # two seconds ago it was on its line,
    np.testing.assert_allclose(beside["ego_future"][0, 29:35, 1], -1.0, atol=1e-3)  # and in three it is again
    assert np.all(np.diff(beside["ego_future"][0, :30, 1]) < 1e-6)


def test_an_ego_that_is_turned_to_the_left_sees_its_line_to_the_right() -> None:
    how = Perturbation(share=1.0, forward_m=0.0, left_m=0.0, turned_rad=0.2)
    turned = moved(0.0, 0.0, 1.0, how=how)
    np.testing.assert_allclose(turned["route_centerline"][0, 10, 2], -0.2, atol=0.01)
    assert turned["route_centerline"][0, 10, 1] == pytest.approx(-10.0 * np.tan(0.2), abs=0.1)
    np.testing.assert_allclose(turned["ego_history"][0, -1, 3:5], (np.hypot(8.0, 8.0 * np.sin(0.2)), 0.0), atol=0.05)


def test_the_line_begins_beside_an_ego_that_is_further_ahead() -> None:
    how = Perturbation(share=1.0, forward_m=0.7, left_m=0.0, turned_rad=0.0)
    ahead = moved(1.0, 0.0, 0.0, how=how)
    np.testing.assert_allclose(ahead["route_centerline"][0, :40, 0], np.arange(40.0), atol=0.02)


@given(
    left=st.floats(-1.0, 1.0),
    turned=st.floats(-1.0, 1.0),
    row=st.integers(0, 12),
    bend=st.sampled_from(("left", "right")),
)
def test_past_and_future_are_one_smooth_drive(left: float, turned: float, row: int, bend: str) -> None:
    sample = picked(BENDS[bend], np.array([row]))
    found = moved(0.0, left, turned, columns=sample, how=Perturbation(share=1.0, left_m=1.0, turned_rad=0.25))
    valid = found["ego_future"][0, :, 3] > 0.5
    path = np.concatenate((found["ego_history"][0, :, :3], found["ego_future"][0, valid, :3])).astype(np.float64)
    steps = np.diff(path[:, :2], axis=0)
    assert np.abs(np.diff(steps, axis=0)).max() / 0.01 < 12.0  # m/s2
    bearing = np.arctan2(steps[:, 1], steps[:, 0])
    heading = (np.unwrap(path[:, 2])[1:] + np.unwrap(path[:, 2])[:-1]) / 2.0
    assert np.abs(np.angle(np.exp(1j * (bearing - heading)))).max() < 0.06
    speed = np.hypot(found["ego_history"][0, :, 3], found["ego_history"][0, :, 4])
    np.testing.assert_allclose(np.hypot(*steps[:20].T) / 0.1, (speed[1:] + speed[:-1]) / 2.0, atol=0.25)


def test_distances_among_others_stay_and_empty_rows_stay_empty() -> None:
    beside = moved(0.0, 1.0, 0.6, how=Perturbation(share=1.0))
    for name in ("lanes", "agents", "left_boundaries", "route_lanes", "agent_futures", "static_objects"):
        before, after = STRAIGHT[name][0], beside[name][0]
        empty = ~before.reshape(len(before), -1).any(axis=1)
        assert not after[empty].any(), name
        if not empty.all():
            points = (
                before[~empty].reshape(-1, before.shape[-1])[:, :2],
                after[~empty].reshape(-1, after.shape[-1])[:, :2],
            )
            steps = [np.hypot(*np.diff(each.astype(np.float64), axis=0).T) for each in points]
            np.testing.assert_allclose(steps[0], steps[1], atol=1e-3, err_msg=name)
    assert beside["agents"].dtype == BY_NAME["agents"].dtype
    off = beside["origin"][0, :2] - STRAIGHT["origin"][0, :2]
    assert np.hypot(*off) == pytest.approx(np.hypot(0.0, 1.0), abs=1e-6)


def test_a_standing_ego_is_not_moved() -> None:
    standing = picked(samples_of("gentle", 0.5), np.array([4]))
    np.testing.assert_array_equal(moved(0.0, 1.0, 0.0, columns=standing)["ego_history"], standing["ego_history"])


def test_agents_are_lost_with_their_futures_and_a_lost_past_leaves_the_present() -> None:
    lost = without_agents(STRAIGHT, np.random.default_rng(0), share=1.0, rate=1.0)
    assert not lost["agents"].any()
    assert not lost["agent_futures"].any()
    assert STRAIGHT["agents"].any()
    kept = without_agents(STRAIGHT, np.random.default_rng(0), share=0.0)
    np.testing.assert_array_equal(kept["agents"], STRAIGHT["agents"])
    lost = without_past(STRAIGHT, np.random.default_rng(0), share=1.0)
    np.testing.assert_array_equal(lost["ego_history"][:, -1], STRAIGHT["ego_history"][:, -1])
    assert not lost["ego_history"][:, :-1].any()
    assert lost["ego_history_valid"].sum() == 1
