"""Document: the report as one page for planning researchers; it reads without JavaScript."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from urllib.parse import quote

from interplan_sumo.batch.records import JobKey
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.report.costly import where_points_went
from interplan_sumo.report.page.drives import (
    BANDS,
    ShownDrive,
    by_scenario,
    pair_replay,
    replays_folder,
    shown,
    shown_drives,
)
from interplan_sumo.report.page.figures import best_figure, family_blocks, legend, scene_thumbnails, score_spread
from interplan_sumo.report.page.html import html, style_of
from interplan_sumo.report.page.replays import drive_folders
from interplan_sumo.report.paper_comparison import published_figure, published_rows
from interplan_sumo.report.table import ResultsTable
from interplan_sumo.report.table_formats import notes, shown_columns


def page(
    table: ResultsTable,
    runs: Sequence[StoredRun] = (),
    *,
    title: str = "interplan-sumo report",
    paper: bool = False,
    path: Path | None = None,
) -> str:
    """The whole report as HTML. Names, reasons and messages are text whatever they hold.

    `runs` are those of the table, for how they were made. Replays that lie
    beside `path`, where the page will be, are linked.
    """
    drives = shown_drives(table)
    folder = replays_folder(path) if path is not None else None
    replays = {file.name for file in folder.glob("*.html")} if folder is not None else set[str]()
    folders = drive_folders(table, runs)
    columns = shown_columns(table, paper=paper)
    return html(
        "report.html.j2",
        style=style_of("page.css"),
        script=files(__package__ or "").joinpath("page.js").read_text(encoding="utf-8"),
        title=title,
        table=table,
        missing=[f"{scenario} ({name}, seed {seed})" for line in table.lines for scenario, name, seed in line.missing],
        columns=columns,
        best={column.key: best_figure(table, column) for column in columns},
        published=published_rows() if paper else [],
        published_figure=published_figure,
        notes=notes(table, paper=paper),
        legend=legend(columns),
        bands=BANDS,
        spread=score_spread(table, drives),
        went=where_points_went(table.lines),
        blocks=family_blocks(table, drives, scene_thumbnails(runs)),
        drives=drives,
        shown=shown,
        links=_links(drives, replays, folder),
        make={drive.anchor: _make(drive, folders, folder) for drive in drives if drive.replay not in replays},
        make_all=_make_all(runs, folder) if drives and not replays else "",
        made=[_made(run) for run in runs] or [_driven(table)],
    )


# --- replays -------------------------------------------------------------------------------------


def _links(
    drives: Sequence[ShownDrive], replays: Collection[str], folder: Path | None
) -> dict[str, list[tuple[str, str]]]:
    """Of each drive, by anchor, the replays that lie there: where each shows what decided, and what it is."""
    base = quote(folder.name) if folder is not None else ""
    pairs = {scenario: name for scenario, all in by_scenario(drives).items() if (name := pair_replay(all)) in replays}
    found: dict[str, list[tuple[str, str]]] = {}
    for drive in drives:
        names = [(drive.replay, "replay")] if drive.replay in replays else []
        names += [(pairs[drive.scenario], "best and worst")] if drive.scenario in pairs else []
        found[drive.anchor] = [(f"{base}/{quote(name)}#decides", text) for name, text in names]
    return found


def drive_links(drives: Sequence[ShownDrive], page: Path | None) -> dict[str, list[tuple[str, str]]]:
    """Of each drive, by anchor, the replays beside where a page lies: file and what it shows."""
    folder = None if page is None else replays_folder(page)
    return _links(drives, {file.name for file in folder.glob("*.html")} if folder is not None else set(), folder)


def _make(drive: ShownDrive, folders: Mapping[tuple[int, JobKey], Path], folder: Path | None) -> str:
    """The command that makes the replay of a drive; nothing where it is not known which run it is of."""
    run = folders.get((drive.line, (drive.scenario, drive.planner, drive.seed)))
    if run is None:
        return ""
    place = folder / drive.replay if folder is not None and folder.is_dir() else drive.replay
    command = ["interplan-sumo", "replay", str(run), drive.scenario, "--planner", drive.planner]
    return shlex.join([*command, *(["--seed", str(drive.seed)] if drive.seed else []), "--html", str(place)])


def _make_all(runs: Iterable[StoredRun], folder: Path | None) -> str:
    """The command that makes this page with replays beside it."""
    folders = [str(run.path) for run in runs]
    if folder is None or not folders:
        return ""
    page_name = f"{folder.name.removesuffix('-replays')}.html"
    return shlex.join(
        ["interplan-sumo", "report", *folders, "--html", str(folder.with_name(page_name)), "--replays", "lost"]
    )


# --- how it was made -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Made:
    """How one run was made: what its manifest says, by what it is called on the page."""

    name: str
    entries: Mapping[str, str]


def _made(run: StoredRun) -> Made:
    manifest = run.manifest
    seeds = max((request.seeds for request in manifest.requests), default=0)
    overrides = ", ".join(f"{key}={value}" for key, value in manifest.overrides.texts().items()) or "none"
    versions = ", ".join(f"{name} {version}" for name, version in manifest.versions.items())
    entries = {
        "Suite": manifest.suite,
        "Suite hash": manifest.suite_hash,
        "Profile": manifest.profile,
        "Planners": ", ".join(run.planners),
        "Seeds": _seeds(seeds),
        "Changes to the traffic": overrides,
        "Versions": versions,
        "Platform": manifest.platform,
        "Started": manifest.created,
        "Command": shlex.join(manifest.command),
    }
    return Made(run.path.name, {name: str(text) for name, text in entries.items() if text})


def _driven(table: ResultsTable) -> Made:
    """All there is to say without the runs."""
    return Made("", {line.label: f"{line.scenarios} scenarios, {_seeds(line.seeds)}" for line in table.lines})


def _seeds(count: int) -> str:
    return "seed 0" if count == 1 else f"seeds 0 to {count - 1}"
