"""Distances of samples: worked out by hand, and against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from samples import SAMPLES, each_once

from interplan_sumo.realism.distances import Sample, kolmogorov_smirnov, wasserstein


def test_a_road_user_counts_as_one_however_often_it_is_seen() -> None:
    sample = Sample.of([[0.0] * 600, [10.0], [], [20.0, 30.0]])
    assert len(sample) == 603
    assert sample.road_users == 3
    assert sample.weights[:600].sum() == pytest.approx(1.0)
    assert [sample.quantile(share) for share in (0.3, 0.5, 0.7, 1.0)] == [0.0, 10.0, 20.0, 30.0]


def test_pooled_samples_keep_their_road_users_apart() -> None:
    both = Sample.pooled([Sample.of([[1.0, 1.0]]), Sample.of([]), Sample.of([[2.0], [3.0, 3.0, 3.0]])])
    assert both.road_users == 3
    assert both.weights.tolist() == pytest.approx([0.5, 0.5, 1.0, 1 / 3, 1 / 3, 1 / 3])


def test_distances_by_hand() -> None:
    # Shares at or below 0, 1, 2, 3: 1/4 1/2 3/4 1 and 0 1/2 1/2 1.
    one, other = each_once(0.0, 1.0, 2.0, 3.0), each_once(1.0, 3.0)
    assert kolmogorov_smirnov(one, other) == pytest.approx(0.25)
    assert wasserstein(one, other) == pytest.approx(0.25 + 0.0 + 0.25)
    # 1 of 2 road users stands for a minute: half of the weight, not 600 of 601.
    stands = Sample.of([[0.0] * 600, [4.0]])
    assert kolmogorov_smirnov(stands, each_once(4.0)) == pytest.approx(0.5)
    assert wasserstein(stands, each_once(4.0)) == pytest.approx(2.0)


def test_a_shift_is_the_wasserstein_distance_and_samples_that_do_not_meet_are_1_apart() -> None:
    one = each_once(*range(5))
    assert wasserstein(one, each_once(*(x + 7.5 for x in range(5)))) == pytest.approx(7.5)
    assert kolmogorov_smirnov(one, each_once(4.5, 6.0)) == 1.0


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of its p-values
@given(SAMPLES, SAMPLES)
def test_distances_are_scipys(one: Sample, other: Sample) -> None:
    from scipy.stats import ks_2samp, wasserstein_distance  # half a second that only this test should wait

    expected = wasserstein_distance(one.values, other.values, one.weights, other.weights)
    assert wasserstein(one, other) == pytest.approx(expected, abs=1e-9)
    alone, also = Sample(one.values, np.arange(len(one))), Sample(other.values, np.arange(len(other)))
    expected = ks_2samp(one.values, other.values)[0]
    assert kolmogorov_smirnov(alone, also) == pytest.approx(expected, abs=1e-9)


@given(SAMPLES, SAMPLES, SAMPLES)
def test_they_are_distances(one: Sample, other: Sample, third: Sample) -> None:
    for distance in (kolmogorov_smirnov, wasserstein):
        assert distance(one, one) == 0.0
        assert distance(one, other) == pytest.approx(distance(other, one))
        assert distance(one, third) <= distance(one, other) + distance(other, third) + 1e-9
    assert 0.0 <= kolmogorov_smirnov(one, other) <= 1.0 + 1e-12


def test_there_is_no_distance_to_nothing() -> None:
    for distance in (kolmogorov_smirnov, wasserstein):
        with pytest.raises(ValueError, match="empty"):
            distance(Sample.of([]), each_once(1.0))
    with pytest.raises(ValueError, match="finite"):
        each_once(float("nan"))
