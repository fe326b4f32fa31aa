"""Scenes at places that tests know: unlike those of the suites they stay when a suite is made anew."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from interplan_sumo.scenario.files import read_scenarios
from interplan_sumo.scenario.scenario import Scenario


@cache
def _scenes() -> dict[str, Scenario]:
    return {scenario.id: scenario for scenario in read_scenarios(Path(__file__).with_suffix(".yaml"))}


def scene(id: str) -> Scenario:
    """One by its id, which may be that of another scene in a suite."""
    return _scenes()[id]
