"""Figures of the page: the table, the bars, the spread of scores and the map of all scenarios."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import Final

from interplan_sumo.report.formats import columns
from interplan_sumo.report.page.drives import WHOLE, ShownDrive, by_scenario
from interplan_sumo.report.published import published_figure, published_rows
from interplan_sumo.report.table import COLUMNS, Cell, Column, ResultsTable

BANDS: Final = ((0.0, "0"), (40.0, "below 40"), (80.0, "40 to 80"), (WHOLE, "80 to 100"), (100.0, "100"))
"""Where a score lies: up to 0, below the next two, below what shows as 100, and all the rest."""
HUES: Final = 8
"""Planners that have a colour of their own; further ones begin anew."""


def band(score: float | None) -> str:
    """Class of a score's colour: `b0` for none of the points to `b4` for all of them, `none` without a score."""
    if score is None:
        return "none"
    return f"b{0 if score <= 0.0 else 1 if score < 40.0 else 2 if score < 80.0 else 3 if score < WHOLE else 4}"


def hue(line: int) -> str:
    """Class of a planner's colour."""
    return f"h{line % HUES}"


def who(line: int, label: str) -> str:
    """A planner with its colour; where there is no room for the whole label, a pointer on it shows it."""
    text = escape(label)
    return f'<span class="who" title="{text}"><i class="swatch {hue(line)}"></i><span>{text}</span></span>'


# --- table ---------------------------------------------------------------------------------------


def scores(table: ResultsTable, *, paper: bool) -> str:
    """The paper's table; the best of each column stands out where there is a choice."""
    shown = columns(table, paper=paper)
    head = "".join(f'<th class="n" scope="col">{escape(column.title)}</th>' for column in shown)
    best = {column.key: _best(table, column) for column in shown}
    body = ""
    for number, line in enumerate(table.lines):
        cells = "".join(_figure(line.cells[c.key], c, best[c.key]) for c in shown)
        body += f'<tr><th scope="row">{who(number, line.label)}</th>{cells}</tr>'
    if paper:
        for row in published_rows():
            cells = "".join(f'<td class="n">{published_figure(row, c.key)}</td>' for c in shown)
            body += f'<tr class="paper"><th scope="row">{escape(str(row["planner"]))} (paper)</th>{cells}</tr>'
    return (
        '<table class="scores"><caption>Mean scores, 0 to 100</caption>'
        f'<thead><tr><th scope="col">planner</th>{head}</tr></thead><tbody>{body}</tbody></table>'
    )


def _best(table: ResultsTable, column: Column) -> float | None:
    """The highest mean as it is shown, if there are two lines or more and they differ."""
    values = [round(value) for line in table.lines if (value := line.cells[column.key].value) is not None]
    return max(values) if len(values) > 1 and max(values) > min(values) else None


def _figure(cell: Cell, column: Column, best: float | None) -> str:
    classes = "n total" if column.key == "interplan" else "n"
    if cell.incomplete:
        return f'<td class="{classes}">({cell.done}/{cell.asked})</td>'
    if cell.value is None:
        return f'<td class="{classes}">-</td>'
    text = f"{cell.value:.0f}"
    if best is not None and round(cell.value) == best:
        text = f"<b>{text}</b>"
    if cell.interval is not None:
        low, high = cell.interval
        text += f" <small>[{low:.0f},&nbsp;{high:.0f}]</small>"
    return f'<td class="{classes}">{text}</td>'


# --- families ------------------------------------------------------------------------------------


def families(table: ResultsTable) -> str:
    """One card per column of the table with a bar for each planner."""
    return "".join(
        _card(table, column) for column in COLUMNS if any(line.cells[column.key].asked for line in table.lines)
    )


def _card(table: ResultsTable, column: Column) -> str:
    rows = "".join(
        f'<tr><th scope="row">{who(number, line.label)}</th><td>{_bar(line.cells[column.key], number)}</td>'
        f'<td class="n">{_short(line.cells[column.key])}</td></tr>'
        for number, line in enumerate(table.lines)
    )
    return f'<table class="card"><caption>{escape(_title(column))}</caption><tbody>{rows}</tbody></table>'


TITLES: Final = {
    "interplan": "interPlan, all families", "ordinary": "ordinary driving", "ltd": "lane change, low traffic",
    "mtd": "lane change, medium traffic", "htd": "lane change, high traffic", 
    "driv": "lane changes: stayed on the road", "goal": "lane changes: reached the goal lane", 
    "no_col": "lane changes: no collision at fault",
}  # fmt: skip
"""Columns whose key does not say it."""


