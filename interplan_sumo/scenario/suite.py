"""Suites: named, versioned sets of scenarios that never change once released, with their locks and experts."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

from interplan_sumo.errors import ScenarioError, UnknownNameError
from interplan_sumo.families import FAMILIES
from interplan_sumo.scenario import certificates
from interplan_sumo.scenario.certificates import Certificate, Summary
from interplan_sumo.scenario.files import read_scenarios
from interplan_sumo.scenario.scenario import Scenario
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
        return _folder(self.name, self.version)

    def hash(self) -> str:
        """SHA-256 over the scenarios' hashes, in order of their ids."""
        lines = "\n".join(f"{s.id} {s.hash()}" for s in sorted(self.scenarios, key=lambda s: s.id))
        return hashlib.sha256(lines.encode()).hexdigest()


def _folder(name: str, version: int) -> Path:
    return Path(str(files("interplan_sumo"))) / "scenario" / "suites" / f"{name}-{version}"


def _interplan() -> tuple[Scenario, ...]:
    return tuple(scenario for family in FAMILIES.values() for scenario in family.scenarios)


SMOKE_INDEX = {"construction": 2, "lane_change_mtd": 5, "lane_change_htd": 3}
"""Which of a family's ten stands for it in the smoke suite; 0 where none is named."""


def _smoke() -> tuple[Scenario, ...]:
    return tuple(family.scenarios[SMOKE_INDEX.get(name, 0)] for name, family in FAMILIES.items())


LLM_INDICES = (1, 5, 7)
"""Which three of a family's ten are in the suite for planners that take seconds for an answer.

Of all triples, the first of those with the most maps in a family and, among these, the most even share of maps.
"""


def _llm() -> tuple[Scenario, ...]:
    return tuple(family.scenarios[index] for family in FAMILIES.values() for index in LLM_INDICES)


def _common() -> tuple[Scenario, ...]:
    return read_scenarios(_folder("common", 1) / "scenarios.yaml")


_SUITES: dict[str, Callable[[], tuple[Scenario, ...]]] = {
    "interplan==1": _interplan,
    "common==1": _common,
    "smoke==1": _smoke,
    "llm==1": _llm,
}


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
def _certificates(folder: Path) -> dict[str, Certificate]:
    path = folder / certificates.FILE
    return certificates.read_certificates(path) if path.is_file() else {}


@cache
def _summaries(folder: Path) -> dict[str, Summary]:
    path = folder / certificates.FILE
    return certificates.read_summaries(path) if path.is_file() else {}


def _suites_with(scenario: Scenario) -> list[Suite]:
    return [suite for suite in suites().values() if any(s.id == scenario.id for s in suite.scenarios)]


def expert(scenario: Scenario) -> EgoTrack:
    """The stored drive that progress is measured against; ScenarioError if the scenario has none.

    That of the certificate, whatever was overridden in the scenario.
    """
    for suite in _suites_with(scenario):
        if scenario.id in _certificates(suite.folder):
            return _certificates(suite.folder)[scenario.id].track
    raise ScenarioError(f"{scenario.id} has no expert drive to measure progress against")


def certificate_of(scenario: Scenario) -> Summary | None:
    """What is proved of an official scenario; None if nothing is, or if it was changed since."""
    found = [_summaries(suite.folder).get(scenario.id) for suite in _suites_with(scenario)]
    return next((each for each in found if each is not None and each.scenario_hash == scenario.hash()), None)
