"""Open-loop errors, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from tools.train.metrics import constant_velocity, plan_errors, wanted_poses


def future(frames: int = 80) -> np.ndarray:
    """Straight on at 10 m/s, known for so many frames."""
    table = np.zeros((1, 80, 4), dtype=np.float32)
    table[0, :frames, 0] = np.arange(1, frames + 1)
    table[0, :frames, 3] = 1.0
    return table


def test_plans_and_constant_velocity_are_held_against_every_fifth_frame() -> None:
    wanted, valid = wanted_poses(future())
    np.testing.assert_array_equal(wanted[0, :, 0], np.arange(5.0, 81.0, 5.0))
    assert valid.all()
    history = np.zeros((1, 21, 10))
    history[0, -1, 3:5] = (10.0, 0.2)
    plans = constant_velocity(history)
    np.testing.assert_allclose(plans[0, 1], (10.0, 0.2, 0.0))
    assert plan_errors(plans, future())["fde_8_s"] == pytest.approx(1.6)


def test_errors_grow_with_the_horizon_headings_turn_the_short_way_and_undriven_steps_do_not_count() -> None:
    plans = wanted_poses(future())[0].astype(np.float64)
    plans[0, :, 1] += np.arange(1, 17)  # half a metre per second... per pose a metre
    plans[0, :, 2] += 2.0 * np.pi - 0.1
    errors = plan_errors(plans, future())
    assert errors["fde_3_s"] == pytest.approx(6.0)
    assert errors["ade_3_s"] == pytest.approx(3.5)
    assert errors["fde_8_s"] == pytest.approx(16.0)
    assert errors["heading_5_s"] == pytest.approx(0.1)
    plans = wanted_poses(future())[0].astype(np.float64)
    plans[0, 6:] += 100.0
    errors = plan_errors(plans, future(frames=30))
    assert errors["ade"] == 0.0
    assert errors["ade_3_s"] == 0.0
    assert np.isnan(errors["ade_5_s"])
