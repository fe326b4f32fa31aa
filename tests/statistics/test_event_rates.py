"""Rates of events: bootstrap over clusters, repeated looks, and Poisson regression, beside published examples."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.statistics.event_rates import ClusterSums, effective_size, relative_to_log
from interplan_sumo.statistics.poisson_regression import poisson_regression
from interplan_sumo.statistics.repeated_looks import WIDEST, boundaries

SHIPS = """A 60 60 127 0, A 60 75 63 0, A 65 60 1095 3, A 65 75 1095 4, A 70 60 1512 6, A 70 75 3353 18,
A 75 75 2244 11, B 60 60 44882 39, B 60 75 17176 29, B 65 60 28609 58, B 65 75 20370 53, B 70 60 7064 12,
B 70 75 13099 44, B 75 75 7117 18, C 60 60 1179 1, C 60 75 552 1, C 65 60 781 0, C 65 75 676 1, C 70 60 783 6,
C 70 75 1948 2, C 75 75 274 1, D 60 60 251 0, D 60 75 105 0, D 65 60 288 0, D 65 75 192 0, D 70 60 349 2,
D 70 75 1208 11, D 75 75 2051 4, E 60 60 45 0, E 65 60 789 7, E 65 75 437 7, E 70 60 1157 5, E 70 75 2161 12,
E 75 75 542 1"""
"""Damage to ships by type, year built, period, months of service and incidents (McCullagh and Nelder, 1989, 6.3.2)."""


def test_the_ships_of_mccullagh_and_nelder_have_their_published_coefficients() -> None:
    rows = [each.split() for each in SHIPS.split(",")]
    x = np.array(
        [
            [1, *(row[0] == kind for kind in "BCDE"), *(row[1] == year for year in ("65", "70", "75")), row[2] == "75"]
            for row in rows
        ],
        dtype=np.float64,
    )
    months, incidents = (np.array([float(row[column]) for row in rows]) for column in (3, 4))
    fit = poisson_regression(x, incidents, months, range(len(rows)))
    assert fit.coefficients.round(2).tolist() == [-6.41, -0.54, -0.69, -0.08, 0.33, 0.70, 0.82, 0.45, 0.38]
    assert np.sqrt(np.diag(fit.model_covariance))[1:].round(2).tolist() == [
        0.18,
        0.33,
        0.29,
        0.24,
        0.15,
        0.17,
        0.23,
        0.12,
    ]


def test_the_error_of_a_single_rate_is_that_of_the_sums_of_its_clusters() -> None:
    counts, exposure = np.array([3.0, 1.0, 0.0, 4.0, 2.0]), np.array([2.0, 1.0, 3.0, 2.0, 2.0])
    clusters = [0, 0, 1, 1, 2]
    fit = poisson_regression(np.ones((5, 1)), counts, exposure, clusters)
    left = counts - exposure  # the rate is 10 / 10
    sums = np.array([left[:2].sum(), left[2:4].sum(), left[4]])
    assert fit.coefficients == pytest.approx([0.0])
    assert fit.covariance[0, 0] == pytest.approx(1.5 * (sums**2).sum() / 100.0)
    assert fit.model_covariance[0, 0] == pytest.approx(0.1)


def test_a_ratio_of_two_groups_is_that_of_their_rates_and_rows_without_exposure_only_widen_it() -> None:
    x = np.array([[1.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 1.0]])
    narrow = poisson_regression(x, np.array([4.0, 6.0, 14.0, 16.0]), np.ones(4), range(4))
    assert narrow.rate(np.array([0.0, 1.0]))[0] == pytest.approx(3.0)
    wide = poisson_regression(
        np.vstack([x, x]), np.array([4.0, 6.0, 14.0, 16.0, 3.0, -3.0, 5.0, -5.0]), np.repeat([1.0, 0.0], 4), range(8)
    )
    assert wide.rate(np.array([0.0, 1.0]))[0] == pytest.approx(3.0)
    assert wide.covariance[1, 1] > 2.0 * narrow.covariance[1, 1]


@pytest.mark.parametrize(
    ("x", "counts", "clusters", "words"),
    [
        ([[1.0], [1.0]], [1.0, 2.0], [0, 0], "two starts at least"),
        ([[1.0], [1.0]], [0.0, 0.0], [0, 1], "needs events"),
        ([[1.0, 1.0], [1.0, 1.0]], [1.0, 2.0], [0, 1], "covariates go together"),
        ([[1.0, 0.0], [1.0, 1.0]], [2.0, 0.0], [0, 1], "something has no events at all"),
    ],
)
def test_what_cannot_be_told_is_refused(
    x: list[list[float]], counts: list[float], clusters: list[int], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        poisson_regression(np.array(x), np.array(counts), np.ones(2), clusters)


def test_looks_have_the_boundaries_of_lan_and_demets() -> None:
    published = [
        4.8769,
        3.3569,
        2.6803,
        2.2898,
        2.0310,
    ]  # five equal looks, two-sided 5 %
    assert boundaries([0.2, 0.4, 0.6, 0.8, 1.0]) == pytest.approx(published, abs=2e-4)
    assert boundaries([1.0]) == pytest.approx([1.95996], abs=1e-4)
    assert boundaries([]) == []
    assert 2.1 < boundaries(list(np.linspace(0.1, 1.0, 30)))[-1] < WIDEST


def test_looks_leave_the_truth_out_in_five_of_a_hundred_series_together() -> None:
    shares = np.array([0.5, 0.7, 0.9, 1.0])
    steps = np.random.default_rng(0).normal(size=(40_000, 4)) * np.sqrt(np.diff(shares, prepend=0.0))
    statistic = np.abs(np.cumsum(steps, axis=1)) / np.sqrt(shares)
    assert np.mean(np.any(statistic > boundaries(shares.tolist()), axis=1)) == pytest.approx(0.05, abs=0.004)
    assert np.mean(np.any(statistic > 1.96, axis=1)) > 0.08


@pytest.mark.parametrize("information", [[0.5, 0.5], [0.5, 1.1], [0.0]])
def test_information_grows_to_1_at_most(information: list[float]) -> None:
    with pytest.raises(ValueError, match="information"):
        boundaries(information)


def test_a_bootstrap_over_clusters_has_the_error_of_independent_events() -> None:
    rows = np.column_stack([np.random.default_rng(0).poisson(0.5, 400).astype(np.float64), np.ones(400)])
    found = ClusterSums(rows, range(400)).rate(lambda sums: sums[..., 0] / sums[..., 1])
    assert found is not None
    assert found.log_error == pytest.approx(1.0 / np.sqrt(rows[:, 0].sum()), rel=0.12)
    low, high = found.interval()
    assert low * high == pytest.approx(found.value**2)
    assert found.half_width() == pytest.approx((high - low) / 2.0 / found.value)
    assert relative_to_log(found.half_width()) == pytest.approx(found.half_width_of_log())


def test_one_cluster_or_no_event_has_no_error() -> None:
    rows = np.ones((5, 2))
    assert ClusterSums(rows, [0] * 5).rate(lambda sums: sums[..., 0] / sums[..., 1]) is None
    assert ClusterSums(rows * [0.0, 1.0], range(5)).rate(lambda sums: sums[..., 0] / sums[..., 1]) is None


def test_the_effective_size_is_the_number_of_equal_weights_and_less_of_others() -> None:
    assert effective_size(np.ones(7)) == pytest.approx(7.0)
    assert effective_size(np.array([1.0, 1e-6])) == pytest.approx(1.0, abs=1e-5)
    assert effective_size(np.array([])) == 0.0
