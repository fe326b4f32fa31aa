"""Audit of a run: a finding for each of its scenarios."""

from __future__ import annotations

from collections.abc import Iterator

from interplan_sumo.batch.jobs import Overrides
from interplan_sumo.batch.rescore import own_scenarios
from interplan_sumo.batch.run_folder import Row, StoredRun
from interplan_sumo.maps.store import load_roads
from interplan_sumo.proving.audit import Finding, finding
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.world.trace import Trace


def findings(run: StoredRun, below: float | None = None) -> Iterator[tuple[Row, Finding]]:
    """A finding for every row with a trace, in order; only rows that score less than `below` (0 to 100), if given."""
    own = own_scenarios(run)
    overrides = Overrides(
        density=run.manifest["overrides"].get("density"), behaviour=run.manifest["overrides"].get("behaviour")
    )
    for key in sorted(run.rows):
        row = run.rows[key]
        if row["score"] is None or not row.get("trace") or "no_collision" not in row["metrics"]:
            continue
        if below is not None and 100.0 * row["score"] >= below:
            continue
        scenario = overrides.applied(own.get(key[0]) or find_scenario(key[0]))
        trace = Trace.read(run.path / row["trace"])
        detail = row["metrics"]["no_collision"].get("detail", {})
        yield row, finding(scenario, load_roads(scenario.map, scenario.maps_beside), trace, detail)
