"""From a network's poses to a plan: leaps are shortened, all else stays as it is."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from interplan_learned.driving import MOST_MPS, without_leaps


def test_a_path_without_leaps_stays_as_it_is() -> None:
    path = np.array([[0.0, 0.0, 0.0], [0.5 * MOST_MPS, 0.0, 0.1], [0.5 * MOST_MPS, 3.0, 0.2]])
    assert without_leaps(path, 0.5) is path


def test_a_leap_is_shortened_and_what_comes_after_moves_along() -> None:
    path = np.array([[0.0, 0.0, 0.0], [0.0, 100.0, 0.1], [1.0, 102.0, 0.2]])
    found = without_leaps(path, 0.5)
    np.testing.assert_allclose(found, [[0.0, 0.0, 0.0], [0.0, 22.5, 0.1], [1.0, 24.5, 0.2]])


@given(st.integers(0, 2**32 - 1), st.sampled_from((0.1, 0.5)))
def test_whatever_a_network_says_no_step_is_faster_than_allowed(seed: int, step_s: float) -> None:
    path = np.random.default_rng(seed).normal(0.0, 40.0, (17, 3))
    found = without_leaps(path, step_s)
    assert np.hypot(*np.diff(found[:, :2], axis=0).T).max() < MOST_MPS * step_s + 1e-9
    np.testing.assert_array_equal(found[:, 2], path[:, 2])
