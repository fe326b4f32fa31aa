"""What verifying a run found, as a table and as plain data."""

from __future__ import annotations

from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table as Grid
from rich.text import Text

from interplan_sumo.batch.verify import RowCheck, Verification


def verification_json(found: Verification) -> dict[str, Any]:
    """The finding as plain data; scores 0 to 1, as in results.jsonl."""
    return {
        "run": str(found.run.path),
        "drives": found.candidates,
        "without_score": found.left_out,
        "verified": len(found.checks),
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
        "difference": None
        if parted is None
        else {
            "frame": parted.frame,
            "time_s": round(parted.time_s, 6),
            "what": parted.what,
            "largest_m": parted.largest_m,
            "only_numbers": parted.only_numbers,
        },
        "within_bars": check.within_bars if check.verdict == "differs" else None,
        "versions": {name: {"then": then, "now": now} for name, (then, now) in check.changed_versions.items()},
    }


def verification_text(found: Verification) -> RenderableType:
    """A line per row, and below it what differs, for a terminal."""
    parted = any(check.difference for check in found.checks)
    titles = [
        "scenario",
        "planner",
        "seed",
        "verdict",
        *(("differs from", "largest") if parted else ()),
        "score",
        "now",
    ]
    grid = Grid(header_style="bold")
    for title in titles:
        grid.add_column(title, justify="right" if title in ("seed", "largest", "score", "now") else "left")
    for check in found.checks:
        cells = _cells(check)
        grid.add_row(*(cells[title] for title in titles), style="" if check.verdict == "equal" else "bold")
    parts: list[RenderableType] = [grid]
    for check in found.checks:
        if check.verdict != "equal" or check.reason:
            parts.append(Text(f"{_name(check)}: {check.verdict}: {_reason(check)}"))
    changed = {name: pair for check in found.checks for name, pair in check.changed_versions.items()}
    if changed:
        said = ", ".join(f"{name} {then} -> {now}" for name, (then, now) in changed.items())
        parts.append(Text(f"Other versions than when it was driven: {said}"))
    counts = (
        f"{found.count('equal')} of {len(found.checks)} drives come again exactly (sampled from {found.candidates})"
    )
    if found.left_out:
        counts += f"; {found.left_out} without a score were left out"
    parts.append(Text(counts))
    return Group(*parts)


def _cells(check: RowCheck) -> dict[str, Text]:
    row, parted = check.row, check.difference
    score, now = (f"{100.0 * each:.1f}" if each is not None else "-" for each in (row.score, check.score))
    cells = {
        "scenario": row.scenario_id,
        "planner": row.planner,
        "seed": str(row.seed),
        "verdict": check.verdict,
        "differs from": "" if parted is None else f"frame {parted.frame}, {parted.time_s:.1f} s",
        "largest": "" if parted is None else f"{parted.largest_m:.3g} m",
        "score": score,
        "now": now,
    }
    return {title: Text(text) for title, text in cells.items()}


def _reason(check: RowCheck) -> str:
    """Why, with the first difference and whether rounding explains it."""
    parts = [check.reason]
    if check.difference is not None:
        parts.append(check.difference.what)
    if check.verdict == "differs" and check.difference is not None:
        parts.append("within the bars (1 mm, 1e-6 in the score)" if check.within_bars else "beyond the bars")
    return "; ".join(filter(None, parts))


def _name(check: RowCheck) -> str:
    return f"{check.row.scenario_id}, {check.row.planner}, seed {check.row.seed}"
