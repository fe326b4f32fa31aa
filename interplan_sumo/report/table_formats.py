"""Table formats: the paper's table as JSON, CSV, Markdown or text for a terminal."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table as Grid
from rich.text import Text

from interplan_sumo.batch.records import Row
from interplan_sumo.errors import counted
from interplan_sumo.families import find_family
from interplan_sumo.report.costly import costs, where_points_went
from interplan_sumo.report.failure_reasons import fault_sentence, lost_points
from interplan_sumo.report.paper_comparison import (
    PUBLISHED_COLUMNS,
    SOURCE,
    agreement,
    published_figure,
    published_rows,
)
from interplan_sumo.report.standing_formats import standing_json, standing_notes
from interplan_sumo.report.table import ORDINARY, Cell, Column, Line, ResultsTable
from interplan_sumo.report.text import drive_name, figure, listed, points, rounded

LISTED = 20
"""So many faults, missing rows or zeros are listed on a terminal; the rest is counted."""


def as_json(table: ResultsTable, *, paper: bool = False, why: bool = False) -> dict[str, Any]:
    """The report as plain data; scores 0 to 100, null where there is nothing or where rows are missing."""
    rows: list[dict[str, Any]] = []
    for line in table.lines:
        row: dict[str, Any] = {"planner": line.label}
        row |= {column.key: rounded(line.cells[column.key].value) for column in table.columns}
        row |= {
            "scenarios": line.scenarios,
            "seeds": line.seeds,
            "official": line.official,
            "verified": line.verified,
            "overrides": line.overrides.texts(),
            "faults": dict(line.faults),
            **({"questions": line.questions, "unanswered": line.unanswered} if line.questions else {}),
            "fault_list": [
                {"scenario_id": r.scenario_id, "seed": r.seed, "class": r.fault.kind, "message": r.fault.message}
                for r in line.faulty
                if r.fault
            ],
            "missing": [{"scenario_id": scenario, "seed": seed} for scenario, _, seed in line.missing],
            "drives": [
                {
                    "scenario_id": r.scenario_id,
                    "family": r.family,
                    "seed": r.seed,
                    "score": rounded(points(r.score)),
                    "lost": lost_points(r),
                }
                for r in line.rows
            ],
            "points_lost": {cost.reason: rounded(cost.points) for cost in costs(line)},
            "done": {c.key: [line.cells[c.key].done, line.cells[c.key].asked] for c in table.columns},
            "ci": {
                c.key: [rounded(bound) for bound in interval]
                for c in table.columns
                if (interval := line.cells[c.key].interval) is not None
            },
        }
        if why:
            row["why"] = [{"scenario_id": r.scenario_id, "seed": r.seed, "reason": s} for r, s in reasons(line)]
        rows.append(row)
    report: dict[str, Any] = {
        "suite": table.suite,
        "ordinary_suite": table.ordinary_suite,
        "profile": table.profile,
        "complete": table.complete,
        "shards": list(table.shards),
        "families": table.families,
        "rows": rows,
        **standing_json(table),
    }
    if paper:
        near = agreement(table)
        report["paper"] = {"source": SOURCE, "rows": published_rows(), "agreement": near and near.as_json()}
    return report


def reasons(line: Line) -> Iterator[tuple[Row, str]]:
    """All that cost points, drive by drive, one sentence at a time."""
    return ((row, sentence) for row in line.rows for sentence in lost_points(row))


def as_csv(table: ResultsTable, *, paper: bool = False) -> str:
    """The table for spreadsheets: empty fields where there is no figure; `_low` and `_high` bound its 95 % interval."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    keys = [f"{c.key}{end}" for c in table.columns for end in ("", "_low", "_high")]
    writer.writerow(["planner", *keys, "scenarios", "seeds", "official", "faults", "missing"])
    for line in table.lines:
        cells = [line.cells[c.key] for c in table.columns]
        figures = [rounded(each) for cell in cells for each in (cell.value, *(cell.interval or (None, None)))]
        faults = sum(line.faults.values())
        writer.writerow([line.label, *figures, line.scenarios, line.seeds, line.official, faults, len(line.missing)])
    for row in published_rows() if paper else ():
        figures = [each for c in table.columns for each in (row.get(c.key), None, None)]
        writer.writerow([f"{row['planner']} (paper)", *figures, 80, "", "", "", ""])
    return text.getvalue()


