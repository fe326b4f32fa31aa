"""Costly: what cost a planner most, over all its drives, and what to do about it next."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from interplan_sumo.batch.records import JobKey, Row
from interplan_sumo.errors import counted
from interplan_sumo.families import find_family
from interplan_sumo.metrics.metric import failure_words
from interplan_sumo.metrics.score import points_lost
from interplan_sumo.report.failure_reasons import LEAST_LOSS
from interplan_sumo.report.table import DriveRows, Line

TOLD: Final = 3
LEAST_COLUMN: Final = 1.0
"""Points of its mean that somebody lost by each reason that has a column of its own."""
OTHER: Final = "other"
"""The column of all other reasons."""


@dataclass(slots=True)
class Cost:
    """What one reason took of a planner's score."""

    reason: str
    """The metric, or whose fault."""
    words: str
    points: float = 0.0
    """Of the mean over all drives, 0 to 100."""
    drives: int = 0
    worst: JobKey | None = None
    """Where it cost most."""
    worst_points: float = 0.0


def costs(line: Line) -> list[Cost]:
    """What cost points in the drives of a planner, the most first; a fault costs all of them.

    Of the rare scenes, as the figure over all families is; of ordinary driving where a line has nothing else.
    """
    found: dict[str, Cost] = {}
    rare = {each for family, ids in line.families.items() if not find_family(family).ordinary for each in ids}
    rows = DriveRows([place for place in line.rows.places if not rare or place[1][0] in rare])
    for row in rows:
        for reason, points in _lost(row).items():
            cost = found.setdefault(reason, Cost(reason, f"{reason} fault" if row.fault else failure_words(reason)))
            cost.points += points / len(rows)
            cost.drives += 1
            if points > cost.worst_points:
                cost.worst, cost.worst_points = row.key, points
    return sorted(found.values(), key=lambda cost: -cost.points)


def where_points_went(lines: Sequence[Line]) -> dict[str, list[float]]:
    """What each reason, in words, took of the 100 points of each line, the costliest reason first.

    Means over the drives of a line. Reasons that took less than `LEAST_COLUMN` of everybody are one, the last.
    """
    taken = [{cost.words: cost.points for cost in costs(line)} for line in lines]
    reasons = dict.fromkeys(words for each in taken for words in each)
    columns = {words: [each.get(words, 0.0) for each in taken] for words in reasons}
    small = [points for points in columns.values() if max(points) < LEAST_COLUMN]
    found = {words: points for words, points in columns.items() if max(points) >= LEAST_COLUMN}
    found = dict(sorted(found.items(), key=lambda column: -sum(column[1])))
    return found | ({OTHER: [sum(each, start=0.0) for each in zip(*small, strict=True)]} if small else {})


def cost_text(line: Line) -> str:
    """The costliest reasons in one line."""
    said = [f"{each.words} {each.points:.1f} ({counted(each.drives, 'drive')})" for each in costs(line)[:TOLD]]
    return f"{line.label} lost most of 100 points by: {', '.join(said)}" if said else f"{line.label} lost nothing"


def next_commands(lines: Sequence[Line], folder: Path) -> list[str]:
    """What to type after a run: why points were lost, the costliest drive to watch, and how to trust the result."""
    program, run = "interplan-sumo", shlex.quote(str(folder))
    found: list[str] = []
    every = sorted((cost for line in lines for cost in costs(line)[:1]), key=lambda cost: -cost.points)
    if every:
        found.append(f"{program} report {run} --why")
    watched = next((cost.worst for cost in every if cost.worst is not None), None)
    if watched is not None:
        scenario, planner, seed = watched
        told = f"{f' --seed {seed}' if seed else ''} --html replay.html"
        found.append(f"{program} replay {run} {shlex.quote(scenario)} --planner {shlex.quote(planner)}{told}")
    return [*found, f"{program} verify {run}"]


def _lost(row: Row) -> dict[str, float]:
    if row.fault is not None:
        return {row.fault.kind: 100.0}
    lost = points_lost(row.judged, row.gates, row.weights)
    return {name: points for name, points in lost.items() if points >= 100.0 * LEAST_LOSS}
