"""What an audit found, as a table and as plain data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from interplan_sumo.batch.records import Row
from interplan_sumo.report.failure_reasons import lost_points
from interplan_sumo.report.text import grid
from interplan_sumo.verification.audit import DEFECTS, AuditFinding, classes


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


def audit_text(entry: dict[str, Any]) -> RenderableType:
    """The counts, then a line for every defect, and for every scenario if they were chosen by score."""
    chosen = "" if entry["below"] is None else f" with less than {entry['below']:g} points"
    whole = max(1, entry["scenarios"])
    rows = [[name, str(count), f"{100.0 * count / whole:.0f} %"] for name, count in entry["classes"].items()]
    table = grid(("class", "scenarios", "share"), rows)
    table.title = f"{entry['suite']}: {entry['scenarios']} scenarios{chosen}, driven by {entry['planner']}"
    for row, (name, count) in zip(table.rows, entry["classes"].items(), strict=True):
        row.style = "bold" if name in DEFECTS and count else ""
    told = [
        f"{each['scenario_id']}: {each['class']}, {each['score']} points: {'; '.join(each['details'] or each['lost'])}"
        for each in entry["findings"]
        if each["class"] in DEFECTS or entry["below"] is not None
    ]
    return Group(table, *map(Text, told))