def as_markdown(table: ResultsTable, *, paper: bool = False) -> str:
    """The table for a README."""
    shown = shown_columns(table, paper=paper)
    head = ["planner", *(c.title for c in shown)]
    lines = [_markdown_row(head), _markdown_row(["---"] + ["---:"] * len(shown))]
    for line in table.lines:
        lines.append(_markdown_row([line.label, *(cell_text(line.cells[c.key]) for c in shown)]))
    for row in published_rows() if paper else ():
        lines.append(_markdown_row([f"{row['planner']} (paper)", *(published_figure(row, c.key) for c in shown)]))
    return "\n".join([*lines, "", *notes(table, paper=paper)]) + "\n"


def shown_columns(table: ResultsTable, *, paper: bool) -> list[Column]:
    """The paper's columns, and those of other families that somebody was to drive; ordinary driving where there is any.

    With the paper's rows beside them all that the paper has a column for.
    """
    kept = [column for column in PUBLISHED_COLUMNS if paper or column != ORDINARY]
    return [column for column in table.columns if column.key in kept or table.asked(column)]


def cell_text(cell: Cell) -> str:
    """One figure as text: the mean, with its interval if it has one; how far it is if rows are missing."""
    if cell.incomplete:
        return f"({cell.done}/{cell.asked})"
    if cell.value is None:
        return "-"
    if cell.interval is None:
        return f"{cell.value:.0f}"
    low, high = cell.interval
    return f"{cell.value:.0f} [{low:.0f}, {high:.0f}]"


def notes(table: ResultsTable, *, paper: bool = False) -> list[str]:
    """What a reader of the figures must know."""
    rare = {family: count for family, count in table.families.items() if not find_family(family).ordinary}
    families = ", ".join(f"{family} {count}" for family, count in rare.items()) or "none yet"
    found = [
        f"Suite {table.suite}, profile {table.profile}, scores 0 to 100. "
        f"interPlan is the mean over the scenarios of this run ({families}); - marks what the run has none of."
    ]
    if ordinary := sum(count for family, count in table.families.items() if find_family(family).ordinary):
        suite = table.ordinary_suite or table.suite
        found.append(f"Ordinary is the mean over ordinary driving (suite {suite}; scenarios: {ordinary}).")
    found += [f"A part of a run: {each}; `merge` joins them all." for each in table.shards]
    found += standing_notes(table)
    if not table.complete:
        count = sum(len(line.missing) for line in table.lines)
        found.append(
            f"INCOMPLETE: {count} job{'s have' if count > 1 else ' has'} no score; (done/asked) stands where a mean "
            "would leave them out. Repeat the run command with the same --out to complete it."
        )
    if any(line.overrides for line in table.lines):
        note = "were run with another traffic or perception: not comparable with official ones."
        found.append(f"Rows in square brackets {note}")
    for line in table.lines:
        if line.begun_again:
            found.append(
                f"{line.label}: {counted(line.begun_again, 'drive')} begun again after a process was killed, which a "
                f"planner may do itself: not official. --redo {line.planner} drives its rows anew."
            )
    found.append(_verified_note(table))
    for line in table.lines:
        if line.questions:
            share = 100.0 * line.unanswered / line.questions
            found.append(
                f"{line.label} asked a language model {counted(line.questions, 'time')}, "
                f"{share:.1f} % without a usable answer."
            )
    if paper:
        found.append(f"(paper): {SOURCE}; ordinary driving there is Val14.")
        if (near := agreement(table)) is not None:
            found.append(near.sentence())
    return found


def _verified_note(table: ResultsTable) -> str:
    """How many drives came again from their plans."""
    verified = sum(line.verified for line in table.lines)
    rows = sum(len(line.rows) for line in table.lines)
    way = "" if verified == rows else " (interplan-sumo verify DIR --all)"
    if not verified:
        return f"Not verified yet: no drive has been made again from its stored plans{way}."
    return f"Verified: {verified} of {rows} drives came again from their stored plans{way}."


