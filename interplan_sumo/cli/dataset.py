"""Command `dataset ordinary`: training data of ordinary driving, from nothing."""

from __future__ import annotations

import shlex
import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from interplan_sumo.cli.options import DONE, INCOMPLETE, LOOKS, JsonOption, QuietOption, WorkersOption, take_one_thread
from interplan_sumo.report.printing import print_json

dataset_app = typer.Typer(help="Training data from nothing.", **LOOKS)


@dataset_app.callback()
def dataset() -> None:
    """Training data from nothing; `export` makes them of drives that there are."""


@dataset_app.command()
def ordinary(
    context: typer.Context,
    out: Annotated[Path, typer.Option(help="The dataset's folder; the same command on it goes on.")],
    samples: Annotated[int, typer.Option(help="For training and validation together.")] = 24_000,
    seed: Annotated[
        int, typer.Option(help="Of the first scenes, 100000 or more: smaller ones made the suites.")
    ] = 100_000,
    maps: Annotated[
        list[str] | None, typer.Option(help="Drive on this map. Default: seven of the districts.", metavar="MAP")
    ] = None,
    holdout_maps: Annotated[
        list[str] | None, typer.Option(help="A map for the split `test` only.", metavar="MAP")
    ] = None,
    min_score: Annotated[float, typer.Option(help="Least score, 0 to 1, of a drive, however far it came.")] = 0.9,
    workers: WorkersOption = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> int:
    """Make scenes of ordinary driving, drive them, and write what planners and cars around them saw and did.

    Nothing of an official suite is used. Options with a name may be repeated.
    """
    from interplan_sumo.batch.processes import available_cores

    take_one_thread()
    from interplan_sumo.cli.export import print_summary, summary
    from interplan_sumo.dataset.ordinary import MAPS, OrdinaryRequest, make_ordinary

    request = OrdinaryRequest(
        out,
        samples,
        seed,
        maps=tuple(maps or MAPS),
        holdout_maps=tuple(holdout_maps or ()),
        min_score=min_score,
        workers=available_cores() if workers is None else workers,
    )
    began_s = time.perf_counter()
    try:
        manifest = make_ordinary(request, (lambda _line: None) if quiet else _say)
    except KeyboardInterrupt:
        command = shlex.join(["interplan-sumo", *context.obj])
        print(f"stopped; the drives that were done are kept. Go on with: {command}", file=sys.stderr)
        return INCOMPLETE
    entry = summary(out, manifest, time.perf_counter() - began_s)
    print_json(entry) if as_json else print_summary(entry)
    return DONE


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
