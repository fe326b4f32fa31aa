"""The command `verify`: does a run come again, to the last bit?"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.cli.completion import run_folders
from interplan_sumo.cli.options import (
    DONE,
    INCOMPLETE,
    OUR_FAULT,
    JsonOption,
    QuietOption,
    take_one_thread,
    takes_run_options,
)
from interplan_sumo.errors import InputError, RunFolderError
from interplan_sumo.report.printing import console, print_json, progress


@takes_run_options(
    "planners",
    "scenarios",
    "workers",
    "traffic",
    planners="Only this planner, as the run was asked for it.",
    scenarios="Only ids that match, such as 'nudge/*'.",
    traffic="The run's vehicle-type file, if it lies elsewhere now.",
)
def verify(
    folder: Annotated[Path, typer.Argument(help="A run folder.", metavar="DIR", autocompletion=run_folders)],
    options: RunOptions,
    sample: Annotated[int | None, typer.Option(help="So many drives, drawn at random. Default: 10.")] = None,
    every: Annotated[bool, typer.Option("--all", help="All drives.")] = False,
    seed: Annotated[int, typer.Option(help="Of the draw.")] = 0,
    tolerant: Annotated[
        bool, typer.Option("--tolerant", help="Let 1 mm and 1e-6 in the score pass, as between two machines.")
    ] = False,
    with_planner: Annotated[
        bool,
        typer.Option("--with-planner", help="Have the planners plan again, in place of their stored plans."),
    ] = False,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> int:
    """Drive rows of a run again from their stored plans, without their planners, and compare trace, score and metrics.

    Where they differ, it says from which step, in what and how far. Rows that
    come again are noted in the folder's verified.json; `report` counts them.
    Exit code 1 if a drive differs, 3 if one could not be verified.
    """
    take_one_thread()
    import contextlib

    from interplan_sumo.batch.run_folder import read_run
    from interplan_sumo.batch.verify import RowSample, note_verified
    from interplan_sumo.batch.verify import verify as drive_again
    from interplan_sumo.report.verify_formats import verification_json, verification_text

    if every and sample is not None:
        raise InputError(f"--all and --sample {sample} are two sizes; give one of them")
    size = None if every else 10 if sample is None else sample
    wanted = RowSample(size, seed, options.scenarios, options.planners)
    try:
        with progress(quiet=quiet) as watch, contextlib.redirect_stdout(sys.stderr):
            stored = read_run(folder)
            found = drive_again(stored, wanted, options, watch, with_planner=with_planner)
    except KeyboardInterrupt:
        print("stopped; nothing was written", file=sys.stderr)
        return INCOMPLETE
    try:
        note_verified(found)
    except RunFolderError as error:
        print(f"not noted: {error}", file=sys.stderr)
    if as_json:
        print_json(verification_json(found))
    else:
        console().print(verification_text(found))
    if any(check.verdict == "differs" and not (tolerant and check.within_bars) for check in found.checks):
        return OUR_FAULT
    return INCOMPLETE if found.count("unverifiable") else DONE
