"""Rare events: what is drawn, what it weighs, and that weights make up for boosting."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from interplan_sumo.endurance.rare_events import BegunRareEvent, RareEventDraws, boosted_for
from interplan_sumo.endurance.records import RARE_KINDS, Counts, RareKind, likelihood_ratio
from interplan_sumo.errors import InputError

NATURAL: dict[RareKind, float] = {"jaywalker": 0.004, "cut_in": 0.01}
BOOSTED: dict[RareKind, float] = {"jaywalker": 0.03, "cut_in": 0.05}
Opportunities = dict[RareKind, list[str]]
opportunities = st.dictionaries(
    st.sampled_from(RARE_KINDS), st.lists(st.text(max_size=3), max_size=4, unique=True), max_size=4
)


def some_opportunities(second: int, begun: int) -> Opportunities:
    """As many as a state that changes with time, and with what has begun, gives."""
    walkers, cars = second % 3, (second // 2) % 2 + (begun > 0)
    return {"jaywalker": [f"w{n}" for n in range(walkers)], "cut_in": [f"c{n}" for n in range(cars)]}


def driven(seed: int, boosted: Mapping[RareKind, float] | None, seconds: int = 60) -> tuple[RareEventDraws, list[str]]:
    """A segment in which an event lasts three seconds, and what began in it."""
    draws, begun, until = RareEventDraws(seed, NATURAL, boosted), [], 0
    for second in range(seconds):
        found = draws.begins(second, some_opportunities(second, len(begun)), active=second < until)
        if found is not None:
            begun.append(found.kind)
            until = second + 3
    return draws, begun


@pytest.mark.slow
def test_the_mean_weight_is_1_at_any_fixed_time() -> None:
    for seconds in (5, 20, 60):
        weights = np.array([driven(seed, BOOSTED, seconds)[0].weight for seed in range(1500)])
        assert abs(weights.mean() - 1.0) < 4.0 * weights.std() / np.sqrt(len(weights))
        assert weights.std() > 0.05


@pytest.mark.parametrize("kind", RARE_KINDS)
def test_each_kind_begins_more_often_than_it_would_and_its_weight_makes_up_for_it(kind: RareKind) -> None:
    begun, weights = 0, np.zeros(1500)
    for seed in range(1500):
        draws = RareEventDraws(seed, {kind: 0.01}, {kind: 0.05})
        found = [draws.begins(second, {kind: ["one"]}) for second in range(20)]
        begun += sum(each is not None for each in found)
        weights[seed] = draws.weight
    assert abs(weights.mean() - 1.0) < 4.0 * weights.std() / np.sqrt(1500)
    assert begun == pytest.approx(1500, rel=0.1)


@pytest.mark.slow
def test_weighted_boosted_segments_tell_how_often_events_begin_naturally() -> None:
    boosted = [driven(seed, BOOSTED) for seed in range(1500)]
    weighted = np.array([draws.weight * len(begun) for draws, begun in boosted])
    naive = np.array([len(driven(seed, None)[1]) for seed in range(20_000, 21_500)])
    error = np.hypot(weighted.std(), naive.std()) / np.sqrt(1500)
    assert abs(weighted.mean() - naive.mean()) < 4.0 * error
    assert np.mean([len(begun) for _, begun in boosted]) > 2.0 * naive.mean()


def test_natural_probabilities_draw_as_a_naive_segment_does_with_the_weight_exactly_1() -> None:
    for seed in range(200):
        naive, begun = driven(seed, None)
        same, same_begun = driven(seed, NATURAL)
        assert same_begun == begun
        assert same.naive
        assert naive.weight == same.weight == 1.0
    assert not RareEventDraws(0, NATURAL, BOOSTED).naive


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**53 - 1), second=st.integers(0, 10_000), there=opportunities)
def test_what_is_drawn_for_an_opportunity_does_not_hang_on_the_others(
    seed: int, second: int, there: dict[RareKind, list[str]]
) -> None:
    natural = dict.fromkeys(RARE_KINDS, 0.25)

    def begins(given: Opportunities) -> BegunRareEvent | None:
        return RareEventDraws(seed, natural).begins(second, given)

    alone = {(kind, name) for kind, names in there.items() for name in names if begins({kind: [name]}) is not None}
    found = begins(there)
    turned = begins({kind: names[::-1] for kind, names in reversed(there.items())})
    assert found == turned
    assert ((found.kind, found.opportunity) in alone) if found else not alone


def test_at_most_one_is_active_and_nothing_is_drawn_meanwhile() -> None:
    draws = RareEventDraws(1, {"door": 0.01}, {"door": 0.3})
    many: Opportunities = {"door": [str(n) for n in range(100)]}
    assert draws.begins(0, many, active=True) is None
    assert (draws.weight, draws.opportunities) == (1.0, {"door": 0})
    found = draws.begins(0, many)
    assert found is not None
    assert draws.opportunities["door"] == found.passed.get("door", 0) + 1 < 100
    assert draws.begins(1, many, active=True) is None
    assert draws.weight == found.weight


def test_the_weight_at_an_event_is_that_of_the_draws_until_then() -> None:
    draws, earlier, times = RareEventDraws(7, NATURAL, BOOSTED), Counts(), 0
    for second in range(400):
        found = draws.begins(second, some_opportunities(second, 0))
        if found is not None:
            assert found.weight_before == pytest.approx(likelihood_ratio(NATURAL, BOOSTED, found.passed, earlier))
            earlier[found.kind] = earlier.get(found.kind, 0) + 1
            assert found.weight == pytest.approx(likelihood_ratio(NATURAL, BOOSTED, found.passed, earlier))
            times += 1
    assert times > 5


def test_of_opportunities_alike_none_is_preferred() -> None:
    first = [RareEventDraws(seed, {"door": 0.3}).begins(0, {"door": ["a", "b"]}) for seed in range(4000)]
    names = [each.opportunity for each in first if each is not None]
    assert names.count("a") / len(names) == pytest.approx(0.5, abs=0.04)


@pytest.mark.parametrize(
    ("natural", "boosted"),
    [(0.31, None), (-0.1, None), (0.01, 0.31), (0.01, 0.005), (0.0, 0.1), (float("nan"), None)],
)
def test_probabilities_that_weights_cannot_make_up_for_are_refused(natural: float, boosted: float | None) -> None:
    with pytest.raises(InputError, match="jaywalker"):
        RareEventDraws(0, {"jaywalker": natural}, None if boosted is None else {"jaywalker": boosted})


def test_the_bounds_themselves_are_taken() -> None:
    RareEventDraws(0, {"jaywalker": 0.3})
    RareEventDraws(0, {"jaywalker": 0.01, "door": 0.0}, {"jaywalker": 0.3})
    with pytest.raises(InputError, match="no natural probability"):
        RareEventDraws(0, {"jaywalker": 0.01}, {"door": 0.3})


def test_boosting_aims_at_so_many_events_in_a_segment_with_equal_shares() -> None:
    natural: dict[RareKind, float] = {"jaywalker": 1e-4, "cut_in": 1e-4, "door": 0.02, "blocked_lane": 0.0}
    found = boosted_for(natural, {"jaywalker": 50.0, "cut_in": 1.0, "door": 100.0, "blocked_lane": 9.0}, begun=0.9)
    assert found == pytest.approx({"jaywalker": 0.006, "cut_in": 0.3, "door": 0.02, "blocked_lane": 0.0})
    RareEventDraws(0, natural, found)
