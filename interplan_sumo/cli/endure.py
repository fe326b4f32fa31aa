"""The command `endure`: kilometres through a district, and how often a planner fails on them."""

from __future__ import annotations

import contextlib
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.cli.completion import map_names, measure_names
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
from interplan_sumo.report.printing import console, print_json

if TYPE_CHECKING:
    from interplan_sumo.endurance.rate_sample import MeasureKey
    from interplan_sumo.endurance.records import SegmentRecord
    from interplan_sumo.endurance.stop_rule import StopStanding

PAGE = "report.html"
PLOT = "rates.png"
"""In the folder."""
SAY_S = 10.0
"""Between two lines of progress."""


@takes_run_options(
    "planners", "out", "workers", "traffic", "in_process", "plan_limit_s", "memory_gb",
    planners="As run --planner takes it. Default: the recommended one.",
    out="The folder; the same command resumes it.",
    in_process="The planner in the worker's process.",
    memory_gb="Of a worker (Linux); 0 for no limit.",
    traffic="Vehicle types in place of --behaviour.",
)  # fmt: skip
def endure(
    context: typer.Context,
    options: RunOptions,
    map_: Annotated[
        str, typer.Option("--map", help="A shipped map, or a folder.", metavar="MAP", autocompletion=map_names)
    ],
    km: Annotated[float, typer.Option(help="To drive, at most; with more it goes farther.", metavar="KM")],
    density: Annotated[float, typer.Option(help="Of traffic; 1 is a full district.", metavar="SHARE")] = 0.5,
    behaviour: Annotated[str | None, typer.Option(help="A file of routes/. Default: mixed.", metavar="NAME")] = None,
    rare: Annotated[
        float | None,
        typer.Option(help="Of an event, per opportunity and second. Default: 0.0003.", metavar="RATE"),
    ] = None,
    seed: Annotated[int, typer.Option(help="Of starts and traffic.")] = 0,
    naive_share: Annotated[float, typer.Option(help="Segments with events as rare as they are.")] = 0.5,
    until_half_width: Annotated[
        float | None,
        typer.Option(help="0.3: stop once a rate is known to 30 %.", metavar="SHARE"),
    ] = None,
    of: Annotated[
        str,
        typer.Option(
            help="That rate.",
            metavar="MEASURE",
            autocompletion=measure_names,
        ),
    ] = "at_fault_collision",
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> int:
    """Drive kilometres instead of scenes: collisions and other failures per 1000 km, with intervals."""
    take_one_thread()
    from interplan_sumo.endurance.kilometres import EndureOptions, drive_kilometres
    from interplan_sumo.endurance.rate_sample import measure_named
    from interplan_sumo.endurance.stop_rule import StopRule
    from interplan_sumo.planner import RECOMMENDED

    if len(options.planners) > 1:
        raise InputError("endure drives one planner at a time; give --planner once, and the same --out for the next")
    if behaviour is not None and options.traffic is not None:
        raise InputError("--traffic replaces the vehicle types that --behaviour chooses; give only one")
    measure = measure_named(of)
    until = None if until_half_width is None else StopRule(until_half_width, measure)
    folder, command = run_folder(context, options, "endure-")
    wanted = EndureOptions(
        planner=next(iter(options.planners), RECOMMENDED),
        map=map_,
        km=km,
        out=folder,
        density=density,
        behaviour=behaviour or "mixed",
        traffic=options.traffic,
        rare=rare,
        seed=seed,
        naive_share=naive_share,
        until=until,
        run=options,
    )
    try:
        with contextlib.redirect_stdout(sys.stderr):  # in-process planners may print: not into the table or JSON
            drive_kilometres(wanted, _Progress(quiet=quiet))
    except KeyboardInterrupt:
        print(f"stopped; what was done is kept. Go on with: {shlex.join(command)}", file=sys.stderr)
        return INCOMPLETE
    say_what_was_driven(folder, command, measure, until_half_width, as_json=as_json, quiet=quiet)
    return DONE


class _Progress:
    """A line on stderr now and then."""

    def __init__(self, *, quiet: bool) -> None:
        self._quiet = quiet
        self._records: list[SegmentRecord] = []
        self._planned = 0
        self._said_s = time.monotonic()

    def planned(self, segments: int, done: Sequence[SegmentRecord]) -> None:
        """So many segments in all, as far as is known, of which these are done."""
        self._records = list(done)
        self._planned = segments
        self._say(f"{counted(segments, 'segment')}, {len(done)} done")

    def finished(self, record: SegmentRecord) -> None:
        """One more has been driven."""
        self._records.append(record)
        if record.fault is not None:
            self._say(f"segment {record.index}: {record.fault.kind} fault: {record.fault.message}")
        if time.monotonic() - self._said_s >= SAY_S:
            self._say(f"[{len(self._records)}/{self._planned}] {_driven(self._records)}")

    def looked(self, standing: StopStanding) -> None:
        """After a batch, where it drives until a rate is known."""
        from interplan_sumo.endurance.formats import standing_text

        self._say(standing_text(standing))

    def _say(self, text: str) -> None:
        self._said_s = time.monotonic()
        if not self._quiet:
            print(text, file=sys.stderr, flush=True)


def _driven(records: Sequence[SegmentRecord]) -> str:
    km = sum(record.metres for record in records) / 1000.0
    hit = sum(event.kind == "collision" and event.at_fault for record in records for event in record.events)
    return f"{km:.1f} km, {counted(hit, 'at-fault collision')}"


def say_what_was_driven(
    folder: Path, command: Sequence[str], measure: MeasureKey, wanted: float | None, *, as_json: bool, quiet: bool
) -> None:
    """The rates of all that a folder holds: as tables or JSON, as its page, and as its figure."""
    from interplan_sumo.endurance.formats import endurance_json, endurance_text
    from interplan_sumo.endurance.kilometres import EVENTS, read_segments
    from interplan_sumo.endurance.page import write_endurance_report
    from interplan_sumo.endurance.report import WANTED, endurance_report

    report = endurance_report(read_segments(folder), measure=measure, wanted=wanted or WANTED)
    page, plot = folder / PAGE, folder / PLOT
    write_endurance_report(report, page=page, command=shlex.join(command))
    with contextlib.suppress(InputError):  # without matplotlib there is the page
        write_endurance_report(report, plot=plot)
    if as_json:
        print_json({"folder": str(folder), **endurance_json(report)})
    else:
        for each in endurance_text(report):
            console().print(each)
    if not quiet:
        print(f"wrote {page}; each kept event is a drive of {folder / EVENTS}", file=sys.stderr)
