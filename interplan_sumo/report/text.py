"""Text: what tables on a terminal have in common."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from rich.table import Table as Grid
from rich.text import Text

from interplan_sumo.batch.records import Row

LEAST_POINTS: Final = 0.1
"""Smaller differences of scores are none that anybody means."""


def grid(titles: Iterable[str], rows: Iterable[Sequence[str]], *, left: Sequence[int] = (0,)) -> Grid:
    """A table of texts; the columns in `left` are words, the others figures. Nothing in a text is markup."""
    found = Grid(header_style="bold")
    for number, title in enumerate(titles):
        found.add_column(Text(title), justify="left" if number in left else "right")
    for row in rows:
        found.add_row(*map(Text, row))
    return found


def listed(title: str, entries: Sequence[str], count: int) -> list[Text]:
    """A heading with these entries of so many; nothing where there are none."""
    if not entries:
        return []
    more = [f"  ... and {count - len(entries)} more; --json lists all"] if count > len(entries) else []
    return [Text(f"\n{title} ({count})", style="bold"), *(Text(f"  {entry}") for entry in entries), *map(Text, more)]


def drive_name(row: Row) -> str:
    """A drive as messages name it."""
    return f"{row.scenario_id}, {row.planner}, seed {row.seed}"


def points(score: float | None) -> float | None:
    """A score of 0 to 1 in points of 100."""
    return None if score is None else 100.0 * score


def figure(value: float | None, form: str = ".1f") -> str:
    """A figure, or a dash where there is none."""
    return "-" if value is None else f"{value:{form}}"


def rounded(value: float | None) -> float | None:
    """A figure as JSON and CSV have it."""
    return None if value is None else round(value, 4)


def p_text(p_value: float) -> str:
    """A p value with as many digits as say something."""
    return "< 0.001" if p_value < 0.001 else f"{p_value:.3f}"


def points_text(difference: float) -> str:
    """A difference of scores; none is larger than 100 points."""
    if difference < LEAST_POINTS:
        return f"less than {LEAST_POINTS:g}"
    return "more than 100" if difference > 100.0 else f"{difference:.0f}" if difference >= 1.0 else f"{difference:.1g}"
