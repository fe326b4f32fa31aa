"""The command `scenarios audit`."""

from __future__ import annotations

import contextlib
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.cli.completion import planner_names
from interplan_sumo.cli.options import DONE, INCOMPLETE, JsonOption, QuietOption, WorkersOption
from interplan_sumo.report.printing import console, print_json, progress


def audit(
    suite: Annotated[str, typer.Argument(help="NAME==VERSION, or a scenario file.", metavar="SUITE|FILE.yaml|DIR")],
    planner: Annotated[
        str, typer.Option(help="Who drives, for the look at what happens.", autocompletion=planner_names)
    ] = "idm",
    below: Annotated[float | None, typer.Option(help="Only scenarios where it has fewer points, 0 to 100.")] = None,
    workers: WorkersOption = None,
    out: Annotated[Path | None, typer.Option(help="Keep the run in this folder; it resumes there.")] = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> int:
    """Sort the scenarios of a suite or file by what they ask, unsound ones apart; with --below, find the hard ones."""
    from interplan_sumo.batch.jobs import scenario_file
    from interplan_sumo.batch.records import RequestedJobs
    from interplan_sumo.batch.run import run
    from interplan_sumo.report.audit_formats import audit_json, audit_text, findings

    with contextlib.ExitStack() as stack:
        folder = out or Path(stack.enter_context(tempfile.TemporaryDirectory())) / "run"
        file = scenario_file(suite)
        files = () if file is None else (file,)
        options = RunOptions((planner,), folder, None if files else suite, files, workers=workers)
        with progress(quiet=quiet) as watch:
            stored = run(options, watch)
        mine = RequestedJobs((planner,), tuple(dict.fromkeys(scenario for scenario, _, _ in stored.keys)), 1)
        stored = stored.narrowed(mine)  # the folder may hold others
        found = list(findings(stored, below))
    entry = audit_json(suite, planner, below, found)
    print_json(entry) if as_json else console().print(audit_text(entry))
    return INCOMPLETE if stored.missing else DONE
