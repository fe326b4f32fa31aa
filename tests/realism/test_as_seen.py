"""Populations that are moved until what is seen of them is what was recorded."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.realism.as_seen import MOMENTS, as_seen
from interplan_sumo.realism.comparison import FEWEST
from interplan_sumo.realism.distances import Sample
from interplan_sumo.realism.driver_population import QUALITIES, DriverPopulation
from interplan_sumo.realism.features import FEATURES, FeatureSamples

FITTED = DriverPopulation(np.log([1.0, 3.0, 1.5, 1.5, 0.7, 0.9, 0.5, 4.0]), 0.04 * np.eye(8))


def seen_of(
    population: DriverPopulation, seed: int = 0, count: int = 40, hidden: tuple[str, ...] = ()
) -> FeatureSamples:
    """A world in which people get three quarters of what they wish, by more or less from day to day."""
    luck = np.random.default_rng(seed).normal(0.0, 0.05, len(MOMENTS))
    shown = {
        each.feature: 0.75 * np.exp(population.mean[QUALITIES.index(each.quality)] + by)
        for each, by in zip(MOMENTS, luck, strict=True)
        if each.feature not in hidden
    }
    return {each.key: Sample.of([[shown.get(each.key, 0.0)]] * count) for each in FEATURES}


def test_drivers_are_found_of_whom_is_seen_what_was_recorded() -> None:
    real = DriverPopulation(FITTED.mean + np.array([0.2, -0.2, 0.3, 0.0, 0.3, 0.0, 0.0, 0.0]), FITTED.covariance)
    recorded = seen_of(real)
    found = as_seen(FITTED, recorded, seen_of)
    assert np.exp(found.population.mean - real.mean) == pytest.approx(np.ones(8), abs=0.1)
    assert np.array_equal(found.population.covariance, FITTED.covariance)
    assert list(found.after.values()) == pytest.approx(list(found.recorded.values()), rel=0.1)
    assert list(found.before.values()) != pytest.approx(list(found.recorded.values()), rel=0.1)


@pytest.mark.parametrize(
    "recorded",
    [seen_of(FITTED, count=FEWEST - 1), seen_of(FITTED, hidden=tuple(each.feature for each in MOMENTS))],
)
def test_what_recordings_do_not_tell_moves_nothing(recorded: FeatureSamples) -> None:
    found = as_seen(FITTED, recorded, lambda *_: pytest.fail("nobody need drive"))
    assert found.population is FITTED
    assert not found.recorded


def test_a_moment_that_plain_traffic_does_not_show_moves_nothing() -> None:
    population = as_seen(FITTED, seen_of(FITTED), lambda p, seed: seen_of(p, seed, hidden=("free_speed",))).population
    assert population.mean[QUALITIES.index("speed_factor")] == FITTED.mean[QUALITIES.index("speed_factor")]
