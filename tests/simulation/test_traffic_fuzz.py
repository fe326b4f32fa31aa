"""Twenty thousand agent-seconds of random traffic around rude egos: no vehicle does what none can."""

from __future__ import annotations

import pytest

from benchmarks.traffic_fuzz import broken, fuzz, imported_maps, summary
from tests.simulation.fuzz_cases import SHIPPED_MAPS, Maps

SEED = 23
AGENT_S = 20_000.0
STEPS = 300


@pytest.mark.nightly
def test_no_vehicle_does_what_none_can_whatever_the_ego_does() -> None:
    """The message has the command that repeats a drive; a million in `make nightly`."""
    maps = Maps((*SHIPPED_MAPS, *imported_maps()))
    reports = fuzz(AGENT_S, seed=SEED, maps=maps, steps=STEPS, workers=1, quiet=True)
    assert broken(reports) == [], summary(reports, SEED, maps, STEPS)
