"""The Savitzky-Golay filter gives what scipy's gives, to the bit."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.world.savitzky_golay import savitzky_golay


@pytest.mark.parametrize(
    ("window", "order", "derivative"), [(8, 2, 0), (15, 2, 1), (5, 2, 1), (5, 3, 2), (7, 2, 0), (4, 3, 2)]
)
@pytest.mark.parametrize("more", [0, 1, 40])
def test_it_is_scipys_to_the_bit(window: int, order: int, derivative: int, more: int) -> None:
    from scipy.signal import savgol_filter  # half a second that only this test should wait

    values = np.cumsum(np.random.default_rng(1).normal(size=window + more))
    expected = savgol_filter(values, window, order, deriv=derivative, delta=0.1)
    np.testing.assert_array_equal(savitzky_golay(values, window, order, derivative, 0.1), expected)


def test_a_parabola_is_left_as_it_is_and_its_slope_is_found() -> None:
    time_s = 0.1 * np.arange(30.0, dtype=np.float64)
    np.testing.assert_allclose(savitzky_golay(time_s**2, 15, 2), time_s**2, atol=1e-12)
    np.testing.assert_allclose(savitzky_golay(time_s**2, 15, 2, 1, 0.1), 2.0 * time_s, atol=1e-12)
