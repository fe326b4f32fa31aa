"""Formats of a comparison: JSON for programs, text for a terminal."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table as Grid
from rich.text import Text

from interplan_sumo.report.compare import Comparison, DriveKey, GroupComparison

LISTED = 10
"""So many changes and missing drives are listed on a terminal; the rest is counted."""


def comparison_json(found: Comparison) -> dict[str, Any]:
    """The comparison as plain data; scores 0 to 100, differences are b less a."""
    return {
        "a": found.a,
        "b": found.b,
        "suite": found.suite,
        "profile": found.profile,
        "complete": found.complete,
        "overall": _share_json(found.overall),
        "families": {family: _share_json(share) for family, share in found.families.items()},
        "changes": [
            {
                "scenario_id": c.scenario_id,
                "family": c.family,
                "seed": c.seed,
                "a": _rounded(100.0 * c.a),
                "b": _rounded(100.0 * c.b),
                "difference": _rounded(100.0 * c.difference),
                "winner": c.winner,
                "reason": c.reason or None,
            }
            for c in found.changes
        ],
        "missing": {"a": _keys_json(found.missing_a), "b": _keys_json(found.missing_b)},
    }


def _share_json(share: GroupComparison) -> dict[str, Any]:
    return {key: _rounded(value) for key, value in asdict(share).items()}


def _keys_json(keys: Iterable[DriveKey]) -> list[dict[str, Any]]:
    return [{"scenario_id": scenario, "seed": seed} for scenario, seed in keys]


def _rounded(value: Any) -> Any:
    match value:
        case float():
            return round(value, 4)
        case tuple():
            return [_rounded(part) for part in value]
        case _:
            return value


def comparison_text(found: Comparison) -> RenderableType:
    """The table, what changed most and why, and what is missing, for a terminal."""
    grid = Grid(header_style="bold")
    for number, title in enumerate(("", "scenarios", "drives", "a", "b", "b - a", "95 %", "won", "lost", "tied")):
        grid.add_column(title, justify="right" if number else "left")
    for name, share in {"all": found.overall, **found.families}.items():
        interval = "-" if share.interval is None else "[{:+.1f}, {:+.1f}]".format(*share.interval)
        figures = [_figure(share.a), _figure(share.b), _figure(share.difference, "+"), interval]
        counts = [share.wins, share.losses, share.ties]
        texts = [name, str(share.scenarios), str(share.drives), *figures, *map(str, counts)]
        grid.add_row(*map(Text, texts), end_section=name == "all")
    parts: list[RenderableType] = [
        Text(f"a  {found.a}\nb  {found.b}"),
        grid,
        Text(
            f"Suite {found.suite}, profile {found.profile}, scores 0 to 100, paired on equal scenario and seed; "
            "won: b is better. Brackets: bootstrap interval of the mean difference over scenarios (over the seeds of a "
            "single one)."
        ),
    ]
    changed = [
        f"{c.difference * 100.0:+6.1f}  {c.scenario_id}, seed {c.seed}: {c.a * 100.0:.1f} -> {c.b * 100.0:.1f}; "
        f"{c.reason}"
        for c in found.changes
        if c.reason
    ]
    for title, entries in (
        ("Changed most (the worse one and why)", changed),
        ("No score in a", [f"{scenario}, seed {seed}" for scenario, seed in found.missing_a]),
        ("No score in b", [f"{scenario}, seed {seed}" for scenario, seed in found.missing_b]),
    ):
        if entries:
            parts.append(Text(f"\n{title} ({len(entries)})", style="bold"))
            parts += [Text(f"  {entry}") for entry in entries[:LISTED]]
            if len(entries) > LISTED:
                parts.append(Text(f"  ... and {len(entries) - LISTED} more; --json lists all"))
    if not found.complete:
        parts.append(Text("\nINCOMPLETE: the drives without a score are left out on both sides."))
    return Group(*parts)


def _figure(value: float | None, sign: str = "") -> str:
    return "-" if value is None else f"{value:{sign}.1f}"
