"""Commands about runs: run, merge, report, score, compare."""

from __future__ import annotations

import contextlib
import shlex
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.cli.completion import run_folders
from interplan_sumo.cli.options import (
    DONE,
    INCOMPLETE,
    JsonOption,
    QuietOption,
    WorkersOption,
    run_folder,
    say_reservations,
    say_what_cannot_act,
    take_one_thread,
    takes_run_options,
)
from interplan_sumo.errors import InputError, counted
from interplan_sumo.report.printing import Form, print_comparison, print_table, progress, write_page

if TYPE_CHECKING:
    from interplan_sumo.batch.run_folder import StoredRun
    from interplan_sumo.report.table import ResultsTable

app = typer.Typer()


@app.command()
@takes_run_options()
def run(context: typer.Context, options: RunOptions, quiet: QuietOption = False, as_json: JsonOption = False) -> int:
    """Drive and score scenarios, and print the table. Repeating the command on the same folder resumes it."""
    take_one_thread()
    from interplan_sumo.batch import run as batch
    from interplan_sumo.report.costly import cost_text, next_commands

    folder, command = run_folder(context, options, "")
    stdout = contextlib.redirect_stdout(sys.stderr) if as_json else contextlib.nullcontext()
    try:
        with progress(quiet=quiet, about=_about(options, folder)) as watch, stdout:  # planners here may print
            say_what_cannot_act(options.traffic)
            stored = batch.run(replace(options, out=folder), watch, command=command)
            say_reservations(options)
    except KeyboardInterrupt:
        print(f"stopped; what was done is kept. Go on with: {shlex.join(command)}", file=sys.stderr)
        return INCOMPLETE
    table = _reported([stored], "json" if as_json else "text", folder / "report.html")
    if not quiet:
        place = f"results in {folder}, as a page in {folder / 'report.html'}; next:"
        commands = (f"  {each}" for each in next_commands(table.lines, folder))
        print(*map(cost_text, table.lines), place, *commands, sep="\n", file=sys.stderr)
    _refuse_planners_that_never_drove(table)
    return DONE if table.complete else INCOMPLETE


def _about(options: RunOptions, folder: Path) -> str:
    """What a run is going to drive, in words."""
    from interplan_sumo.batch.jobs import Selection
    from interplan_sumo.planner import RECOMMENDED

    selection, planners = Selection.of(options), dict.fromkeys(options.planners) or (RECOMMENDED,)
    scenes = f"{counted(len(selection.scenarios), 'scenario')} of {selection.source.name}"
    who = f"{counted(len(planners), 'planner')} ({', '.join(planners)})"
    where = f"in {folder}" if options.shard is None else f"part {options.shard}, in {folder}"
    at_once = "a Ray cluster" if options.who.ray else counted(options.who.processes, "worker")
    return f"{scenes}, {who}, {counted(options.seeds, 'seed')}, {at_once}, {where}"


def _refuse_planners_that_never_drove(table: ResultsTable) -> None:
    """InputError for planners whose every drive ended in a fault of their own."""
    failed = [line for line in table.lines if line.rows and line.faults == {"planner": len(line.rows)}]
    if failed:
        line, first = failed[0], failed[0].rows[0].fault
        drives = "its only drive" if len(line.rows) == 1 else f"all its {len(line.rows)} drives"
        others = f"; so did {', '.join(repr(each.planner) for each in failed[1:])}" if failed[1:] else ""
        raise InputError(
            f"planner {line.planner!r} failed in {drives}, first: {first.message if first else ''}{others}; "
            f"see: interplan-sumo planners check {shlex.quote(line.planner)}"
        )


