"""Audit of a run: a finding for each of its scenarios, as a table and as plain data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from interplan_sumo.batch.records import Row
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.batch.stored_drive import StoredDrives
from interplan_sumo.errors import counted
from interplan_sumo.report.failure_reasons import lost_points
from interplan_sumo.report.standing_formats import BRACKETS
from interplan_sumo.report.text import figure, grid, rounded
from interplan_sumo.statistics.intervals import POINTS, mean_interval
from interplan_sumo.statistics.scene_values import DriveValue, mean_over_scenes
from interplan_sumo.verification.audit import DEFECTS, AuditFinding, classes, finding


def findings(run: StoredRun, below: float | None = None) -> Iterator[tuple[Row, AuditFinding]]:
    """A finding for every row with a trace, in order; only rows that score less than `below` (0 to 100), if given."""
    drives = StoredDrives(run)
    briefs = run.briefs
    for key in sorted(run.rows):
        score = briefs[key].score
        if score is None or (below is not None and 100.0 * score >= below):
            continue
        row = run.rows[key]
        if row.trace is None or "no_collision" not in row.metrics:
            continue
        drive = drives.read(row)
        yield row, finding(drive.scenario, drive.roads, drive.trace, row.metrics["no_collision"].detail)


def audit_json(
    suite: str, planner: str, below: float | None, found: Sequence[tuple[Row, AuditFinding]]
) -> dict[str, Any]:
    """Counts per class, and every scenario with its class and the reasons for lost points."""
    counts = Counter(each.kind for _, each in found)
    return {
        "suite": suite,
        "planner": planner,
        "below": below,
        "scenarios": len(found),
        "classes": {name: counts[name] for name in (*DEFECTS, *classes())},
        "shares": {name: _share_json(name, found) for name in (*DEFECTS, *classes())},
        "findings": [
            {
                "scenario_id": each.scenario_id,
                "class": each.kind,
                "score": round(100.0 * (row.score or 0.0), 1),
                "details": list(each.details),
                "lost": lost_points(row),
            }
            for row, each in found
        ],
    }


def _share_json(kind: str, found: Sequence[tuple[Row, AuditFinding]]) -> dict[str, Any]:
    """How many percent of the scenarios are of a class, with the 95 % interval for scenarios like these."""
    drives = {
        (row.scenario_id, row.seed): DriveValue(row.family, 100.0 * (each.kind == kind), row.site)
        for row, each in found
    }
    interval = mean_interval(drives, POINTS)
    return {
        "percent": rounded(mean_over_scenes(drives)),
        "ci": None if interval is None else [rounded(bound) for bound in interval],
    }


def audit_text(entry: dict[str, Any]) -> RenderableType:
    """The counts, then a line for every defect, and for every scenario if they were chosen by score."""
    chosen = "" if entry["below"] is None else f" with less than {entry['below']:g} points"
    rows = [[name, str(count), *_share(entry["shares"][name])] for name, count in entry["classes"].items()]
    table = grid(("class", "scenarios", "share", "95 %"), rows)
    table.title = f"{entry['suite']}: {counted(entry['scenarios'], 'scenario')}{chosen}, driven by {entry['planner']}"
    for row, (name, count) in zip(table.rows, entry["classes"].items(), strict=True):
        row.style = "bold" if name in DEFECTS and count else ""
    told = [
        f"{each['scenario_id']}: {each['class']}, {each['score']} points: {'; '.join(each['details'] or each['lost'])}"
        for each in entry["findings"]
        if each["class"] in DEFECTS or entry["below"] is not None
    ]
    notes = [f"95 %: {BRACKETS}"] if any(share["ci"] for share in entry["shares"].values()) else []
    return Group(table, *map(Text, (*notes, *told)))


def _share(share: dict[str, Any]) -> tuple[str, str]:
    interval = "-" if share["ci"] is None else "[{:.0f}, {:.0f}]".format(*share["ci"])
    return f"{figure(share['percent'], '.0f')} %", interval
