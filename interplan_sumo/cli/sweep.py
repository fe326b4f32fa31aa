"""The command `sweep`: how results depend on traffic and perception."""

from __future__ import annotations

import contextlib
import shlex
import sys
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Annotated

import typer

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.cli.completion import sweep_parameters
from interplan_sumo.cli.options import (
    DONE,
    INCOMPLETE,
    JsonOption,
    QuietOption,
    run_folder,
    take_one_thread,
    takes_run_options,
)
from interplan_sumo.errors import InputError, counted
from interplan_sumo.report.printing import console, print_json, progress
from interplan_sumo.world.files import writing

if TYPE_CHECKING:
    from interplan_sumo.batch.sweep import Estimate, Result, Sweep


@takes_run_options(*(each.name for each in fields(RunOptions) if each.name != "shard"))
def sweep(
    context: typer.Context,
    options: RunOptions,
    param: Annotated[
        list[str] | None,
        typer.Option(
            help="track (plain, noisy, late, dense, bold), density, behaviour, perception, a vType attribute or "
            "interplan.* parameter, TYPE.KEY for one vType. Several make every combination.",
            metavar="KEY=V1,...",
            autocompletion=sweep_parameters,
        ),
    ] = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> int:
    """How scores depend on traffic and perception: a run per combination, then a table, sweep.csv, page and plot."""
    take_one_thread()
    from interplan_sumo.batch.backend import one_connection
    from interplan_sumo.batch.sweep import Parameter, plan_sweep

    folder, command = run_folder(context, options, "sweep-")
    parameters = [Parameter.parse(text) for text in param or ()]
    try:
        planned = plan_sweep(replace(options, out=folder), parameters)
        stdout = contextlib.redirect_stdout(sys.stderr)  # in-process planners may print: not into the table or JSON
        with stdout, one_connection(options.who) as at_a_time:
            results = list(_results(planned, at_a_time, command, quiet=quiet))
    except KeyboardInterrupt:
        print(f"stopped; what was done is kept. Go on with: {shlex.join(command)}", file=sys.stderr)
        return INCOMPLETE
    if all(result.failure for result in results):
        raise InputError(str(results[0].failure))
    return _report(planned, results, command, as_json=as_json, quiet=quiet)


def _results(planned: Sweep, workers: int, command: Sequence[str], *, quiet: bool) -> Iterator[Result]:
    """Each combination's result, with its progress and what is left on stderr."""
    from interplan_sumo.batch.sweep import estimate, run_combination

    count = len(planned.combinations)
    left = estimate(planned, workers)
    if not quiet:
        print(
            f"{counted(count, 'combination')}, {counted(planned.drives, 'drive')}; {_in_words(left)}", file=sys.stderr
        )
        if planned.unchanged:
            print(f"no traffic to change, so equal results, in {_listed(planned.unchanged)}", file=sys.stderr)
    for number, combination in enumerate(planned.combinations, start=1):
        before = left.drives
        if not quiet:
            print(f"[{number}/{count}] {combination.name}", file=sys.stderr)
        with progress(quiet=quiet) as watch:
            result = run_combination(combination, watch, command)
        if result.failure is not None:
            print(f"not run: {combination.name}: {result.failure}", file=sys.stderr)
        yield result
        left = estimate(planned, workers)
        if not quiet and 0 < left.drives < before:
            print(_in_words(left), file=sys.stderr)


def _listed(ids: Sequence[str]) -> str:
    return f"{', '.join(ids[:3])}{f' and {len(ids) - 3} more' if len(ids) > 3 else ''}"


def _in_words(left: Estimate) -> str:
    """How much is still to do and how long that takes."""
    if not left.drives:
        return "all done already"
    minutes = left.wall_s / 60.0
    duration = f"{minutes:.0f} min" if minutes >= 2.0 else f"{left.wall_s:.0f} s"
    basis = "as timed so far" if left.timed else "a guess, until the first is done"
    return f"{counted(left.drives, 'drive')} left, about {duration} at {left.drive_s:.1f} s each ({basis})"


def _report(planned: Sweep, results: list[Result], command: Sequence[str], *, as_json: bool, quiet: bool) -> int:
    """Write sweep.csv, sweep.html and sweep.png, print the table; the exit code."""
    from interplan_sumo.report.sweep_formats import sweep_csv, sweep_json, sweep_text
    from interplan_sumo.report.sweep_lines import idle_parameters, sweep_lines
    from interplan_sumo.report.sweep_page import write_sweep_page
    from interplan_sumo.report.sweep_plot import plot_sweep, why_no_plot

    lines = sweep_lines(results)
    table, page, picture = (planned.folder / f"sweep.{kind}" for kind in ("csv", "html", "png"))
    with writing(table, "give another folder as --out"):
        table.write_text(sweep_csv(lines), encoding="utf-8", newline="")
    write_sweep_page(planned.parameters, lines, page, shlex.join(command))
    reason = why_no_plot(planned.parameters, lines)
    if reason is None:
        plot_sweep(planned.parameters, lines, picture)
    complete = all(line.complete for line in lines)
    if as_json:
        print_json(
            {
                "folder": str(planned.folder),
                "parameters": {parameter.key: list(parameter.values) for parameter in planned.parameters},
                "complete": complete,
                "idle": idle_parameters(planned.parameters, lines),
                "csv": str(table),
                "page": str(page),
                "plot": None if reason else str(picture),
                "rows": sweep_json(lines),
            }
        )
    else:
        console().print(sweep_text(planned.parameters, lines))
    if reason is not None:
        print(reason, file=sys.stderr)
    if not quiet:
        print(f"wrote {', '.join(map(str, [table, page, *([] if reason else [picture])]))}", file=sys.stderr)
    return DONE if complete else INCOMPLETE
