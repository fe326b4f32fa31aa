"""Balance: as many of each group as can be, and never more than asked for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_sumo.dataset.balance import balanced, spread


def test_the_choice_is_drawn_and_equal_seeds_draw_alike() -> None:
    groups = np.zeros(100, dtype=np.int64)
    one, same, other = (balanced(groups, 10, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert one.tolist() == same.tolist()
    assert one.tolist() != other.tolist()


@given(st.lists(st.integers(0, 4), max_size=60), st.integers(0, 80))
def test_no_group_lacks_what_another_has_two_more_of(groups: list[int], count: int) -> None:
    table = np.array(groups, dtype=np.int64)
    taken = balanced(table, count, np.random.default_rng(7))
    assert len(taken) == len(set(taken.tolist())) == min(count, len(groups))
    assert (np.diff(taken) > 0).all()
    of_each, held = np.bincount(table[taken], minlength=5), np.bincount(table, minlength=5)
    short = of_each < held
    assert not short.any() or of_each.max() <= of_each[short].min() + 1


@pytest.mark.parametrize(("count", "found"), [(0, []), (2, [0, 1]), (3, [0, 1, 2]), (9, [0, 4, 8])])
def test_a_few_are_spread_over_all(count: int, found: list[int]) -> None:
    assert spread(np.arange(count), 3).tolist() == found
