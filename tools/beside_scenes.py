"""Kilometres beside scenes: what planners do in both, and whether both put them in one order."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from interplan_sumo.batch.briefs import Brief
from interplan_sumo.batch.records import Row
from interplan_sumo.endurance.formats import rate_text
from interplan_sumo.endurance.rate_sample import MeasureKey
from interplan_sumo.report.table import ResultsTable, unsafe_share
from interplan_sumo.statistics.event_rates import Floats
from tools.cells import DRIVEN, RARE, by_family, cell_text, heading, points
from tools.hard_scores import drawn_again, tau
from tools.kilometres import drawn_rates, rates

ORDERED: Final[Mapping[MeasureKey, str]] = {
    "at_fault_collision": "at-fault collisions", "near_miss": "near misses", "hard_braking": "hard braking caused",
    "stall": "stalls",
}  # fmt: skip
"""Of kilometres: what planners are put in order by."""
ORDER_DRAWS: Final = 400
"""Of orders; a few planners have few."""


def kilometres_suites(rare: ResultsTable, ordinary: ResultsTable) -> list[str]:
    """What planners do in kilometres beside what they do in scenes, who hits most first."""
    collisions, braking = rates("at_fault_collision"), rates("hard_braking")
    lines = heading(
        "planner", "at-fault collisions", "hard braking caused", "rare: score", "unsafe %", "ordinary: score"
    )
    scenes = {line.planner: line.cells for line in rare.lines}
    everyday = {line.planner: line.cells for line in ordinary.lines}
    for name in sorted(collisions, key=lambda name: -collisions[name].per_1000_km):
        told = (rate_text(collisions[name]), rate_text(braking[name]))
        cells = (scenes[name][RARE], scenes[name]["unsafe_share"])
        driven = cell_text(everyday[name][DRIVEN]) if name in everyday else "-"
        lines.append(" | ".join((f"`{name}`", *told, *map(cell_text, cells), driven)))
    return lines


def kilometres_order(rare: ResultsTable, ordinary: ResultsTable) -> list[str]:
    """Whether kilometres and scenes put the planners in one order, both with starts and scenes drawn again."""
    lines = heading("fewest per kilometre of", "rare: score", "rare: unsafe %", "ordinary: score")
    rng = np.random.default_rng(0)
    names = sorted(rates("at_fault_collision").keys() & {line.planner for line in ordinary.lines})
    columns = [_scenes(table, names, of) for table, of in ((rare, points), (rare, _safe), (ordinary, points))]
    for measure, title in ORDERED.items():
        told, drawn = rates(measure), drawn_rates(measure)
        found = -np.array([told[name].per_1000_km for name in names])
        again = -np.array([drawn[name] for name in names])
        cells: list[str] = []
        for scenes in columns:
            taus = [tau(again[:, k], _drawn_means(scenes, rng)) for k in range(ORDER_DRAWS)]
            low, high = np.nanquantile(taus, (0.025, 0.975))
            cells.append(f"{tau(found, _drawn_means(scenes)):.2f} [{low:.2f}, {high:.2f}]")
        lines.append(" | ".join((title, *cells)))
    return lines


def _scenes(table: ResultsTable, names: list[str], of: Callable[[Row], float]) -> list[Floats]:
    """(P, S) something of each drive of these planners, by type."""
    by_name = {line.planner: line for line in table.lines}
    return [np.array(family) for family in zip(*(by_family(by_name[name], of) for name in names), strict=True)]


def _drawn_means(scenes: list[Floats], rng: np.random.Generator | None = None) -> Floats:
    """(P,) what planners have on average in all scenes, or in some of each type, drawn again, the same for all."""
    if rng is not None:
        scenes = [drawn_again(family, rng) for family in scenes]
    return np.concatenate(scenes, axis=1).mean(axis=1)


def _safe(row: Row) -> float:
    return -(unsafe_share(Brief.of(row)) or 0.0)
