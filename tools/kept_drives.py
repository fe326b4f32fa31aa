"""Kept drives: those that the tables of README and docs are made from, by suite, as small as tables need them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec

from interplan_sumo.batch.records import Manifest
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.world.csv_tables import read_table
from tools.hard_scores import RESULTS

OURS: Final = "interplan_sumo"
"""Among the versions of a manifest."""
GOAL_LANE: Final = "lane_changes"
KEPT: Final = ("goal",)
"""Of its details: whether the drive ended in the goal lane."""
COUNTED: Final = ("queries", "fallbacks")
"""Of what a planner reports: how often it asked a language model, and how often in vain."""


def folder_of(suite: str) -> Path:
    """Where the drives of a suite are kept."""
    return RESULTS / suite.replace("==", "-")


def complete_run(folder: Path) -> StoredRun:
    """A run whose drives may be kept; ends the program if some of them have no score."""
    run = read_run(folder)
    if run.missing:
        raise SystemExit(f"{folder} has no score for {len(run.missing)} of its drives; complete it first")
    return run


def refuse_others(folder: Path, suite: str, found: Iterable[Manifest]) -> None:
    """End the program if what was found in a folder is of another suite, or of other traffic than its kept drives."""
    plain = traffic_of(suite)
    for about in found:
        if about.suite != suite:
            raise SystemExit(f"{folder} is of {about.suite}, expected {suite}")
        refuse_other_traffic(folder, about, plain)


def traffic_of(suite: str) -> int:
    """The version of the traffic of a suite's kept drives."""
    return read_run(folder_of(suite)).manifest.traffic_version


def refuse_other_traffic(folder: Path, about: Manifest, plain: int) -> None:
    """End the program if what was found in a folder is of other traffic than the kept drives."""
    if about.traffic_version != plain:
        other = about.traffic_version
        raise SystemExit(f"{folder} is of traffic version {other}, the kept drives are of {plain}; drive it anew")


def renewed(table: Path, columns: Sequence[str], fresh: Iterable[Sequence[str]]) -> list[tuple[str, ...]]:
    """The lines of a kept table with these among them, in place of former ones of the same planners (first column)."""
    lines = [tuple(line) for line in fresh]
    again = {planner for planner, *_ in lines}
    held = read_table(table, columns) if table.is_file() else []
    lines += [tuple(line[name] for name in columns) for line in held if line[columns[0]] not in again]
    return sorted(lines)


def take(folder: Path) -> None:
    """Keep the drives of a run folder, by planner and scene, as small as tables need them, beside those of others."""
    run = complete_run(folder)
    results = folder_of(run.manifest.suite)
    about = msgspec.json.decode((folder / "manifest.json").read_bytes())
    for planner in about["planners"].values():
        planner["files"] = {}
    rows = {key: _small(msgspec.to_builtins(run.rows[key])) for key in run.keys}
    if (results / "manifest.json").is_file():
        rows |= {key: msgspec.to_builtins(row) for key, row in read_run(results).rows.items() if key not in rows}
        about = _beside(msgspec.json.decode((results / "manifest.json").read_bytes()), about)
    about["command"] = ["interplan-sumo", "run", "--suite", run.manifest.suite]
    about["command"] += [word for name in about["planners"] for word in ("--planner", name)]
    about["platform"] = about["platform"].partition("-")[0]
    results.mkdir(parents=True, exist_ok=True)
    (results / "manifest.json").write_bytes(msgspec.json.format(msgspec.json.encode(about), indent=1) + b"\n")
    with (results / "results.jsonl").open("wb") as file:
        for key in sorted(rows):
            file.write(msgspec.json.encode(rows[key]) + b"\n")


def _beside(held: dict[str, Any], fresh: dict[str, Any]) -> dict[str, Any]:
    """The manifest of what is held with fresh planners in it; ends the program if both cannot stand side by side.

    Of which version the program was does not matter: suite, traffic and scoring have their own.
    """
    for name in ("suite_hash", "profile", "versions", "traffic_version", "plan_limit_s"):
        then, now = ({**about[name], OURS: ""} if name == "versions" else about[name] for about in (held, fresh))
        if then != now:
            raise SystemExit(f"the drives that are held have {name} {held[name]}, these {fresh[name]}: drive all anew")
    planners = held["planners"] | fresh["planners"]
    requests = [request | {"planners": [*planners]} for request in fresh["requests"]]
    return held | {
        "planners": planners, "requests": requests, "created": fresh["created"], "versions": fresh["versions"],
    }  # fmt: skip


def _small(row: dict[str, Any]) -> dict[str, Any]:
    judged = {*row["gates"], *row["weights"], GOAL_LANE}
    metrics = {name: metric for name, metric in row["metrics"].items() if name in judged}
    for metric in metrics.values():
        metric["detail"] = {name: metric["detail"][name] for name in KEPT if name in metric["detail"]}
    report = row.pop("planner_report", None) or {}
    asked = {name: report[name] for name in COUNTED if report.get(name) is not None}
    small = row | {"metrics": metrics, "trace": None, "versions": {}, "times_s": {}}
    return small | ({"planner_report": asked} if asked else {})
