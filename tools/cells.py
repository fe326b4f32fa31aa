"""Cells: how figures of report tables stand in the tables of README and docs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from interplan_sumo.batch.records import Row
from interplan_sumo.report.table import Cell, Line, ResultsTable

FAMILIES: Final = ("construction", "accident", "jaywalker", "nudge", "overtake", "ltd", "mtd", "htd")
"""The columns of the eight types of rare scenes."""
RARE: Final = "interplan"
DRIVEN: Final = "ordinary"
"""The columns of all rare scenes and of ordinary driving."""


def family_titles(table: ResultsTable) -> list[str]:
    """Titles of the columns of the eight types."""
    titles = {column.key: column.title for column in table.columns}
    return [titles[key] for key in FAMILIES]


def best_first(table: ResultsTable, key: str = RARE) -> list[Line]:
    """The lines of a table by a column, the highest first."""
    return sorted(table.lines, key=lambda line: -(line.cells[key].value or 0.0))


def heading(*titles: str) -> list[str]:
    """The first two lines of a table."""
    return [" | ".join(titles), "---|" * (len(titles) - 1) + "---"]


def cell_text(cell: Cell) -> str:
    """A figure of a table, or a dash."""
    return "-" if cell.value is None else f"{cell.value:.0f}"


def with_interval(cell: Cell) -> str:
    """A figure and between what 95 % lie."""
    low, high = cell.interval or (0.0, 100.0)
    return f"{cell_text(cell)} [{low:.0f}, {high:.0f}]"


def points(row: Row) -> float:
    """What a drive got, 0 to 100."""
    return 100.0 * (row.score or 0.0)


def by_family(line: Line, of: Callable[[Row], float] = points) -> list[list[float]]:
    """Something of each drive of a planner, its points, by type and scene."""
    found: dict[str, list[float]] = {}
    for row in line.rows:
        found.setdefault(row.family, []).append(of(row))
    return list(found.values())
