"""Printing: results on stdout, progress on stderr; for people on a terminal, for programs as one JSON document."""

from __future__ import annotations

import contextlib
import json
import re
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from rich.console import Console

    from interplan_sumo.batch.run_folder import StoredRun
    from interplan_sumo.report.compare import RunComparison
    from interplan_sumo.report.progress import LiveProgress, PlainProgress
    from interplan_sumo.report.table import ResultsTable

Form = Literal["text", "json", "csv", "markdown"]


def print_table(
    table: ResultsTable, form: Form = "text", *, paper: bool = False, why: bool = False, details: bool = False
) -> None:
    """The paper's table on stdout; `details` are for people, JSON has them anyway."""
    from interplan_sumo.report import table_formats

    match form:
        case "json":
            print_json(table_formats.as_json(table, paper=paper, why=why))
        case "csv":
            print(table_formats.as_csv(table, paper=paper), end="")
        case "markdown":
            print(table_formats.as_markdown(table, paper=paper), end="")
        case "text":
            place = console()
            place.print(table_formats.as_text(table, width=place.width, paper=paper, why=why, details=details))


def print_comparison(found: RunComparison, *, as_json: bool) -> None:
    """A comparison of two runs on stdout."""
    from interplan_sumo.report import compare_formats

    if as_json:
        print_json(compare_formats.comparison_json(found))
    else:
        console().print(compare_formats.comparison_text(found))


def write_page(
    table: ResultsTable, path: Path, runs: Sequence[StoredRun] = (), *, paper: bool = False, replays: str = "none"
) -> None:
    """The report as one HTML file, and replays of these drives beside it; InputError if it cannot be written."""
    from interplan_sumo.report.page.document import page
    from interplan_sumo.report.page.replays import write_replays
    from interplan_sumo.world.files import writing

    write_replays(table, runs, path, replays)
    with writing(path, "give another file as --html"):
        path.write_text(page(table, runs, paper=paper, path=path), encoding="utf-8")


def print_json(document: object) -> None:
    """One document, JSON in any encoding of the output.

    Refuses numbers that JSON does not have, escapes what no terminal and no UTF-8 takes as text.
    """
    unicode = (sys.stdout.encoding or "utf-8").lower().startswith("utf")
    text = json.dumps(document, indent=2, ensure_ascii=not unicode, allow_nan=False)
    print(re.sub("[\x7f-\x9f\ud800-\udfff]", lambda found: f"\\u{ord(found[0]):04x}", text))


def print_entries(entries: Sequence[dict[str, Any]], *, as_json: bool, hide: Sequence[str] = ()) -> None:
    """A list of entries, as JSON or as a table without the columns in `hide`."""
    if as_json:
        print_json(list(entries))
        return
    from rich.table import Table as Grid
    from rich.text import Text

    columns = [key for key in dict.fromkeys(key for entry in entries for key in entry) if key not in hide]
    grid = Grid(*columns, header_style="bold")
    for entry in entries:
        grid.add_row(*(Text(_cell(entry.get(column))) for column in columns))
    console().print(grid)


def _cell(value: object) -> str:
    match value:
        case None:
            return "-"
        case bool():
            return "yes" if value else "no"
        case dict():
            return ", ".join(f"{k}={v}" for k, v in value.items())
        case _:
            return str(value)


def console(*, stderr: bool = False) -> Console:
    """As wide as the terminal; wide enough for every table where there is none."""
    from rich.console import Console

    found = Console(stderr=stderr)
    return found if found.is_terminal else Console(stderr=stderr, width=200)


def progress(*, quiet: bool, about: str = "") -> AbstractContextManager[LiveProgress | PlainProgress | None]:
    """A watch for a run, which says at its beginning what it is `about`; None if nothing is to be said."""
    from interplan_sumo.report.progress import LiveProgress, PlainProgress

    if quiet:
        return contextlib.nullcontext()
    place = console(stderr=True)
    return LiveProgress(place, about) if place.is_terminal else PlainProgress(place, about)
