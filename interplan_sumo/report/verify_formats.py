"""What verifying a run found, as a table and as plain data."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Final

from rich.console import Group, RenderableType
from rich.text import Text

from interplan_sumo.batch.row_check import RowCheck
from interplan_sumo.batch.verify import Verification
from interplan_sumo.report.text import drive_name, figure, grid, points

WORDS = ("scenario", "planner", "verdict", "differs from")
MEANS: Final = {"plans": "their stored plans", "planner": "their planners"}
TITLES = ("scenario", "planner", "seed", "verdict", "differs from", "largest", "score", "now")


def verification_json(found: Verification) -> dict[str, Any]:
    """The finding as plain data; scores 0 to 1, as in results.jsonl."""
    return {
        "run": str(found.run.path),
        "drives": found.candidates,
        "without_score": found.left_out,
        "verified": len(found.checks),
        "means": found.means,
        "equal": found.count("equal"),
        "differs": found.count("differs"),
        "unverifiable": found.count("unverifiable"),
        "rows": [_check_json(check) for check in found.checks],
    }


def _check_json(check: RowCheck) -> dict[str, Any]:
    row, parted = check.row, check.difference
    return {
        "scenario_id": row.scenario_id,
        "planner": row.planner,
        "seed": row.seed,
        "verdict": check.verdict,
        "reason": check.reason or None,
        "trace_hash": row.trace_hash,
        "trace_hash_now": check.trace_hash,
        "score": row.score,
        "score_now": check.score,
        "difference": parted and asdict(parted),
        "within_bars": check.within_bars if check.verdict == "differs" else None,
        "versions": {name: {"then": then, "now": now} for name, (then, now) in check.changed_versions.items()},
    }


def verification_text(found: Verification) -> RenderableType:
    """A line per row, and below it what differs, for a terminal."""
    cells = [_cells(check) for check in found.checks]
    parted = any(check.difference for check in found.checks)
    titles = [title for title in TITLES if parted or title not in ("differs from", "largest")]
    rows = [[each[title] for title in titles] for each in cells]
    table = grid(titles, rows, left=[titles.index(title) for title in WORDS if title in titles])
    for check, row in zip(found.checks, table.rows, strict=True):
        row.style = "" if check.verdict == "equal" else "bold"
    parts: list[RenderableType] = [table]
    for check in found.checks:
        if check.verdict != "equal" or check.reason:
            parts.append(Text(f"{drive_name(check.row)}: {check.verdict}: {_reason(check)}"))
    changed = {name: pair for check in found.checks for name, pair in check.changed_versions.items()}
    if changed:
        said = ", ".join(f"{name} {then} -> {now}" for name, (then, now) in changed.items())
        parts.append(Text(f"Other versions than when it was driven: {said}"))
    counts = (
        f"{found.count('equal')} of {len(found.checks)} drives come again exactly from {MEANS[found.means]} "
        f"(sampled from {found.candidates})"
    )
    if found.left_out:
        counts += f"; {found.left_out} without a score were left out"
    parts.append(Text(counts))
    return Group(*parts)


def _cells(check: RowCheck) -> dict[str, str]:
    row, parted = check.row, check.difference
    return {
        "scenario": row.scenario_id,
        "planner": row.planner,
        "seed": str(row.seed),
        "verdict": check.verdict,
        "differs from": "" if parted is None else f"frame {parted.frame}, {parted.time_s:.1f} s",
        "largest": "" if parted is None else f"{parted.largest_m:.3g} m",
        "score": figure(points(row.score)),
        "now": figure(points(check.score)),
    }


def _reason(check: RowCheck) -> str:
    """Why, with the first difference and whether rounding explains it."""
    parts = [check.reason]
    if check.difference is not None:
        parts.append(check.difference.what)
    if check.verdict == "differs" and check.difference is not None:
        parts.append("within the bars (1 mm, 1e-6 in the score)" if check.within_bars else "beyond the bars")
    return "; ".join(filter(None, parts))
