"""Random scenarios with a reckless ego: nobody overlaps, jumps or vanishes, and equal runs are equal to the bit."""

from __future__ import annotations

import numpy as np
import pytest
from random_drives import Audit, audited, random_scenario

from interplan_sumo.maps.store import maps
from tests.quick import few

MAPS = sorted(maps())


def pair(number: int, *, steps: int, obstacles: bool, jaywalker: bool) -> tuple[Audit, Audit]:
    scenario = random_scenario(
        MAPS[number % len(MAPS)], np.random.default_rng(number), number, obstacles=obstacles, jaywalker=jaywalker
    )
    first, second = (audited(scenario, seed=number, steps=steps) for _ in range(2))
    return first, second


@pytest.mark.parametrize("number", few(range(3), 1))
def test_a_reckless_ego_upsets_nobody_else_and_equal_runs_are_equal(number: int) -> None:
    first, second = pair(number, steps=150, obstacles=number % 2 == 0, jaywalker=number % 3 == 0)
    assert first.faults == []
    assert first.hash == second.hash


@pytest.mark.nightly
@pytest.mark.parametrize("obstacles", [False, True])
@pytest.mark.parametrize("number", range(100))
def test_a_hundred_reckless_egos_upset_nobody_else(number: int, obstacles: bool) -> None:
    first, second = pair(number, steps=300, obstacles=obstacles, jaywalker=obstacles)
    assert first.faults == []
    assert first.hash == second.hash
