"""Makers of stored runs for the report's tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from interplan_sumo.batch.records import AppliedOverrides, Fault, MetricRecord, RequestedJobs, Row
from interplan_sumo.batch.run_folder import StoredRun
from tests import records
from tests.records import manifest

GATES = ("no_collision", "drivable_area", "making_progress")
WEIGHTS = {"progress": 5.0, "lane_changes": 4.0}


def drive(scenario: str, score: float | None, *, planner: str = "idm", seed: int = 0, **changes: Any) -> Row:
    """One finished drive; `changes` are metric scores by name, their `..._detail` or `..._because`, or
    `fault=(class, message)`."""
    fault = changes.pop("fault", None)
    metrics = {
        name: MetricRecord(
            changes.pop(name, 1.0), changes.pop(f"{name}_detail", {}), changes.pop(f"{name}_because", None)
        )
        for name in (*GATES, *WEIGHTS)
    }
    metrics["lane_changes"].detail.setdefault("goal", metrics["lane_changes"].score == 1.0)
    return records.row(
        scenario,
        score,
        planner=planner,
        seed=seed,
        metrics={} if fault else metrics,
        gates=() if fault else GATES,
        weights={} if fault else WEIGHTS,
        fault=Fault(*fault) if fault else Fault("timeout", "killed") if score is None else None,
        reached_goal=score is not None and score > 0.0,
        **changes,
    )


def stored(*rows: Row, missing: tuple[str, ...] = (), path: str = "runs/a", **changes: Any) -> StoredRun:
    """A run of exactly these rows, and scenarios that `idm` has not driven yet."""
    requests = [RequestedJobs((row.planner,), (row.scenario_id,), row.seed + 1) for row in rows]
    requests += [RequestedJobs(("idm",), missing, 1)]
    if "overrides" in changes:
        changes["overrides"] = AppliedOverrides(**changes["overrides"])
    return StoredRun(Path(path), manifest(*requests, **changes), {row.key: row for row in rows})
