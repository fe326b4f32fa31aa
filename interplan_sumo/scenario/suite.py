"""Suites: named, versioned sets of scenarios that never change once released; each is a folder of files.

    scenarios.yaml        its scenarios,
    selection.yaml        and those of another suite by their ids; one of the two will do
    lock.json             hashes of everything that makes them what they are, and an overview of them
    certificates.parquet  a drive for each that proves it solvable, which is also its expert
    hard.csv, parameters.csv  of scenes searched to be hard: how hard each is, for whom, and what was drawn for it

They are read, never built: what is registered later changes none of them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path
from typing import Final

import msgspec
import yaml

from interplan_sumo.errors import InputError, ScenarioError, UnknownNameError
from interplan_sumo.scenario import certificates
from interplan_sumo.scenario.certificates import Certificate, Summary
from interplan_sumo.scenario.files import read_scenarios
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.lane_changes import lane_changes_needed
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import EgoTrack

DEFAULT_SUITE: Final = "interplan==1"
"""What `run` drives if it is not told."""
SUITES_ROOT: Final = Path(str(files("interplan_sumo"))) / "scenario" / "suites"
SCENARIOS: Final = "scenarios.yaml"
SELECTION: Final = "selection.yaml"
LOCK: Final = "lock.json"


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
        return folder_of(self.key)

    def hash(self) -> str:
        """SHA-256 over the scenarios' hashes, in order of their ids."""
        lines = "\n".join(f"{s.id} {s.hash()}" for s in sorted(self.scenarios, key=lambda s: s.id))
        return hashlib.sha256(lines.encode()).hexdigest()


class _Released(Mapping[str, Suite]):
    """The suites by `name==version`, each read when it is asked for; the default one first."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._read: dict[str, Suite] = {}

    @cached_property
    def _keys(self) -> tuple[str, ...]:
        parts = (path.name.rpartition("-") for path in self._root.iterdir() if path.is_dir())
        keys = sorted(f"{name}=={version}" for name, _, version in parts if name)
        return tuple(sorted(keys, key=lambda key: key != DEFAULT_SUITE))

    def __getitem__(self, key: str) -> Suite:
        if key not in self._keys:
            raise UnknownNameError("suite", key, self._keys)
        if key not in self._read:
            name, _, version = key.partition("==")
            self._read[key] = Suite(name, int(version), self._scenarios(folder_of(key)))
        return self._read[key]

    def __contains__(self, key: object) -> bool:
        return key in self._keys

    def __iter__(self) -> Iterator[str]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)

    def _scenarios(self, folder: Path) -> tuple[Scenario, ...]:
        selection, own = folder / SELECTION, folder / SCENARIOS
        if not selection.is_file():
            return read_scenarios(own)
        chosen = yaml.safe_load(selection.read_text(encoding="utf-8"))
        there = {scenario.id: scenario for scenario in self[chosen["suite"]].scenarios}
        selected = tuple(there[scenario_id] for scenario_id in chosen["scenarios"])
        return (*selected, *read_scenarios(own)) if own.is_file() else selected


_SUITES = _Released(SUITES_ROOT)


def suites() -> Mapping[str, Suite]:
    """All suites by `name==version`, each read when it is asked for."""
    return _SUITES


def folder_of(key: str) -> Path:
    """Where the files of a suite lie."""
    return SUITES_ROOT / key.replace("==", "-")


def find_suite(key: str) -> Suite:
    """The suite `name==version`; UnknownNameError otherwise, also for a name without version."""
    return _SUITES[key]


class ScenarioOverview(msgspec.Struct, frozen=True):
    """A scenario in a few words, as lists have it: where it is and what its traffic does."""

    id: str
    family: str
    map: str
    site: str
    driving_side: str
    density: str
    behaviour: str
    lane_changes: int
    hash: str
    perception: str
    solved_by: tuple[str, ...] | None = None
    """As its certificate says; None without one."""


class MapLock(msgspec.Struct, frozen=True):
    """Hashes of a map's roads and of its SUMO network."""

    roads: str
    network: str