def as_text(
    table: ResultsTable, *, width: int = 200, paper: bool = False, why: bool = False, details: bool = False
) -> RenderableType:
    """The table and its notes for a terminal of `width` characters; columns that no line has are left out."""
    parts: list[RenderableType] = [_scores(table, width, paper), *(Text(note) for note in notes(table, paper=paper))]
    faulty = [key for line in table.lines for key in line.faulty.keys]
    first = islice((row for line in table.lines for row in line.faulty), LISTED)
    parts += listed("Faults", [f"{drive_name(row)}: {fault_sentence(row)}" for row in first], len(faulty))
    ended = set(faulty)
    missing = [f"{key[0]}, {key[1]}, seed {key[2]}" for line in table.lines for key in line.missing if key not in ended]
    parts += listed("Not run yet", missing[:LISTED], len(missing))
    if why:
        parts += _where_points_went(table, width)
        lost = [f"{drive_name(row)}: {sentence}" for line in table.lines for row, sentence in reasons(line)]
        parts += listed("Why: what cost how many of the 100 points", lost, len(lost))
    if details:
        drives = [_drive(row) for line in table.lines for row in line.rows]
        parts += listed("Every drive", drives, len(drives))
    return Group(*parts)


def _scores(table: ResultsTable, width: int, paper: bool) -> Group:
    """The figures of the table, the paper's rows below ours."""
    shown = [c for c in shown_columns(table, paper=paper) if paper or table.asked(c)]
    rows = [[line.label, *(cell_text(line.cells[c.key]) for c in shown)] for line in table.lines]
    published = [
        [f"{row['planner']} (paper)", *(published_figure(row, c.key) for c in shown)] for row in published_rows()
    ]
    return _fitted(["planner", *(c.title for c in shown)], rows, published if paper else [], width=width)


def _where_points_went(table: ResultsTable, width: int) -> list[RenderableType]:
    """What each reason took of the 100 points, by planner; nothing if nobody lost any."""
    columns = where_points_went(table.lines)
    rows = [
        [line.label, *(figure(taken[number] or None) for taken in columns.values())]
        for number, line in enumerate(table.lines)
    ]
    heading = Text("\nWhere the points went (of 100)", style="bold")
    return [heading, _fitted(["planner", *columns], rows, width=width)] if columns else []


def _fitted(titles: list[str], ours: list[list[str]], others: Sequence[list[str]] = (), *, width: int) -> Group:
    """A row per planner where that fits into `width`, else a column per planner, else some of the columns at a time."""
    rows = [titles, *ours, *others]
    turned = [list(column) for column in zip(*rows, strict=True)]
    if _wide(rows) > width >= _wide(turned):
        return Group(_grid(turned, len(turned), width))
    parts, first = list[Grid](), 1
    while first < len(titles):
        end = first + 1
        while end < len(titles) and _wide([[row[0], *row[first : end + 1]] for row in rows]) <= width:
            end += 1
        parts.append(_grid([[row[0], *row[first:end]] for row in rows], len(ours), width))
        first = end
    return Group(*parts)


def _wide(rows: Sequence[Sequence[str]]) -> int:
    """How many characters a grid of these rows takes."""
    return sum(max(map(len, column)) + 3 for column in zip(*rows, strict=True)) + 1


def _grid(rows: Sequence[Sequence[str]], ours: int, width: int) -> Grid:
    """Rows under their titles, the first; those behind the first `ours` are others'. What is too wide is folded."""
    grid, fits = Grid(header_style="bold"), _wide(rows) <= width
    for number, title in enumerate(rows[0]):
        grid.add_column(Text(title), justify="right" if number else "left", overflow="fold", no_wrap=fits)
    for number, row in enumerate(rows[1:], start=1):
        style = "dim" if number > ours else ""
        grid.add_row(*(Text(text, style=style) for text in row), end_section=number == ours)
    return grid


def _drive(row: Row) -> str:
    """One drive with its score and what cost points."""
    lost = "; ".join(lost_points(row)) or "nothing lost"
    return f"{figure(points(row.score)):>5}  {drive_name(row)}: {lost}"


def _markdown_row(fields: list[str]) -> str:
    return "| " + " | ".join(field.replace("|", "\\|") for field in fields) + " |"
