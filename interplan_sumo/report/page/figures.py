"""Figures of the page: how scores spread over the bands, and the map of all scenarios."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from interplan_sumo.families import find_family
from interplan_sumo.report.page.drives import BANDS, ShownDrive, band, by_scenario
from interplan_sumo.report.table import Column, ResultsTable


def best_figure(table: ResultsTable, column: Column) -> float | None:
    """The highest mean as it is shown, if there are two lines or more and they differ."""
    values = [round(value) for line in table.lines if (value := line.cells[column.key].value) is not None]
    if len(values) < 2 or max(values) == min(values):
        return None
    return min(values) if column.lower_is_better else max(values)


@dataclass(frozen=True, slots=True)
class BandShare:
    """The part of a planner's drives whose scores lie in one band; percent of the width of its bar."""

    band: str
    count: int
    left: float
    width: float


def score_spread(table: ResultsTable, drives: Sequence[ShownDrive]) -> list[tuple[str, list[BandShare]]]:
    """Of each line its label and the share of each band."""
    found: list[tuple[str, list[BandShare]]] = []
    for number, line in enumerate(table.lines):
        mine = [drive.band for drive in drives if drive.line == number]
        scored = max(1, sum(each != "none" for each in mine))
        shares, left = list[BandShare](), 0.0
        for name in BANDS:
            width = 100.0 * mine.count(name) / scored
            shares.append(BandShare(name, mine.count(name), left, width))
            left += width
        found.append((line.label, shares))
    return found


@dataclass(frozen=True, slots=True)
class ScenarioCell:
    """A planner's drives on one scenario: the mean over the seeds; a link leads to the worst of them."""

    text: str
    band: str
    worst: ShownDrive
    title: str

    @classmethod
    def of(cls, drives: Sequence[ShownDrive]) -> ScenarioCell | None:
        if not drives:
            return None
        scored = [drive.score for drive in drives if drive.score is not None]
        mean = sum(scored) / len(scored) if len(scored) == len(drives) else None
        worst = min(drives, key=lambda drive: drive.rank)
        figure = "no score" if mean is None else f"{mean:.0f}"
        why = f": {worst.reasons[0]}" if worst.reasons else ""
        title = f"{worst.scenario}, {worst.label}: {figure}{why}"
        return cls("!" if mean is None else figure, band(mean), worst, title)


@dataclass(frozen=True, slots=True)
class FamilyBlock:
    """The scenarios of a family as columns; a row per planner, its label and a cell for each of them."""

    family: str
    title: str
    scenarios: list[str]
    rows: list[tuple[str, list[ScenarioCell | None]]]


def family_blocks(table: ResultsTable, drives: Sequence[ShownDrive]) -> list[FamilyBlock]:
    """A block per family, in the order of the drives."""
    families: dict[str, list[ShownDrive]] = {}
    for drive in drives:
        families.setdefault(drive.family, []).append(drive)
    blocks: list[FamilyBlock] = []
    for family, mine in families.items():
        scenarios = by_scenario(mine)
        rows = [
            (line.label, [ScenarioCell.of([d for d in found if d.line == number]) for found in scenarios.values()])
            for number, line in enumerate(table.lines)
        ]
        blocks.append(FamilyBlock(family, find_family(family).title, list(scenarios), rows))
    return blocks
