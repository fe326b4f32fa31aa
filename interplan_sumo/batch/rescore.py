"""Rescore: scores of stored traces, under any profile, without simulating."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from interplan_sumo.batch.jobs import JobKey, Overrides
from interplan_sumo.batch.own_experts import own_expert
from interplan_sumo.batch.run_folder import OWN_SCENARIOS, Row, StoredRun
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.score import PROFILES, score
from interplan_sumo.scenario.files import read_scenarios
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import expert, find_scenario
from interplan_sumo.world.trace import Trace


def rescore(
    run: StoredRun, profile: str, watch: Callable[[int, int], None] | None = None
) -> tuple[StoredRun, list[str]]:
    """The run under another profile, and what stood in the way of the rows that it now lacks.

    A planner's fault stays a zero. `watch` is told how many rows are done, of how many.
    """
    if profile not in PROFILES:
        raise UnknownNameError("scoring profile", profile, PROFILES)
    overrides = Overrides(
        density=run.manifest["overrides"].get("density"), behaviour=run.manifest["overrides"].get("behaviour")
    )
    own = own_scenarios(run)
    rows: dict[JobKey, Row] = {}
    problems: list[str] = []
    for number, (key, row) in enumerate(run.rows.items(), start=1):
        try:
            rows[key] = row if row["fault"] else row | _scored(run, row, own, overrides, profile)
        except InputError as error:
            problems.append(str(error))
        if watch is not None:
            watch(number, len(run.rows))
    return replace(run, manifest=run.manifest | {"profile": profile}, rows=rows), problems


def own_scenarios(run: StoredRun) -> dict[str, Scenario]:
    """The scenarios of a run by id, if they belong to no suite; nothing for a run of a suite."""
    path = run.path / OWN_SCENARIOS
    return {scenario.id: scenario for scenario in read_scenarios(path)} if path.is_file() else {}


def _scored(run: StoredRun, row: Row, own: dict[str, Scenario], overrides: Overrides, profile: str) -> dict[str, Any]:
    found = own.get(row["scenario_id"])
    scenario = overrides.applied(find_scenario(row["scenario_id"]) if found is None else found)
    older = [name for name in ("scenario_hash", "trace", "trace_hash") if name not in row]
    if older:
        raise InputError(
            f"{run.path / 'results.jsonl'}: the line of {scenario.id}, seed {row['seed']}, has no {older[0]}; "
            "an older version wrote it: score it with that one, or delete the line and repeat the run"
        )
    if scenario.hash() != row["scenario_hash"]:
        raise InputError(
            f"{run.path}: scenario {scenario.id} has changed since it was driven; use the version that drove it"
        )
    folder = run.path / row["trace"]
    trace = Trace.read(folder)
    if trace.hash() != row["trace_hash"]:
        raise InputError(
            f"{folder}: the trace is not the one that was driven; delete its line in results.jsonl and repeat the run"
        )
    reference = expert(scenario) if found is None else own_expert(found, run.path)
    return score(trace, load_roads(scenario.map, scenario.maps_beside), reference, scenario, profile).as_json()
