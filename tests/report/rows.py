"""Makers of stored runs for the report's tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from interplan_sumo.batch.results import Row, row_key
from interplan_sumo.batch.run_folder import StoredRun

GATES = ["no_collision", "drivable_area", "making_progress"]
WEIGHTS = {"progress": 5.0, "lane_changes": 4.0}


def drive(scenario: str, score: float | None, *, planner: str = "idm", seed: int = 0, **changes: Any) -> Row:
    """One finished drive; `changes` are metric scores by name, or `fault=(class, message)`."""
    family = scenario.partition("/")[0]
    fault = changes.pop("fault", None)
    reasons = {name: changes.pop(f"{name}_because") for name in list(GATES) if f"{name}_because" in changes}
    metrics = {
        name: {"score": changes.get(name, 1.0), "detail": {}, "reason": reasons.get(name)}
        for name in (*GATES, *WEIGHTS)
    }
    metrics["lane_changes"]["detail"] = {"goal": metrics["lane_changes"]["score"] == 1.0}
    return {
        "scenario_id": scenario,
        "family": family,
        "planner": planner,
        "seed": seed,
        "score": score,
        "metrics": {} if fault else metrics,
        "gates": [] if fault else GATES,
        "weights": {} if fault else WEIGHTS,
        "fault": {"class": fault[0], "message": fault[1]} if fault else None,
        "reached_goal": score is not None and score > 0.0,
    }


def stored(*rows: Row, missing: tuple[str, ...] = (), path: str = "runs/a", **manifest: Any) -> StoredRun:
    """A run of exactly these rows, and scenarios that `idm` has not driven yet."""
    requests = [{"planners": [r["planner"]], "scenarios": [r["scenario_id"]], "seeds": r["seed"] + 1} for r in rows]
    requests += [{"planners": ["idm"], "scenarios": list(missing), "seeds": 1}]
    held = {"suite": "smoke==1", "suite_hash": "1", "profile": "interplan-paper", "overrides": {}, "requests": requests}
    return StoredRun(Path(path), held | manifest, {row_key(row): row for row in rows})
