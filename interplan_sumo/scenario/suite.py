"""Suites: named, versioned sets of scenarios that never change once released, with their locks and experts."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

import pandas as pd

from interplan_sumo.errors import InputError, ScenarioError, UnknownNameError
from interplan_sumo.scenario.families import FAMILIES
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.trace import EgoTrack

DEFAULT_SUITE = "interplan==1"
"""What `run` drives if it is not told."""


@dataclass(frozen=True, slots=True)
class Suite:
    """A named, versioned set of scenarios."""

    name: str
    version: int
    scenarios: tuple[Scenario, ...]

    @property
    def key(self) -> str:
        """`name==version`, as the command line has it."""
        return f"{self.name}=={self.version}"

    @property
    def folder(self) -> Path:
        """Where the lock and the experts of the suite lie."""
        return Path(str(files("interplan_sumo"))) / "scenario" / "suites" / f"{self.name}-{self.version}"

    def hash(self) -> str:
        """SHA-256 over the scenarios' hashes, in order of their ids."""
        lines = "\n".join(f"{s.id} {s.hash()}" for s in sorted(self.scenarios, key=lambda s: s.id))
        return hashlib.sha256(lines.encode()).hexdigest()


def _interplan() -> tuple[Scenario, ...]:
    return tuple(scenario for family in FAMILIES.values() for scenario in family.scenarios)


SMOKE_INDEX = {"construction": 2, "lane_change_mtd": 5, "lane_change_htd": 3}
"""Which of a family's ten stands for it in the smoke suite; 0 where none is named."""


def _smoke() -> tuple[Scenario, ...]:
    return tuple(family.scenarios[SMOKE_INDEX.get(name, 0)] for name, family in FAMILIES.items())


_SUITES: dict[str, Callable[[], tuple[Scenario, ...]]] = {"interplan==1": _interplan, "smoke==1": _smoke}


@cache
def suites() -> dict[str, Suite]:
    """All suites by `name==version`."""
    found: dict[str, Suite] = {}
    for key, scenarios in _SUITES.items():
        name, _, version = key.partition("==")
        found[key] = Suite(name, int(version), scenarios())
    return found


def find_suite(key: str) -> Suite:
    """The suite `name==version`; UnknownNameError otherwise, also for a name without version."""
    known = suites()
    if key not in known:
        raise UnknownNameError("suite", key, known)
    return known[key]


def find_scenario(scenario_id: str) -> Scenario:
    """An official scenario by its id; UnknownNameError otherwise."""
    known = {s.id: s for suite in suites().values() for s in suite.scenarios}
    if scenario_id not in known:
        raise UnknownNameError("scenario", scenario_id, known, "List them: interplan-sumo scenarios list")
    return known[scenario_id]


@cache
def _experts(folder: Path) -> dict[str, pd.DataFrame]:
    path = folder / "experts.parquet"
    try:
        table = pd.read_parquet(path)
    except Exception as error:
        raise InputError(f"cannot read the expert drives at {path}: {error}; reinstall interplan-sumo") from error
    return {str(name): rows for name, rows in table.groupby("scenario_id", observed=True)}


def expert(scenario: Scenario) -> EgoTrack:
    """The stored drive that progress is measured against; ScenarioError if the scenario has none."""
    for suite in suites().values():
        if any(s.id == scenario.id for s in suite.scenarios):
            rows = _experts(suite.folder).get(scenario.id)
            if rows is not None:
                return EgoTrack.from_frame(rows, PACIFICA)
    raise ScenarioError(f"{scenario.id} has no expert drive to measure progress against")
