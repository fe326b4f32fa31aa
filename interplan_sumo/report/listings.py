"""Listings: scenarios, planners and maps as plain data, one entry each."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from interplan_sumo.errors import ScenarioError
from interplan_sumo.maps.geopackage import read_size
from interplan_sumo.maps.store import load_roads, maps
from interplan_sumo.metrics.metric import plain
from interplan_sumo.planner import planners
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import certificate_of, suites
from interplan_sumo.world.lane_changes import lane_changes_needed


def scenario_entry(scenario: Scenario) -> dict[str, Any]:
    """One scenario as `scenarios list` has it; `certificate` is null until one is stored."""
    roads = load_roads(scenario.map, scenario.maps_beside)
    need = lane_changes_needed(roads, scenario.route, scenario.goal.lane).get(scenario.start.lane)
    if need is None:
        raise ScenarioError(f"{scenario.id}: no way from lane {scenario.start.lane} to goal lane {scenario.goal.lane}")
    proved = certificate_of(scenario)
    return {
        "id": scenario.id,
        "family": scenario.family,
        "map": scenario.map,
        "site": scenario.site(roads),
        "driving_side": roads.driving_side,
        "density": scenario.traffic.density,
        "behaviour": scenario.traffic.behaviour,
        "lane_changes": need,
        "certificate": None if proved is None else asdict(proved),
        "hash": scenario.hash(),
    }


def scenario_details(scenario: Scenario) -> dict[str, Any]:
    """One scenario with everything that is staged, and the suites that it belongs to."""
    belongs = [key for key, suite in suites().items() if any(s.id == scenario.id for s in suite.scenarios)]
    return {**scenario_entry(scenario), "suites": belongs, "scenario": plain(scenario.canonical())}


def planner_entries() -> list[dict[str, Any]]:
    """Registered planners; `problem` says why one cannot be imported."""
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
    return [
        {"name": name, "path": str(files.folder), **asdict(read_size(files.gpkg, name))}
        for name, files in maps().items()
    ]


def _simple(value: Any) -> Any:
    """A default value as JSON: what has no form there as text."""
    value = plain(value)
    return value if isinstance(value, bool | int | float | str | list | dict | None) else repr(value)
