"""Distributions in SUMO's notation: their quantiles are those of scipy, cut to their range."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.simulation.number_distributions import NumberDistribution, parse_distribution


def parsed(text: str) -> NumberDistribution:
    found = parse_distribution(text)
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("text", "theirs"),
    [
        ("norm(1.5,0.2)", lambda stats: stats.norm(1.5, 0.2)),
        ("normc(1,0.1,0.2,2)", lambda stats: stats.truncnorm(-8.0, 10.0, loc=1.0, scale=0.1)),
        ("normalCapped(1,0.5,0.8,2)", lambda stats: stats.truncnorm(-0.4, 2.0, loc=1.0, scale=0.5)),
        ("lognorm(0.3,0.4)", lambda stats: stats.lognorm(0.4, scale=np.exp(0.3))),
        ("uniform(2,5)", lambda stats: stats.uniform(2.0, 3.0)),
        ("gamma(3,2)", lambda stats: stats.gamma(3.0, scale=0.5)),
    ],
)
def test_quantiles_are_those_of_scipy(text: str, theirs: Callable[[ModuleType], Any]) -> None:
    from scipy import stats  # half a second that only this test should wait

    shares = np.array([0.001, 0.1, 0.5, 0.9, 0.999])
    assert [parsed(text).quantile(share) for share in shares] == pytest.approx(
        theirs(stats).ppf(shares).tolist(), rel=1e-6
    )


@given(
    st.sampled_from(["norm(1,0.5)", "lognorm(0,0.5)", "gamma(2,2)", "uniform(0,3)"]), st.floats(0.0, 1.0),
    st.floats(0.3, 0.9), st.floats(1.1, 2.0),
)  # fmt: skip
def test_what_is_drawn_lies_within_the_bounds_and_grows_with_the_share(
    text: str, share: float, lowest: float, highest: float
) -> None:
    cut = parsed(text).within(lowest, highest)
    assert lowest <= cut.quantile(share) <= highest
    assert cut.quantile(share / 2.0) <= cut.quantile(share)


def test_without_deviation_it_is_a_number() -> None:
    assert [parsed(text).quantile(0.9) for text in ("norm(2,0)", "uniform(2,2)", "lognorm(0,0)")] == [2.0, 2.0, 1.0]
    with pytest.raises(ValueError, match="hardly ever"):
        parsed("norm(2,0)").within(3.0, 4.0)


@pytest.mark.parametrize(
    "text", ["norm(1)", "norm(1,-1)", "norm(1,x)", "norm(nan,1)", "uniform(3,2)", "gamma(0,1)", "gamma(1,1,0,2)",
             "normc(1,1,2,0)", "poisson(3)", "norm()"],
)  # fmt: skip
def test_what_is_no_distribution_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"distribution|deviation"):
        parse_distribution(text)


def test_numbers_and_words_are_none() -> None:
    assert [parse_distribution(text) for text in ("1.5", "fast", "", "-", "0,1,0")] == [None] * 5
