"""The likelihood of recorded values: worked out by hand, and what holds for any of them."""

from __future__ import annotations

from math import exp, log, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st
from samples import SAMPLES, each_once

from interplan_sumo.realism.distances import Sample
from interplan_sumo.realism.likelihood import PSEUDOCOUNT, Bins, ceiling, likelihood, probabilities, weighted_mean

TWO = Bins(0.0, 2.0, 2)
TEN = Bins(-50.0, 50.0, 10)


def test_by_hand_of_two_bins() -> None:
    # Simulated: 3 in the first bin and 1 in the second, 0.1 more in each: 3.1 / 4.2 and 1.1 / 4.2.
    simulated = each_once(0.1, 0.2, 0.3, 1.5)
    assert probabilities(simulated, TWO).tolist() == pytest.approx([3.1 / 4.2, 1.1 / 4.2])
    # Recorded: one in each bin, so the geometric mean of the two.
    assert likelihood(each_once(0.5, 1.9), simulated, TWO) == pytest.approx(sqrt(3.1 * 1.1) / 4.2)
    # One is seen three times in the first bin, another once in each: 3/4 of the mean is of the first.
    recorded = Sample.of([[0.0, 0.0, 0.0], [0.5, 1.5]])
    assert likelihood(recorded, simulated, TWO) == pytest.approx(exp(0.75 * log(3.1 / 4.2) + 0.25 * log(1.1 / 4.2)))


def test_a_road_user_is_one_count_of_the_simulation_too() -> None:
    simulated = Sample.of([[0.5] * 1000, [1.5]])
    assert probabilities(simulated, TWO).tolist() == pytest.approx([0.5, 0.5])


def test_values_beyond_the_ends_are_in_the_end_bins_and_one_on_an_edge_in_the_bin_above() -> None:
    assert TWO.of(each_once(-9.0, 0.0, 0.999, 1.0, 2.0, 99.0).values).tolist() == [0, 0, 0, 1, 1, 1]
    assert TWO.edges.tolist() == [0.0, 1.0, 2.0]


def test_who_simulates_nothing_explains_nothing() -> None:
    assert likelihood(each_once(1.0, 2.0), Sample.of([]), TEN) == 0.0


def test_a_bin_that_is_never_simulated_is_unlikely_and_less_so_after_few() -> None:
    recorded = each_once(1.5)
    few, many = (likelihood(recorded, each_once(*[0.5] * n), TWO) for n in (1, 100))
    assert few == pytest.approx(PSEUDOCOUNT / (1.0 + 2.0 * PSEUDOCOUNT))
    assert many == pytest.approx(PSEUDOCOUNT / (100.0 + 2.0 * PSEUDOCOUNT))


def test_the_ceiling_is_the_exponential_of_the_negative_entropy() -> None:
    assert ceiling(each_once(0.5, 1.5), TWO) == pytest.approx(0.5)
    assert ceiling(each_once(0.1, 0.7), TWO) == pytest.approx(1.0)


@given(SAMPLES, SAMPLES)
def test_no_simulation_is_likelier_than_the_recording_itself(recorded: Sample, simulated: Sample) -> None:
    found = likelihood(recorded, simulated, TEN)
    assert 0.0 < found <= ceiling(recorded, TEN) + 1e-12 <= 1.0 + 1e-9


@given(SAMPLES)
def test_a_hundred_like_the_recorded_nearly_reach_the_ceiling(recorded: Sample) -> None:
    assert likelihood(recorded, Sample.pooled([recorded] * 100), TEN) > 0.9 * ceiling(recorded, TEN)


@given(st.dictionaries(st.sampled_from("abcdef"), st.floats(0.0, 1.0), min_size=1))
def test_the_mean_lies_among_the_likelihoods(likelihoods: dict[str, float]) -> None:
    weights = {name: 1.0 if name == "a" else 2.0 for name in "abcdef"}
    mean = weighted_mean(likelihoods, weights)
    assert min(likelihoods.values()) - 1e-12 <= mean <= max(likelihoods.values()) + 1e-12


def test_the_mean_by_hand_and_of_nothing() -> None:
    assert weighted_mean({"a": 0.3, "b": 0.6}, {"a": 1.0, "b": 2.0, "c": 5.0}) == pytest.approx(0.5)
    for call in (lambda: weighted_mean({}, {}), lambda: likelihood(Sample.of([]), each_once(1.0), TWO)):
        with pytest.raises(ValueError, match="recorded"):
            call()