class ScenarioLock(msgspec.Struct, frozen=True):
    """Hashes of a scenario and of who is where when it begins."""

    scenario: str
    initial_actors: str


class SuiteLock(msgspec.Struct, frozen=True):
    """Hashes of everything that makes the scenarios of a suite what they are, and an overview of them."""

    format: int
    suite: str
    hash: str
    maps: dict[str, MapLock]
    vehicle_types: dict[str, str]
    scenarios: dict[str, ScenarioLock]
    overview: list[ScenarioOverview]


@cache
def read_lock(key: str) -> SuiteLock:
    """The lock of a suite; InputError, with the field that is wrong, if it is missing or damaged."""
    path = folder_of(key) / LOCK
    try:
        return msgspec.json.decode(path.read_bytes(), type=SuiteLock)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {path}: {error}; reinstall interplan-sumo") from error


def ids_of(key: str) -> tuple[str, ...]:
    """The ids of a suite's scenarios in their order, by its lock if it has one: then no scenario is read."""
    if (folder_of(key) / LOCK).is_file():
        return tuple(entry.id for entry in read_lock(key).overview)
    return tuple(scenario.id for scenario in _SUITES[key].scenarios)


def suites_with(scenario_id: str) -> tuple[str, ...]:
    """The suites that hold a scenario."""
    return tuple(key for key in _SUITES if scenario_id in ids_of(key))


def find_scenario(scenario_id: str) -> Scenario:
    """An official scenario by its id; UnknownNameError otherwise."""
    for key in suites_with(scenario_id):
        return next(scenario for scenario in _SUITES[key].scenarios if scenario.id == scenario_id)
    known = [id for key in _SUITES for id in ids_of(key)]
    raise UnknownNameError("scenario", scenario_id, known, "List them: interplan-sumo scenarios list")


def overview(scenario: Scenario, roads: Roads) -> ScenarioOverview:
    """What lists say of a scenario; ScenarioError if no way leads to its goal."""
    need = lane_changes_needed(roads, scenario.route, scenario.goal.lane).get(scenario.start.lane)
    if need is None:
        raise ScenarioError(f"{scenario.id}: no way from lane {scenario.start.lane} to goal lane {scenario.goal.lane}")
    proved = certificate_of(scenario.id, scenario.hash())
    return ScenarioOverview(
        scenario.id, scenario.family, scenario.map, scenario.site(roads), roads.driving_side,
        scenario.traffic.density, scenario.traffic.behaviour, need, scenario.hash(), scenario.perception,
        None if proved is None else proved.solved_by,
    )  # fmt: skip


@cache
def _certificates(folder: Path) -> dict[str, Certificate]:
    path = folder / certificates.FILE
    return certificates.read_certificates(path) if path.is_file() else {}


@cache
def _summaries(folder: Path) -> dict[str, Summary]:
    path = folder / certificates.FILE
    return certificates.read_summaries(path) if path.is_file() else {}


def expert(scenario: Scenario) -> EgoTrack:
    """The stored drive that progress is measured against; ScenarioError if the scenario has none.

    That of the certificate, whatever was overridden in the scenario.
    """
    for key in _SUITES:
        if scenario.id in _summaries(folder_of(key)):
            return _certificates(folder_of(key))[scenario.id].track
    raise ScenarioError(f"{scenario.id} has no expert drive to measure progress against")


def certificate_of(scenario_id: str, scenario_hash: str) -> Summary | None:
    """What is proved of an official scenario; None if nothing is, or if it was changed since."""
    found = [_summaries(folder_of(key)).get(scenario_id) for key in _SUITES]  # their locks may be being made
    return next((each for each in found if each is not None and each.scenario_hash == scenario_hash), None)
