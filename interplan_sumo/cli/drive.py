"""Command drive: a person at the wheel, in a browser on this machine."""

from __future__ import annotations

import sys
import webbrowser
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.cli.completion import planner_names, run_folders, scenario_ids
from interplan_sumo.cli.options import (
    DONE,
    INCOMPLETE,
    run_folder,
    take_one_thread,
    takes_run_options,
)
from interplan_sumo.errors import InputError

if TYPE_CHECKING:
    from interplan_sumo.wheel.server import WheelServer


@takes_run_options("out", "suite", "traffic", "density", "behaviour", "perception", "profile")
def drive(
    context: typer.Context,
    scenario: Annotated[
        list[str],
        typer.Argument(
            help="What to drive: ids, such as nudge/0, globs, or a FILE.yaml.", metavar="SCENARIO",
            autocompletion=scenario_ids,
        ),
    ],
    options: RunOptions,
    start: Annotated[
        Path | None, typer.Option(
            "--from", help="Take over a drive of this run folder.", metavar="RUN", autocompletion=run_folders
        )
    ] = None,
    planner: Annotated[
        str | None, typer.Option(help="Whose drive, where the run has several.", autocompletion=planner_names)
    ] = None,
    at: Annotated[
        float | None, typer.Option(help="Seconds at which to take over. Default: 3 s before what decided it.")
    ] = None,
    speed: Annotated[float, typer.Option(help="Of time; 0.5 is slow motion.")] = 1.0,
    port: Annotated[int, typer.Option(help="Of the page on 127.0.0.1; 0 takes a free one.")] = 0,
    no_open: Annotated[bool, typer.Option("--no-open", help="Open no browser, print the address only.")] = False,
) -> int:  # fmt: skip
    """Drive yourself, by keyboard or gamepad, in real time against the same traffic, and be scored as planner human."""
    take_one_thread()
    for name, value in (("--planner", planner), ("--at", at)):
        if start is None and value is not None:
            raise InputError(f"{name} {value} says what to take over; name its run folder, too: --from RUN")
    from interplan_sumo.report.printing import print_table
    from interplan_sumo.report.table import make_table
    from interplan_sumo.wheel.session import Seating, Session, StoredStart

    folder, _ = run_folder(context, options, "drive-")
    begin = None if start is None else StoredStart(start, planner, at)
    session = Session(Seating.of(replace(options, scenarios=tuple(scenario)), folder, speed, begin))

    def opened(server: WheelServer) -> None:
        print(f"at the wheel: {server.address}\nCtrl-C ends it", file=sys.stderr, flush=True)
        if not no_open:
            webbrowser.open(server.address)

    try:
        done = session.drive(opened, port)
    except KeyboardInterrupt:
        done = False
    if not session.driven:
        print("nothing was driven to its end", file=sys.stderr)
        return INCOMPLETE
    for path in dict.fromkeys(path for path, _ in session.driven):
        print(f"results in {path}", file=sys.stderr)
    from interplan_sumo.batch.run_folder import read_run

    if folder.is_dir():
        print_table(make_table([read_run(folder)]), "text")
    return DONE if done else INCOMPLETE
