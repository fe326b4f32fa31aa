"""Listings: scenarios, planners and maps as plain data, one entry each; none waits for what another needs."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from msgspec import structs

from interplan_sumo.errors import UnknownNameError
from interplan_sumo.metrics.metric import plain

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from interplan_sumo.scenario.certificates import Summary
    from interplan_sumo.scenario.scenario import Scenario


def suite_entries(suite: str | None = None) -> list[dict[str, Any]]:
    """The scenarios of a suite, or of all, as `scenarios list` has them: by their locks, no map is opened.

    UnknownNameError if there is no such suite.
    """
    from interplan_sumo.scenario.difficulty import read_difficulties
    from interplan_sumo.scenario.suite import folder_of, read_lock, suites

    if suite is not None and suite not in suites():
        raise UnknownNameError("suite", suite, suites())
    keys = suites() if suite is None else (suite,)
    found = {each.id: structs.asdict(each) for key in keys for each in read_lock(key).overview}
    hard = {name: share for key in keys for name, share in read_difficulties(folder_of(key)).items()}
    return [_with_difficulty(each, hard) for each in found.values()]


def file_entries(place: Path) -> list[dict[str, Any]]:
    """The scenarios of a file, or of a folder that holds one, as `certified` has them; certificates lie beside it.

    ScenarioError if it cannot be read, or a scenario in it cannot be driven.
    """
    from interplan_sumo.verification.generation import SCENARIOS

    return [entry for _, entry in _in_file(place / SCENARIOS if place.is_dir() else place)]


def _in_file(file: Path) -> Iterator[tuple[Scenario, dict[str, Any]]]:
    from interplan_sumo.scenario import certificates
    from interplan_sumo.scenario.difficulty import read_difficulties
    from interplan_sumo.scenario.files import read_scenarios

    beside = file.parent / certificates.FILE
    held = certificates.read_summaries(beside) if beside.is_file() else {}
    hard = read_difficulties(file.parent)
    for scenario in read_scenarios(file):
        entry = _with_difficulty(_entry(scenario), hard)
        proved = held.get(scenario.id)
        if proved is not None and proved.scenario_hash == entry["hash"]:
            yield scenario, _with_certificate({**entry, "solved_by": proved.solved_by}, proved)
        else:
            yield scenario, certified(entry)


def _entry(scenario: Scenario) -> dict[str, Any]:
    from interplan_sumo.maps.store import load_roads
    from interplan_sumo.scenario.suite import overview

    return structs.asdict(overview(scenario, load_roads(scenario.map, scenario.maps_beside)))


def _with_difficulty(entry: dict[str, Any], hard: Mapping[str, float]) -> dict[str, Any]:
    """Among hard scenes an entry says how hard it is, or that nobody knows."""
    return {**entry, "difficulty": hard.get(entry["id"])} if hard else entry


def certified(entry: dict[str, Any]) -> dict[str, Any]:
    """An entry with its certificate, null until one is stored, before the hash."""
    from interplan_sumo.scenario.suite import certificate_of

    return _with_certificate(entry, certificate_of(entry["id"], entry["hash"]))


def _with_certificate(entry: dict[str, Any], proved: Summary | None) -> dict[str, Any]:
    summary = None if proved is None else asdict(proved)
    if summary is not None:
        del summary["solved_by"]  # the entry has it
    shown = {name: value for name, value in entry.items() if name != "hash"}
    return {**shown, "certificate": summary, "hash": entry["hash"]}


def in_words(entry: dict[str, Any]) -> dict[str, Any]:
    """An entry for people: who solves it as a text."""
    from interplan_sumo.scenario.certificates import solvers_in_words

    return {**entry, "solved_by": solvers_in_words(entry["solved_by"])}


def scenario_details(scenario: Scenario) -> dict[str, Any]:
    """One scenario with everything that is staged, and the suites that it belongs to as it is."""
    return _with_details(scenario, certified(_entry(scenario)))


def file_details(file: Path) -> list[dict[str, Any]]:
    """The same of all scenarios of a file, with the certificates beside it; ScenarioError as from `file_entries`."""
    return [_with_details(scenario, entry) for scenario, entry in _in_file(file)]


def _with_details(scenario: Scenario, entry: dict[str, Any]) -> dict[str, Any]:
    from interplan_sumo.scenario.suite import read_lock, suites_with

    suites = [
        key for key in suites_with(scenario.id) if read_lock(key).scenarios[scenario.id].scenario == entry["hash"]
    ]
    return {**entry, "suites": suites, "scenario": plain(scenario.canonical())}


def planner_entries() -> list[dict[str, Any]]:
    """Registered planners; `problem` says why one cannot be imported."""
    from interplan_sumo.planner import planners

    entries: list[dict[str, Any]] = []
    for info in planners():
        entry: dict[str, Any] = {
            "name": info.name,
            "source": info.source,
            "paper": info.paper,
            "parameters": {name: _simple(value) for name, value in info.parameters.items()},
            "recommended": info.recommended,
        }
        entries.append(entry if info.problem is None else {**entry, "problem": info.problem})
    return entries


def map_entries() -> list[dict[str, Any]]:
    """The shipped maps with their size."""
    from interplan_sumo.maps.geopackage import read_size
    from interplan_sumo.maps.store import maps

    return [
        {"name": name, "path": str(files.folder), **asdict(read_size(files.gpkg, name))}
        for name, files in maps().items()
    ]


def _simple(value: Any) -> Any:
    """A default value as JSON: what has no form there as text."""
    value = plain(value)
    return value if isinstance(value, bool | int | float | str | list | dict | None) else repr(value)
