"""Document: the page as one file without requests; whatever it shows is text, and it reads without JavaScript."""

from __future__ import annotations

import hashlib
import shlex
from base64 import b64encode
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.report.formats import notes
from interplan_sumo.report.page import figures
from interplan_sumo.report.page.drives import ShownDrive, by_scenario, pair_replay, replays_folder, shown_drives
from interplan_sumo.report.table import ResultsTable

LISTED = 20
"""So many missing jobs are named at the top; the rest is counted."""


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
    rows = {drive: f"drive-{number}" for number, drive in enumerate(drives)}
    folder = replays_folder(path) if path is not None else None
    replays = {file.name for file in folder.glob("*.html")} if folder is not None else set[str]()
    sections = {
        "scores": ("Scores", f'<div class="scroll">{figures.scores(table, paper=paper)}</div>{_notes(table, paper)}'),
        "families": ("By family", f'<div class="cards">{figures.families(table)}</div>'),
        "spread": ("How scores spread", f'<div class="scroll">{figures.spread(table, drives)}</div>'),
        "scenarios": ("Every scenario", f'<div class="blocks">{figures.matrix(table, drives, rows)}</div>'),
        "drives": ("Every drive", _drives(table, drives, rows, replays, folder, runs)),
        "made": ("How it was made", _made(table, runs)),
    }
    links = "".join(f'<a href="#{name}">{text}</a>' for name, (text, _) in sections.items())
    body = "".join(
        f'<section aria-labelledby="{name}"><h2 id="{name}">{text}</h2>{inner}</section>'
        for name, (text, inner) in sections.items()
    )
    style, script = _part("page.css"), _part("page.js")
    policy = f"default-src 'none'; style-src '{_digest(style)}'; script-src '{_digest(script)}'; base-uri 'none'"
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{escape(title)}</title>
<style>{style}</style>
</head>
<body>
<header>
<h1>{escape(title)}</h1>
<p class="soft">Suite <code>{escape(table.suite)}</code>, profile <code>{escape(table.profile)}</code></p>
<nav aria-label="Sections">{links}</nav>
</header>
<main>
{_warnings(table, rows)}
{body}
</main>
<script>{script}</script>
</body>
</html>
"""


def _notes(table: ResultsTable, paper: bool) -> str:
    return "".join(f'<p class="note">{escape(note)}</p>' for note in notes(table, paper=paper))


# --- what went wrong -----------------------------------------------------------------------------


def _warnings(table: ResultsTable, rows: Mapping[ShownDrive, str]) -> str:
    missing = [
        f"{scenario} ({planner}, seed {seed})" for line in table.lines for scenario, planner, seed in line.missing
    ]
    faulty = [(drive, row) for drive, row in rows.items() if drive.fault]
    found = ""
    if missing:
        text = f"This run is incomplete. No score for: {_listed(missing)}."
        found += f'<p class="warn" role="alert">{escape(text)}</p>'
    if faulty:
        links = "".join(
            f'<li><a href="#{row}">{escape(f"{drive.scenario}, {drive.label}, seed {drive.seed}")}</a>: '
            f"{escape(drive.reasons[0])}</li>"
            for drive, row in faulty
        )
        said = f"{len(faulty)} drive{'s' if len(faulty) > 1 else ''} ended in a fault"
        found += f'<details class="warn"><summary>{said}</summary><ul>{links}</ul></details>'
    return found


def _listed(entries: Sequence[str]) -> str:
    return ", ".join(entries[:LISTED]) + (f" and {len(entries) - LISTED} more" if len(entries) > LISTED else "")


# --- drives --------------------------------------------------------------------------------------


def _drives(
    table: ResultsTable, drives: Sequence[ShownDrive], rows: Mapping[ShownDrive, str], replays: Collection[str],
    folder: Path | None, runs: Sequence[StoredRun],
) -> str:  # fmt: skip
    names = (("scenario", ""), ("planner", ""), ("seed", "n"), ("score", "score"), ("goal line", ""),
             ("what cost points", ""))  # fmt: skip
    head = (
        "".join(f'<th scope="col" class="{kind}">{name}</th>' for name, kind in names) + '<th scope="col">replay</th>'
    )
    pairs = {scenario: mine for scenario, mine in by_scenario(drives).items() if pair_replay(scenario) in replays}
    body = ""
    for drive in drives:
        links = _links(drive, replays, drive.scenario in pairs, folder)
        links += "" if drive.replay in replays else _make(drive, runs, folder)
        body += _drive(drive, rows[drive], links)
    hint = _hint(runs, folder) if drives and not replays else ""
    return (
        f"{_filters(table, drives)}{hint}"
        '<div class="scroll"><table class="drives" id="all-drives"><caption class="hidden">Every drive, with what cost '
        f"points</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _drive(drive: ShownDrive, row: str, links: str) -> str:
    if drive.score is None:
        score = '<span class="fault">none</span>'
    else:
        score = f"{figures.score_bar(drive.score)}{drive.score:.1f}"
    mark = ' class="fault"' if drive.fault else ""
    items = "".join(f"<li{mark}>{escape(reason)}</li>" for reason in drive.reasons)
    value = -1 if drive.score is None else round(drive.score, 4)
    lost = " data-lost" if drive.lost else ""
    return (
        f'<tr id="{row}" data-line="{drive.line}" data-family="{escape(drive.family)}"{lost}>'
        f'<th scope="row">{escape(drive.scenario)}</th>'
        f"<td>{figures.who(drive.line, drive.label)}</td>"
        f'<td class="n">{drive.seed}</td><td class="score" data-value="{value}">{score}</td>'
        f"<td>{'passed' if drive.reached_goal else 'not passed'}</td>"
        f'<td>{f"<ul>{items}</ul>" if items else "nothing"}</td><td class="replay">{links}</td></tr>'
    )


def _filters(table: ResultsTable, drives: Sequence[ShownDrive]) -> str:
    """Controls that the script brings to life; without it they stay hidden and all drives are shown."""
    planners = "".join(f'<option value="{i}">{escape(line.label)}</option>' for i, line in enumerate(table.lines))
    names = "".join(
        f'<option value="{escape(family)}">{escape(family)}</option>'
        for family in dict.fromkeys(drive.family for drive in drives)
    )
    return (
        '<form class="filters" id="filters" hidden>'
        '<label>Search <input type="search" name="text" placeholder="scenario or reason" autocomplete="off"></label>'
        f'<label>Planner <select name="line"><option value="">all</option>{planners}</select></label>'
        f'<label>Family <select name="family"><option value="">all</option>{names}</select></label>'
        '<label class="check"><input type="checkbox" name="lost"> Only lost points</label>'
        '<button type="reset">Clear</button>'
        f'<output id="count">{len(drives)} drives</output></form>'
    )


def _links(drive: ShownDrive, replays: Collection[str], paired: bool, folder: Path | None) -> str:
    links = [(drive.replay, "replay")] if drive.replay in replays else []
    if paired:
        links.append((pair_replay(drive.scenario), "best and worst"))
    base = quote(folder.name) if folder is not None else ""
    return " ".join(f'<a href="{base}/{quote(name)}">{text}</a>' for name, text in links)


def _make(drive: ShownDrive, runs: Sequence[StoredRun], folder: Path | None) -> str:
    """How to make the replay of this drive; nothing where it is not known which run it is of."""
    run = next((run for run in runs if (drive.scenario, drive.planner, drive.seed) in run.rows), None)
    if run is None:
        return ""
    place = folder / drive.replay if folder is not None and folder.is_dir() else drive.replay
    command = ["interplan-sumo", "replay", str(run.path), drive.scenario, "--planner", drive.planner]
    command += [*(["--seed", str(drive.seed)] if drive.seed else []), "--html", str(place)]
    return f"<details><summary>make</summary><code>{escape(shlex.join(command))}</code></details>"


def _hint(runs: Iterable[StoredRun], folder: Path | None) -> str:
    folders = [str(run.path) for run in runs]
    if folder is None or not folders:
        return ""
    page_name = f"{folder.name.removesuffix('-replays')}.html"
    command = ["interplan-sumo", "report", *folders, "--html", str(folder.with_name(page_name)), "--replays", "lost"]
    return f'<p class="note">Replays to watch beside this page: <code>{escape(shlex.join(command))}</code></p>'


# --- how it was made -----------------------------------------------------------------------------


def _made(table: ResultsTable, runs: Sequence[StoredRun]) -> str:
    if not runs:
        lines = "".join(
            f"<dt>{escape(line.label)}</dt><dd>{line.scenarios} scenarios, {_seeds(line.seeds)}</dd>"
            for line in table.lines
        )
        return f"<dl>{lines}</dl>"
    return "".join(_run(run) for run in runs)


def _run(run: StoredRun) -> str:
    manifest: Mapping[str, Any] = run.manifest
    seeds = max((int(request["seeds"]) for request in manifest["requests"]), default=0)
    planners = dict.fromkeys(planner for request in manifest["requests"] for planner in request["planners"])
    overrides = ", ".join(f"{key}={value}" for key, value in manifest["overrides"].items()) or "none"
    versions = ", ".join(f"{name} {version}" for name, version in manifest.get("versions", {}).items())
    entries = {
        "Suite": manifest["suite"],
        "Suite hash": manifest["suite_hash"],
        "Profile": manifest["profile"],
        "Planners": ", ".join(planners),
        "Seeds": _seeds(seeds),
        "Changes to the traffic": overrides,
        "Versions": versions,
        "Platform": manifest.get("platform"),
        "Started": manifest.get("created"),
        "Command": shlex.join(manifest.get("command", [])),
    }
    found = "".join(
        f"<dt>{name}</dt><dd>{f'<code>{escape(str(value))}</code>' if name in _VERBATIM else escape(str(value))}</dd>"
        for name, value in entries.items()
        if value
    )
    return f"<h3>{escape(run.path.name)}</h3><dl>{found}</dl>"


_VERBATIM = ("Suite", "Suite hash", "Profile", "Command")


def _seeds(count: int) -> str:
    return "seed 0" if count == 1 else f"seeds 0 to {count - 1}"


# --- parts ---------------------------------------------------------------------------------------


@cache
def _part(name: str) -> str:
    return files(__package__ or "").joinpath(name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    """What a policy knows a text by."""
    return f"sha256-{b64encode(hashlib.sha256(text.encode()).digest()).decode()}"
