"""Formats of a comparison: JSON for programs, text for a terminal."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from interplan_sumo.report.compare import Comparison, DriveKey, GroupComparison
from interplan_sumo.report.text import figure, grid, listed, rounded

LISTED = 10
"""So many changes and missing drives are listed on a terminal."""


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
                "a": rounded(100.0 * c.a),
                "b": rounded(100.0 * c.b),
                "difference": rounded(100.0 * c.difference),
                "winner": c.winner,
                "reason": c.reason or None,
            }
            for c in found.changes
        ],
        "missing": {"a": _keys_json(found.missing_a), "b": _keys_json(found.missing_b)},
    }


def _share_json(share: GroupComparison) -> dict[str, Any]:
    figures = {name: rounded(getattr(share, name)) for name in ("a", "b", "difference")}
    interval = None if share.interval is None else [rounded(bound) for bound in share.interval]
    return {**asdict(share), **figures, "interval": interval}


def _keys_json(keys: Iterable[DriveKey]) -> list[dict[str, Any]]:
    return [{"scenario_id": scenario, "seed": seed} for scenario, seed in keys]


def comparison_text(found: Comparison) -> RenderableType:
    """The table, what changed most and why, and what is missing, for a terminal."""
    shares = {"all": found.overall, **found.families}
    titles = ("", "scenarios", "drives", "a", "b", "b - a", "95 %", "won", "lost", "tied")
    table = grid(titles, [[name, *_cells(share)] for name, share in shares.items()])
    table.rows[0].end_section = True
    parts: list[RenderableType] = [
        Text(f"a  {found.a}\nb  {found.b}"),
        table,
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
        parts += listed(title, entries[:LISTED], len(entries))
    if not found.complete:
        parts.append(Text("\nINCOMPLETE: the drives without a score are left out on both sides."))
    return Group(*parts)


def _cells(share: GroupComparison) -> list[str]:
    interval = "-" if share.interval is None else "[{:+.1f}, {:+.1f}]".format(*share.interval)
    figures = [figure(share.a), figure(share.b), figure(share.difference, "+.1f"), interval]
    return [str(share.scenarios), str(share.drives), *figures, *map(str, (share.wins, share.losses, share.ties))]