def _title(column: Column) -> str:
    return TITLES.get(column.key, column.key)


def _short(cell: Cell) -> str:
    if cell.incomplete:
        return f"({cell.done}/{cell.asked})"
    return "-" if cell.value is None else f"{cell.value:.0f}"


def _bar(cell: Cell, line: int) -> str:
    value = cell.value or 0.0
    inner = f'<rect class="{hue(line)}" width="{value:.1f}" height="10"/>'
    if cell.interval is not None:
        low, high = cell.interval
        inner += f'<path class="whisker" d="M{low:.1f} 5H{high:.1f}M{low:.1f} 2V8M{high:.1f} 2V8"/>'
    return _svg("bar", inner)


def score_bar(score: float) -> str:
    """A short bar in the colour of the score."""
    return _svg("bar", f'<rect class="{band(score)}" width="{score:.1f}" height="10"/>')


def _svg(kind: str, inner: str) -> str:
    return f'<svg class="{kind}" viewBox="0 0 100 10" preserveAspectRatio="none" aria-hidden="true">{inner}</svg>'


# --- spread --------------------------------------------------------------------------------------


def spread(table: ResultsTable, drives: Sequence[ShownDrive]) -> str:
    """How many drives of each planner lie in each band of scores."""
    head = "".join(
        f'<th class="n" scope="col"><i class="swatch b{i}"></i>{text}</th>' for i, (_, text) in enumerate(BANDS)
    )
    body = ""
    for number, line in enumerate(table.lines):
        mine = [drive for drive in drives if drive.line == number]
        counts = [sum(band(drive.score) == f"b{i}" for drive in mine) for i in range(len(BANDS))]
        cells = "".join(f'<td class="n">{count}</td>' for count in counts)
        body += f'<tr><th scope="row">{who(number, line.label)}</th><td class="wide">{_stack(counts)}</td>{cells}</tr>'
    return (
        '<table class="spread"><caption>Drives by score</caption><thead><tr><th scope="col">planner</th>'
        f'<th scope="col">share of its drives</th>{head}</tr></thead><tbody>{body}</tbody></table>'
    )


def _stack(counts: Sequence[int]) -> str:
    whole = max(1, sum(counts))
    inner, left = "", 0.0
    for i, count in enumerate(counts):
        width = 100.0 * count / whole
        inner += f'<rect class="b{i}" x="{left:.2f}" width="{width:.2f}" height="10"/>' if count else ""
        left += width
    return _svg("stack", inner)


# --- all scenarios at a glance -------------------------------------------------------------------


def matrix(table: ResultsTable, drives: Sequence[ShownDrive], rows: dict[ShownDrive, str]) -> str:
    """A block per family: a row per planner, a column per scenario; a cell leads to the drive's row (its anchor)."""
    blocks: dict[str, list[ShownDrive]] = {}
    for drive in drives:
        blocks.setdefault(drive.family, []).append(drive)
    return "".join(_block(table, family, mine, rows) for family, mine in blocks.items())


def _block(table: ResultsTable, family: str, drives: Iterable[ShownDrive], rows: dict[ShownDrive, str]) -> str:
    scenarios = by_scenario(drives)
    head = "".join(
        f'<th scope="col" title="{escape(scenario)}">{escape(scenario.removeprefix(f"{family}/"))}</th>'
        for scenario in scenarios
    )
    body = ""
    for number, line in enumerate(table.lines):
        cells = "".join(_heat([drive for drive in mine if drive.line == number], rows) for mine in scenarios.values())
        body += f'<tr><th scope="row">{who(number, line.label)}</th>{cells}</tr>'
    return (
        f'<div class="block"><table class="heat"><caption>{escape(family)}</caption>'
        f"<thead><tr><td></td>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _heat(drives: Sequence[ShownDrive], rows: dict[ShownDrive, str]) -> str:
    """The mean over the seeds; the link goes to the worst of them."""
    scored = [drive.score for drive in drives if drive.score is not None]
    if not drives:
        return '<td class="none" title="not driven">&middot;</td>'
    mean = sum(scored) / len(scored) if len(scored) == len(drives) else None
    worst = min(drives, key=lambda drive: -1.0 if drive.score is None else drive.score)
    said = "no score" if mean is None else f"{mean:.0f}"
    why = f": {worst.reasons[0]}" if worst.reasons else ""
    title = escape(f"{worst.scenario}, {worst.label}: {said}{why}")
    text = "!" if mean is None else said
    return f'<td class="{band(mean)}"><a href="#{rows[worst]}" title="{title}">{text}</a></td>'
