"""Pairs of rows: on what they are compared, what Holm leaves of it, and how large a difference would show."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.statistics.detection import contrasts, holm, least_detectable_difference, row_pairs
from interplan_sumo.statistics.scene_values import DriveValue, DriveValues


def row(values: list[float], *, first: int = 0) -> DriveValues:
    return {(f"nudge/{first + n}", 0): DriveValue("nudge", value) for n, value in enumerate(values)}


HARD = [5.0 * n for n in range(16)]


def test_holm_multiplies_and_never_falls() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.04, 0.04, 0.9]) == pytest.approx([0.12, 0.12, 0.9])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []


def test_rows_that_share_scenes_are_paired_and_others_are_not() -> None:
    rows = [row(HARD), row([h + 3.0 + (n % 3) for n, h in enumerate(HARD)]), row(HARD, first=100), row([]), row([1.0])]
    pairs = {(pair.a, pair.b): pair for pair in row_pairs(rows)}
    assert {key: pair.paired for key, pair in pairs.items()} == {(0, 1): True, (0, 2): False, (1, 2): False}
    assert pairs[0, 1].estimate.value == pytest.approx(3.9375)
    assert pairs[0, 1].estimate.p_value < 0.001
    assert pairs[1, 2].estimate.p_value > 0.3  # as far apart, on scenes of their own


@pytest.mark.slow
def test_many_equal_rows_are_hardly_ever_told_apart() -> None:
    rng = np.random.default_rng(26)
    wrong = 0
    for _ in range(100):
        rows = [row(rng.uniform(0.0, 100.0, 16).tolist()) for _ in range(5)]
        wrong += any(each.told_apart for each in contrasts(row_pairs(rows)))
    assert wrong <= 10  # 4 in the mean


def test_the_least_detectable_difference_is_students_quantiles_times_the_standard_error() -> None:
    (pair,) = row_pairs([row([0.0] * 10), row([20.0, -20.0] * 5)])
    # 9 degrees of freedom: 2.262 and 0.883; the standard deviation is 21.08
    assert least_detectable_difference(pair.estimate) == pytest.approx(
        (2.2622 + 0.8834) * 21.082 / np.sqrt(10), rel=1e-3
    )
    (equal,) = row_pairs([row([0.0] * 10), row([20.0] * 10)])
    assert least_detectable_difference(equal.estimate) is None
