"""Commands about runs: run, report, score, compare."""

from __future__ import annotations

import contextlib
import os
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from interplan_sumo.cli.options import (
    DONE,
    INCOMPLETE,
    JobLimitOption,
    JsonOption,
    MemoryOption,
    PlanLimitOption,
    PlannerOption,
    QuietOption,
)
from interplan_sumo.errors import InputError
from interplan_sumo.report.printing import Form, print_comparison, print_table, progress, write_page

if TYPE_CHECKING:
    from interplan_sumo.batch.run_folder import StoredRun

app = typer.Typer()


@app.command()
def run(
    context: typer.Context,
    planner: PlannerOption = None,
    suite: Annotated[str | None, typer.Option(help="NAME==VERSION.")] = None,
    scenarios: Annotated[
        list[str] | None, typer.Option(help="Only ids that match, such as 'nudge/*'; or a FILE.yaml.")
    ] = None,
    seeds: Annotated[int, typer.Option(help="Seeds 0 to N-1; seed 0 is the certified one.")] = 1,
    workers: Annotated[
        str | None,
        typer.Option(
            help="Processes; 0 runs in this one. Default: all cores. ray[:ADDRESS] takes the CPUs of a Ray cluster.",
            metavar="N|ray[:ADDRESS]",
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="The run folder; the same command on it goes on.")] = None,
    traffic: Annotated[Path | None, typer.Option(help="A vehicle-type file instead of the scenarios' own.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="density=low|medium|high or behaviour=NAME.")] = None,
    limit: Annotated[int | None, typer.Option(help="At most so many scenarios.")] = None,
    plan_limit: PlanLimitOption = 10.0,
    job_limit: JobLimitOption = 3600.0,
    memory_gb: MemoryOption = 8.0,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> int:
    """Drive and score scenarios, and print the table. Repeating the command on the same folder resumes it."""
    from interplan_sumo.batch.processes import SINGLE_THREAD

    os.environ.update({name: os.environ.get(name, value) for name, value in SINGLE_THREAD.items()})
    from interplan_sumo.batch import run as batch

    folder = out or Path("runs") / f"{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"
    command = ["interplan-sumo", *context.obj, *([] if out else ["--out", str(folder)])]
    request = batch.RunRequest.of(
        planner or (),
        folder,
        suite=suite,
        scenarios=scenarios or (),
        seeds=seeds,
        workers=workers,
        changes=set_ or (),
        traffic=traffic,
        limit=limit,
        plan_limit_s=plan_limit,
        job_limit_s=job_limit,
        memory_gb=memory_gb,
        command=command,
    )
    stdout = contextlib.redirect_stdout(sys.stderr) if as_json else contextlib.nullcontext()
    try:
        with progress(quiet=quiet) as watch, stdout:  # in-process planners may print: not into the JSON
            stored = batch.run(request, watch)
    except KeyboardInterrupt:
        print(f"stopped; what was done is kept. Go on with: {shlex.join(command)}", file=sys.stderr)
        return INCOMPLETE
    if not quiet:
        print(f"results in {folder}", file=sys.stderr)
    return _report([stored], "json" if as_json else "text", folder / "report.html")


@app.command()
def report(
    folders: Annotated[list[Path], typer.Argument(help="Run folders.", metavar="DIR...")],
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
    """The paper's table of one or more runs, with faults, missing rows and intervals over seeds.

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
    folder: Annotated[Path, typer.Argument(help="A run folder.", metavar="DIR")],
    profile: Annotated[
        str | None, typer.Option(help="interplan-paper, interplan-code, nuplan, or a FILE.yaml.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Write the rows, as in results.jsonl.", metavar="FILE")] = None,
    as_json: JsonOption = False,
) -> int:
    """Score stored traces again, under any profile, without simulating."""
    from interplan_sumo.batch.results import write_rows
    from interplan_sumo.metrics.profile import DEFAULT_PROFILE

    scored = _rescored(folder, profile or DEFAULT_PROFILE)
    if out is not None:
        write_rows(out, scored.rows.values())
    return _report([scored], "json" if as_json else "text")


@app.command()
def compare(
    folder_a: Annotated[Path, typer.Argument(help="A run folder.", metavar="DIR_A")],
    folder_b: Annotated[Path, typer.Argument(help="The run folder to hold against it.", metavar="DIR_B")],
    planner_a: Annotated[str | None, typer.Option(help="Which planner, where DIR_A holds several.")] = None,
    planner_b: Annotated[str | None, typer.Option(help="Which planner, where DIR_B holds several.")] = None,
    profile: Annotated[str | None, typer.Option(help="Score both again under this profile first.")] = None,
    as_json: JsonOption = False,
) -> int:
    """B against A, paired on equal scenario and seed: the mean difference with its interval, and what changed most."""
    from interplan_sumo.batch.run_folder import read_run
    from interplan_sumo.report.compare import compare as compare_runs

    run_a, run_b = (read_run(f) if profile is None else _rescored(f, profile) for f in (folder_a, folder_b))
    found = compare_runs(run_a, run_b, planner_a, planner_b)
    print_comparison(found, as_json=as_json)
    return DONE if found.complete else INCOMPLETE


def _rescored(folder: Path, profile: str) -> StoredRun:
    """A stored run under another profile; what could not be scored is said on stderr."""
    from interplan_sumo.batch.rescore import rescore
    from interplan_sumo.batch.run_folder import read_run

    scored, problems = rescore(read_run(folder), profile)
    for problem in problems:
        print(f"not scored: {problem}", file=sys.stderr)
    return scored


def _report(
    runs: Sequence[StoredRun], form: Form, html: Path | None = None, replays: str = "none", **options: bool
) -> int:
    """Print the table of the runs, write the page and its replays if they are asked for; the exit code."""
    from interplan_sumo.report.table import make_table

    table = make_table(runs)
    if html is not None:
        write_page(table, html, runs, paper=options.get("paper", False), replays=replays)
    print_table(table, form, **options)
    return DONE if table.complete else INCOMPLETE