@app.command()
def merge(
    context: typer.Context,
    folders: Annotated[
        list[Path], typer.Argument(help="The folders of all shards.", metavar="DIR", autocompletion=run_folders)
    ],
    out: Annotated[Path, typer.Option(help="The run folder; the same command on it goes on.")],
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> int:
    """Join the shards of a run, as `run --shard I/N` made them, into one run folder, and print the table."""
    from interplan_sumo.batch.merge import merge as join

    try:
        with progress(quiet=quiet) as watch:
            stored = join(folders, out, watch, ["interplan-sumo", *context.obj])
    except KeyboardInterrupt:
        print("stopped; what was copied is kept: repeat the command", file=sys.stderr)
        return INCOMPLETE
    if not quiet:
        print(f"results in {out}", file=sys.stderr)
    return _report([stored], "json" if as_json else "text", out / "report.html")


@app.command()
def report(
    folders: Annotated[list[Path], typer.Argument(help="Run folders.", metavar="DIR", autocompletion=run_folders)],
    as_json: JsonOption = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="Print the table as CSV.")] = False,
    as_markdown: Annotated[bool, typer.Option("--markdown", help="Print the table as Markdown.")] = False,
    html: Annotated[Path | None, typer.Option(help="Write one self-contained page.", metavar="FILE")] = None,
    replays: Annotated[
        str, typer.Option(help="Beside the page, replays of these drives; N are the worst.", metavar="all|lost|none|N")
    ] = "none",
    nuboard: Annotated[
        Path | None, typer.Option(help="Write what nuPlan's viewer nuBoard opens.", metavar="DIR")
    ] = None,
    paper: Annotated[bool, typer.Option("--paper", help="Add the published rows for comparison.")] = False,
    why: Annotated[bool, typer.Option("--why", help="One sentence for every zero and every lost gate.")] = False,
    details: Annotated[
        bool, typer.Option("--details", help="Every drive with its score and what cost points.")
    ] = False,
) -> int:
    """The paper's table of one or more runs, with faults, missing rows, intervals and who can be told apart.

    A run of ordinary driving, such as common==1, makes the first column of the others' lines.
    """
    from interplan_sumo.batch.run_folder import read_run

    asked: list[tuple[Form, bool]] = [("json", as_json), ("csv", as_csv), ("markdown", as_markdown)]
    forms: list[Form] = [form for form, wanted in asked if wanted]
    if len(forms) > 1:
        raise InputError(f"--{forms[0]} and --{forms[1]} both print on stdout; give one of them")
    if replays != "none" and html is None:
        raise InputError(f"--replays {replays} are made beside a page; give its file as --html")
    runs = [read_run(folder) for folder in folders]
    if nuboard is not None:
        from interplan_sumo.report.nuboard import write_nuboard

        print(f"open in nuBoard: {write_nuboard(runs, nuboard)}", file=sys.stderr)
    form = forms[0] if forms else "text"
    return _report(runs, form, html, replays, paper=paper, why=why, details=details)


@app.command()
def score(
    folder: Annotated[Path, typer.Argument(help="A run folder.", metavar="DIR", autocompletion=run_folders)],
    profile: Annotated[
        str | None, typer.Option(help="interplan-strict, interplan-paper, interplan-code, nuplan, or a FILE.yaml.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Write the rows, as in results.jsonl.", metavar="FILE")] = None,
    workers: WorkersOption = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> int:
    """Score stored traces again, under any profile, without simulating."""
    from interplan_sumo.batch.results import write_rows
    from interplan_sumo.metrics.profile import DEFAULT_PROFILE
    from interplan_sumo.world.files import check_place

    if out is not None:
        check_place(out, "give another file as --out")
    scored = _rescored(folder, profile or DEFAULT_PROFILE, workers, quiet=quiet)
    if out is not None:
        write_rows(out, scored.rows.values())
    return _report([scored], "json" if as_json else "text")


@app.command()
def compare(
    folder_a: Annotated[Path, typer.Argument(help="A run folder.", metavar="DIR_A", autocompletion=run_folders)],
    folder_b: Annotated[
        Path, typer.Argument(help="The run folder to hold against it.", metavar="DIR_B", autocompletion=run_folders)
    ],
    planner_a: Annotated[str | None, typer.Option(help="Which planner of DIR_A, if not all common ones.")] = None,
    planner_b: Annotated[str | None, typer.Option(help="Which planner of DIR_B.")] = None,
    profile: Annotated[str | None, typer.Option(help="Score both again under this profile first.")] = None,
    workers: WorkersOption = None,
    as_json: JsonOption = False,
) -> int:
    """Two runs paired on equal scenario and seed, B against A: who is better, by how much, and what changed most.

    Every planner that both folders hold against itself, or those that are named.
    """
    from interplan_sumo.batch.run_folder import read_run
    from interplan_sumo.report.compare import compare_runs

    run_a, run_b = (read_run(f) if profile is None else _rescored(f, profile, workers) for f in (folder_a, folder_b))
    found = compare_runs(run_a, run_b, planner_a, planner_b)
    print_comparison(found, as_json=as_json)
    return DONE if found.complete else INCOMPLETE


def _rescored(folder: Path, profile: str, workers: int | None, *, quiet: bool = False) -> StoredRun:
    """A stored run under another profile; what could not be scored is said on stderr."""
    from interplan_sumo.batch.run_folder import read_run
    from interplan_sumo.batch.score_job import rescore

    with progress(quiet=quiet) as watch:
        scored, problems = rescore(read_run(folder), profile, watch, workers=workers)
    for problem in problems:
        print(f"not scored: {problem}", file=sys.stderr)
    return scored


def _report(
    runs: Sequence[StoredRun], form: Form, html: Path | None = None, replays: str = "none", **options: bool
) -> int:
    """Print the table of the runs, write the page and its replays if they are asked for; the exit code."""
    return DONE if _reported(runs, form, html, replays, **options).complete else INCOMPLETE


def _reported(
    runs: Sequence[StoredRun], form: Form, html: Path | None = None, replays: str = "none", **options: bool
) -> ResultsTable:
    from interplan_sumo.report.table import make_table

    table = make_table(runs)
    if html is not None:
        write_page(table, html, runs, paper=options.get("paper", False), replays=replays)
    print_table(table, form, **options)
    return table
