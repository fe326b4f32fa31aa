"""Formats of a comparison: JSON for programs, text for a terminal."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from interplan_sumo.report.compare import Comparison, GroupComparison, RunComparison
from interplan_sumo.report.text import figure, grid, listed, p_text, points_text, rounded
from interplan_sumo.statistics.intervals import DRAWS
from interplan_sumo.statistics.scene_values import DriveKey

LISTED = 10
"""So many changes and missing drives are listed on a terminal."""
ROUNDED = ("a", "b", "difference", "p_value", "least_detectable_difference", "unsafe_a", "unsafe_b")


def comparison_json(found: RunComparison) -> dict[str, Any]:
    """The comparison as plain data; scores 0 to 100, differences are b less a.

    That of one pair of planners, or all pairs below `pairs`.
    """
    if len(found.pairs) == 1:
        return _pair_json(found.pairs[0])
    return {
        "suite": found.suite,
        "profile": found.profile,
        "complete": found.complete,
        "pairs": [_pair_json(pair) for pair in found.pairs],
        "only": {"a": list(found.only_a), "b": list(found.only_b)},
    }


def _pair_json(found: Comparison) -> dict[str, Any]:
    return {
        "a": found.a,
        "b": found.b,
        "suite": found.suite,
        "profile": found.profile,
        "complete": found.complete,
        "better": found.better,
        "scores_more": found.scores_more,
        "p_holm": rounded(found.adjusted_p),
        "overall": _group_json(found.overall),
        "families": {family: _group_json(group) for family, group in found.families.items()},
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


def _group_json(group: GroupComparison) -> dict[str, Any]:
    figures = {name: rounded(getattr(group, name)) for name in ROUNDED}
    bounds = {"interval": group.interval, "unsafe_interval": group.unsafe_interval}
    intervals = {name: found and [rounded(bound) for bound in found] for name, found in bounds.items()}
    return {**asdict(group), **figures, **intervals}


def _keys_json(keys: Iterable[DriveKey]) -> list[dict[str, Any]]:
    return [{"scenario_id": scenario, "seed": seed} for scenario, seed in keys]


def comparison_text(found: RunComparison) -> RenderableType:
    """The table, who is better, what changed most and why, and what is missing, for a terminal."""
    parts: list[RenderableType] = []
    for pair in found.pairs:
        parts += _pair_text(pair, of_several=len(found.pairs) > 1)
    parts.append(
        Text(
            f"Suite {found.suite}, profile {found.profile}, scores 0 to 100, paired on equal scenario and seed; won: b "
            "is better. 95 %: interval of the difference for scenarios like these, drawn again within their families "
            f"with all their seeds ({DRAWS} draws); p: of no difference, by the same draws."
        )
    )
    parts += [
        Text(f"Only in {side}: {', '.join(names)}")
        for side, names in (("a", found.only_a), ("b", found.only_b))
        if names
    ]
    if not found.complete:
        parts.append(Text("\nINCOMPLETE: the drives without a score are left out on both sides."))
    return Group(*parts)


def _pair_text(found: Comparison, *, of_several: bool) -> list[RenderableType]:
    groups = {"all": found.overall, **found.families}
    titles = (
        "", "scenarios", "drives", "a", "b", "b - a", "95 %", "p", "unsafe a %", "unsafe b %", "won", "lost", "tied",
    )  # fmt: skip
    table = grid(titles, [[name, *_cells(group)] for name, group in groups.items()])
    table.rows[0].end_section = True
    parts: list[RenderableType] = [Text(f"a  {found.a}\nb  {found.b}"), table, Text(_verdict(found, of_several))]
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
    return [*parts, Text()] if of_several else parts


def _verdict(found: Comparison, of_several: bool) -> str:
    """Who is better, and how large a difference this comparison would find."""
    if found.adjusted_p is None:
        return "One scenario or none says nothing about others."
    said = f"{found.better} is better" if found.better else "Not to be told apart"
    if found.scores_more and not found.better:
        said = f"{found.scores_more} scores more but is unsafe more often, so that neither is called better"
    how = f"p {p_text(found.adjusted_p)}{' after Holm over all pairs' if of_several else ''}"
    least = found.overall.least_detectable_difference
    detectable = "" if least is None else f" Least detectable difference (80 % power): {points_text(least)} points."
    return f"{said} ({how}).{detectable}"


def _cells(group: GroupComparison) -> list[str]:
    interval = "-" if group.interval is None else "[{:+.1f}, {:+.1f}]".format(*group.interval)
    p_value = "-" if group.p_value is None else p_text(group.p_value)
    figures = [figure(group.a), figure(group.b), figure(group.difference, "+.1f"), interval, p_value]
    figures += [figure(group.unsafe_a, ".0f"), figure(group.unsafe_b, ".0f")]
    return [str(group.scenarios), str(group.drives), *figures, *map(str, (group.wins, group.losses, group.ties))]
