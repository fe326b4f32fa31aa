"""Intervals of means over scenes: what is drawn again, what little can be said of few or equal scenes, and coverage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.interval_coverage import PAIRS, SUITES, MadeUpSuite, PairedSuite, coverage, detection
from interplan_sumo.statistics import intervals
from interplan_sumo.statistics.intervals import (
    DIFFERENCES,
    POINTS,
    MeanEstimate,
    Range,
    mean_estimate,
    mean_interval,
    unpaired_difference,
)
from interplan_sumo.statistics.scene_values import (
    DriveValue,
    DriveValues,
    differences,
    mean_over_scenes,
    strata,
)
from tests.quick import few


def drives(*families: Sequence[float]) -> DriveValues:
    """One seed of every scene."""
    return {
        (f"{family}/{n}", 0): DriveValue(str(family), value)
        for family, values in enumerate(families)
        for n, value in enumerate(values)
    }


def estimate(*families: Sequence[float], limits: Range = (-inf, inf)) -> MeanEstimate:
    found = mean_estimate(drives(*families), limits)
    assert found is not None
    return found


def made_up(families: int, scenes: int) -> list[list[float]]:
    rng = np.random.default_rng(1)
    return [(10.0 * family + rng.uniform(0.0, 30.0, scenes)).tolist() for family in range(families)]


# --- the mean, its variance and its degrees of freedom ---


def test_a_scene_weighs_as_one_however_many_seeds_it_has() -> None:
    found = {("a/0", seed): DriveValue("a", 0.0) for seed in range(3)} | {("a/1", 0): DriveValue("a", 60.0)}
    assert mean_over_scenes(found) == 30.0
    assert [stratum.values.tolist() for stratum in strata(found)] == [[0.0, 60.0]]
    assert mean_over_scenes({}) is None


def test_the_standard_error_is_that_of_a_stratified_sample() -> None:
    first, second = [0.0, 10.0, 20.0, 30.0], [50.0, 70.0]
    found = estimate(first, second)
    parts = [(4 / 6) ** 2 * np.var(first, ddof=1) / 4, (2 / 6) ** 2 * np.var(second, ddof=1) / 2]
    assert found.value == pytest.approx(30.0)
    assert found.standard_error == pytest.approx(np.sqrt(sum(parts)))
    assert found.degrees_of_freedom == pytest.approx(sum(parts) ** 2 / (parts[0] ** 2 / 3 + parts[1] ** 2 / 1))


def test_bootstrap_means_have_the_standard_error_and_not_one_that_is_too_small() -> None:
    found = estimate(*made_up(8, 3))
    assert found.draw().std() == pytest.approx(found.standard_error, rel=0.05)  # n of n: 18 % less
    assert len(found.draw()) == intervals.DRAWS == 2000


def test_with_many_scenes_the_interval_is_that_of_the_normal_distribution() -> None:
    for many in (300, 4000):  # drawn one by one, and from their limit
        found = estimate(np.random.default_rng(3).normal(50.0, 10.0, many).tolist())
        low, high = found.interval
        assert (low, high) == pytest.approx(
            (found.value - 1.96 * found.standard_error, found.value + 1.96 * found.standard_error), abs=0.1
        )


def test_with_few_scenes_it_is_as_wide_as_students() -> None:
    found = estimate(np.random.default_rng(4).normal(50.0, 10.0, 10).tolist())
    low, high = found.interval
    assert high - low == pytest.approx(2 * 2.262 * found.standard_error, rel=0.06)


def test_families_do_not_make_an_interval_wider_but_their_scenes_do() -> None:
    apart = estimate([0.0, 1.0, 2.0] * 4, [98.0, 99.0, 100.0] * 4)
    assert apart.interval[1] - apart.interval[0] < 1.0
    together = estimate([0.0, 1.0, 2.0] * 4 + [98.0, 99.0, 100.0] * 4)
    assert together.interval[1] - together.interval[0] > 30.0


def test_the_order_of_drives_and_families_does_not_matter() -> None:
    held = dict(drives(*made_up(3, 5)))
    turned = dict(reversed(held.items()))
    first, second = mean_estimate(held), mean_estimate(turned)
    assert first is not None
    assert second is not None
    assert first.interval == second.interval


# --- scenes of one place ---


def at_places(*families: Mapping[str, float]) -> DriveValues:
    """A scene of each family at each of its places."""
    return {
        (f"{family}/{place}", 0): DriveValue(str(family), value, place)
        for family, values in enumerate(families)
        for place, value in values.items()
    }


def test_scenes_of_families_at_the_same_places_say_no_more_than_their_places() -> None:
    of = {f"roosevelt/{n}@0": value for n, value in enumerate(made_up(1, 10)[0])}
    one, three = mean_estimate(at_places(of)), mean_estimate(at_places(of, of, of))
    assert one is not None
    assert three is not None
    assert (three.scenes, three.places) == (30, 10)
    assert three.interval == pytest.approx(one.interval)
    assert three.standard_error == pytest.approx(one.standard_error)
    elsewhere = estimate(*[[*of.values()]] * 3)
    assert elsewhere.standard_error == pytest.approx(one.standard_error / np.sqrt(3.0))


def test_what_is_at_one_place_by_chance_does_not_join_families() -> None:
    first, second = {"a": 0.0, "b": 10.0, "c": 20.0, "d": 30.0}, {"d": 90.0, "e": 80.0, "f": 70.0}
    assert [stratum.values.tolist() for stratum in strata(at_places(first, second))] == [[0, 10, 20, 30], [70, 80, 90]]


def test_a_place_weighs_as_many_scenes_as_lie_there() -> None:
    low, high = {"a": 0.0, "b": 10.0, "c": 20.0}, {"a": 40.0, "b": 70.0}
    found = strata(at_places(low, high))
    assert [stratum.scenes for stratum in found] == [5]
    assert found[0].values.mean() == pytest.approx(mean_over_scenes(at_places(low, high)))
    scenes = {("a/0", 0): DriveValue("a", 0.0, "x"), ("a/1", 0): DriveValue("a", 50.0, "x")}
    assert mean_estimate(scenes) is None
    assert mean_over_scenes(scenes) == 25.0


# --- few scenes, equal scenes ---


def test_nothing_or_one_scene_has_no_interval() -> None:
    assert mean_estimate({}) is None
    assert mean_estimate({("a/0", seed): DriveValue("a", 10.0 * seed) for seed in range(5)}) is None


def test_families_of_one_scene_are_taken_together() -> None:
    assert [v.values.tolist() for v in strata(drives([3.0], [1.0, 2.0], [9.0]))] == [[1.0, 2.0], [3.0, 9.0]]
    assert [v.values.tolist() for v in strata(drives([3.0], [1.0, 2.0], [4.0, 5.0, 6.0]))] == [
        [1.0, 2.0, 3.0],
        [4.0, 5.0, 6.0],
    ]
    assert [v.values.tolist() for v in strata(drives([3.0], [1.0]))] == [[1.0, 3.0]]


def test_an_interval_stays_within_what_a_figure_can_be() -> None:
    assert mean_interval(drives([50.0]), POINTS) is None
    assert mean_interval(drives([0.0, 100.0]), POINTS) == POINTS
    low, high = estimate([100.0] * 9 + [50.0], limits=POINTS).interval
    assert 70.0 < low < 95.0 < high <= 100.0


@pytest.mark.parametrize(("scenes", "low"), [(10, 69.15), (80, 95.49)])
def test_equal_scenes_leave_room_for_what_was_not_seen(scenes: int, low: float) -> None:
    assert estimate([100.0] * scenes, limits=POINTS).interval == pytest.approx((low, 100.0), abs=0.01)
    assert estimate([0.0] * scenes, limits=POINTS).interval == pytest.approx((0.0, 100.0 - low), abs=0.01)
    two = estimate([100.0] * (scenes // 2), [40.0] * (scenes // 2), limits=POINTS).interval
    assert two == pytest.approx((70.0 - (100.0 - low), 70.0 + 0.6 * (100.0 - low)), abs=0.01)
    assert estimate([2.0] * scenes, limits=(0.0, inf)).interval[1] == 2.0


def test_equal_up_to_what_machines_differ_by_is_equal() -> None:
    half = intervals.SAME / 2
    assert estimate([80.0, 80.0 + half]).standard_error == 0.0
    assert estimate([80.0, 80.0 + 3 * half]).standard_error > 0.0


# --- differences ---


def test_differences_are_of_equal_scenes_and_seeds() -> None:
    a = {("a/0", 0): DriveValue("a", 10.0), ("a/0", 1): DriveValue("a", 20.0), ("a/1", 0): DriveValue("a", 5.0)}
    b = {("a/0", 1): DriveValue("a", 50.0), ("a/2", 0): DriveValue("a", 5.0)}
    assert differences(a, b) == {("a/0", 1): DriveValue("a", 30.0)}


def test_p_is_below_5_percent_where_the_interval_leaves_out_0() -> None:
    rng = np.random.default_rng(5)
    decided: list[bool] = []
    for shift in np.linspace(0.0, 15.0, 40):
        found = estimate(*(rng.normal(shift, 20.0, 10).tolist() for _ in range(4)))
        low, high = found.interval
        assert (found.p_value < 0.05) == (low > 0.0 or high < 0.0)
        decided.append(found.p_value < 0.05)
    assert 5 < sum(decided) < 35
    assert estimate(*([x + 300.0 for x in family] for family in made_up(4, 10))).p_value < 1e-10  # beyond all draws


@pytest.mark.parametrize(("scenes", "p"), [(2, 0.5), (5, 0.0625), (6, 0.03125)])
def test_equal_differences_prove_as_much_as_a_sign_test(scenes: int, p: float) -> None:
    assert estimate([40.0] * scenes).p_value == p
    assert estimate([-40.0] * scenes).p_value == p
    assert estimate([0.0] * scenes).p_value == 1.0


@given(
    value=st.floats(0.1, 100.0),
    scenes=st.integers(2, 200),
    other=st.floats(0.0, 100.0),
)
def test_where_nothing_varies_p_and_interval_say_the_same(value: float, scenes: int, other: float) -> None:
    for sign in (1.0, -1.0):
        found = estimate([sign * value] * scenes, [sign * other] * scenes, limits=DIFFERENCES)
        low, high = found.interval
        assert low < found.value < high or found.value in (low, high)
        told_apart = low > 1e-9 or high < -1e-9
        assert (found.p_value < 0.05) == told_apart or abs(found.p_value - 0.05) < 1e-9


def test_all_points_in_every_scene_prove_as_much_as_a_sign_test_and_less_in_each_proves_less() -> None:
    assert estimate([100.0] * 10, limits=DIFFERENCES).p_value == 2.0**-9
    assert estimate([25.0] * 10, limits=DIFFERENCES).p_value == pytest.approx(2.0 * 0.8**10)


def test_scenes_of_their_own_add_their_variances() -> None:
    a, b = estimate([0.0, 10.0, 20.0, 30.0]), estimate([0.0, 10.0, 20.0, 30.0])
    found = unpaired_difference(a, b)
    assert (found.value, found.degrees_of_freedom) == (0.0, pytest.approx(6.0))
    assert found.standard_error == pytest.approx(np.sqrt(2.0) * a.standard_error)
    assert found.draw().std() == pytest.approx(found.standard_error, rel=0.1)  # not hand in hand


# --- simulated: the truth is known ---


@pytest.mark.parametrize("suite", few([SUITES[1], SUITES[0], SUITES[5]], 1), ids=lambda suite: suite.title)
def test_intervals_hold_the_truth_as_often_as_they_say(suite: MadeUpSuite) -> None:
    held, _ = coverage(suite, 300, np.random.default_rng(26))
    assert held == pytest.approx(0.955, abs=0.03)


@pytest.mark.slow
def test_what_is_printed_as_detectable_is_detected() -> None:
    wrong, held, least, found = detection(PAIRS[0], 200, np.random.default_rng(26))
    assert wrong == pytest.approx(0.05, abs=0.03)
    assert held == pytest.approx(1.0 - wrong)
    assert least == pytest.approx(2.8 * 45.0 / np.sqrt(80.0), rel=0.1)
    assert found == pytest.approx(0.8, abs=0.07)


@pytest.mark.nightly
@pytest.mark.parametrize("suite", [*SUITES[:6], *SUITES[-2:]], ids=lambda suite: suite.title)
def test_coverage_is_95_percent(suite: MadeUpSuite) -> None:
    held, _ = coverage(suite, 4000, np.random.default_rng(27))
    assert 0.93 <= held <= 0.97


@pytest.mark.nightly
@pytest.mark.parametrize("pair", PAIRS[:3], ids=lambda pair: pair.title)
def test_power_is_80_percent(pair: PairedSuite) -> None:
    wrong, held, _, found = detection(pair, 4000, np.random.default_rng(27))
    assert wrong == pytest.approx(0.05, abs=0.02)
    assert 0.93 <= held <= 0.97
    assert found == pytest.approx(0.8, abs=0.03)
