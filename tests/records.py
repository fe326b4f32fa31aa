"""Rows and manifests of runs that nobody drove."""

from __future__ import annotations

from typing import Any

from interplan_sumo.batch.records import AppliedOverrides, Fault, JobKey, Manifest, MetricRecord, RequestedJobs, Row
from interplan_sumo.batch.run_folder import StoredRun


def row(scenario: str, score: float | None = 0.5, **changes: Any) -> Row:
    """A finished drive; without a score one that was killed."""
    fields: dict[str, Any] = {
        "scenario_id": scenario, "family": scenario.partition("/")[0], "planner": "idm", "seed": 0, "score": score,
        "metrics": {}, "gates": (), "weights": {}, "fault": Fault("timeout", "killed") if score is None else None,
        "official": True, "overrides": AppliedOverrides(), "perception": "full", "trace_hash": None, "times_s": {},
        "versions": {}, "traffic_version": 2, "reached_goal": False, "isolated": True, "planner_hash": None,
        "site": f"tiny/{scenario}", "scenario_hash": "",
        "trace": None,
    }  # fmt: skip
    return Row(**fields | changes)


def hashes(stored: StoredRun) -> dict[JobKey, object]:
    """What must come again of each drive."""
    return {key: (row.trace_hash, row.score) for key, row in stored.rows.items()}


def metric(score: float | None, detail: dict[str, Any] | None = None, reason: str | None = None) -> MetricRecord:
    return MetricRecord(score, detail or {}, reason)


def asked(planners: str = "idm", scenarios: str = "a/0 a/1 a/2", seeds: int = 1) -> RequestedJobs:
    """What was asked for, from names with blanks between them."""
    return RequestedJobs(tuple(planners.split()), tuple(scenarios.split()), seeds)


def manifest(*requests: RequestedJobs, **changes: Any) -> Manifest:
    fields: dict[str, Any] = {
        "suite": "smoke==1", "suite_hash": "1", "profile": "interplan-paper", "overrides": AppliedOverrides(),
        "versions": {"sumo": "1.28.0", "python": "3.11.7"}, "traffic_version": 2, "command": ("run",),
        "created": "2024-01-01T00:00:00Z", "platform": "", "plan_limit_s": 10.0, "requests": requests,
    }  # fmt: skip
    return Manifest(**fields | changes)
