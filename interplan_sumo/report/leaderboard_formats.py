"""Leaderboard formats: the table of `report` with the cards, as text, as JSON and as one page."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from msgspec import to_builtins
from rich.console import Group, RenderableType
from rich.text import Text

from interplan_sumo.report.leaderboard import Entry, Leaderboard
from interplan_sumo.report.page.document import drive_links
from interplan_sumo.report.page.drives import shown_drives
from interplan_sumo.report.page.figures import best_figure
from interplan_sumo.report.page.html import html, style_of
from interplan_sumo.report.page.replays import write_replays
from interplan_sumo.report.table import Line
from interplan_sumo.report.table_formats import as_json, as_text, notes, shown_columns
from interplan_sumo.report.text import grid
from interplan_sumo.world.files import writing

CLAIMS: Final = (
    "Scores were made by the judge from the plans that were handed in. What the cards say, and the times of plans, are "
    "the authors' own words."
)
TITLES: Final = ("planner", "came again", "plan", "suite", "driven", "judged", "authors", "data", "hardware", "notes")


def leaderboard_json(board: Leaderboard) -> dict[str, Any]:
    """As `report --json`, and of each row its bundles: card, what came again, when, and with which version."""
    report = as_json(board.table)
    for row, line in zip(report["rows"], board.table.lines, strict=True):
        row["bundles"] = [
            {"folder": entry.run.path.name, "suite": entry.run.manifest.suite, "versions": entry.run.manifest.versions}
            | to_builtins(entry.judged)
            for entry in board.of(line)
        ]
    return report


def leaderboard_text(board: Leaderboard, *, width: int) -> RenderableType:
    """The table and the cards, for a terminal."""
    rows = [_words(line, entry) for line in board.table.lines for entry in board.of(line)]
    shown = [number for number in range(len(TITLES)) if number < 6 or any(row[number] for row in rows)]
    cards = grid([TITLES[n] for n in shown], [[row[n] for n in shown] for row in rows], left=range(len(shown)))
    parts: list[RenderableType] = [as_text(board.table, width=width), Text(""), cards, Text(CLAIMS)]
    for line in board.table.lines:
        parts += [Text(said) for entry in board.of(line) for said in what_differs(entry)]
    return Group(*parts)


def what_differs(entry: Entry) -> list[str]:
    """A sentence for each of the first drives that did not come again as they were claimed, and one for the rest."""
    judged = entry.judged
    told = [f"{judged.card.name}: {each.scenario_id}, seed {each.seed}: {each.reason}" for each in judged.others[:5]]
    more = len(judged.others) - len(told)
    return told + ([f"{judged.card.name}: {more} more drives did not come again as they were claimed"] if more else [])


def _words(line: Line, entry: Entry) -> list[str]:
    judged, card = entry.judged, entry.judged.card
    return [
        line.label,
        came_again(entry),
        plan_time(entry),
        entry.run.manifest.suite,
        judged.driven[:10],
        judged_by(entry),
        card.authors,
        card.data,
        card.hardware,
        card.notes,
    ]


def came_again(entry: Entry) -> str:
    return f"{entry.judged.equal} of {entry.judged.drives}"


def judged_by(entry: Entry) -> str:
    """When, and with which version."""
    return f"{entry.judged.judged[:10]}, version {entry.run.manifest.versions.get('interplan_sumo', '?')}"


def plan_time(entry: Entry) -> str:
    seconds = entry.judged.plan_s
    return "-" if seconds is None else f"{1e3 * seconds:.1f}\u00a0ms"


def write_leaderboard(board: Leaderboard, path: Path, replays: str = "none") -> None:
    """The leaderboard as one HTML file, and replays of these drives beside it; InputError if it cannot be written."""
    write_replays(board.table, [entry.run for entry in board.entries], path, replays)
    with writing(path, "give another file as --html"):
        path.write_text(leaderboard_page(board, path), encoding="utf-8")


def leaderboard_page(board: Leaderboard, path: Path | None = None) -> str:
    """The page; whatever names, cards and reasons hold is text. Replays that lie beside `path` are linked."""
    table, shown = board.table, shown_columns(board.table, paper=False)
    drives = shown_drives(table)
    links = drive_links(drives, path)
    return html(
        "leaderboard.html.j2",
        style=style_of("page.css"),
        script="",
        title="interplan-sumo leaderboard",
        table=table,
        columns=shown,
        best={column.key: best_figure(table, column) for column in shown},
        notes=[*notes(table), CLAIMS],
        entries=[(number, line, entry) for number, line in enumerate(table.lines) for entry in board.of(line)],
        came_again=came_again,
        judged_by=judged_by,
        plan_time=plan_time,
        differs=[said for entry in board.entries for said in what_differs(entry)],
        replays=[(drive, there) for drive in drives if (there := links.get(drive.anchor))],
    )
