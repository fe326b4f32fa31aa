"""Command replay: a stored drive to look at, as a page, a film, a picture, or in sumo-gui."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from interplan_sumo.cli.completion import planner_names, run_folders, scenario_ids
from interplan_sumo.cli.options import DONE
from interplan_sumo.errors import InputError

if TYPE_CHECKING:
    from interplan_sumo.batch.stored_drive import StoredDrive


def replay(
    folder: Annotated[Path, typer.Argument(help="A run folder.", metavar="RUN", autocompletion=run_folders)],
    scenario: Annotated[
        str,
        typer.Argument(help="A scenario of the run, such as nudge/0.", metavar="SCENARIO", autocompletion=scenario_ids),
    ],
    planner: Annotated[
        list[str] | None,
        typer.Option("--planner", help="As the run names it. Default: its first two.", autocompletion=planner_names),
    ] = None,
    seed: Annotated[int, typer.Option(help="The seed that was driven.")] = 0,
    html: Annotated[
        Path | None, typer.Option(help="A page that plays it, two planners at most.", metavar="FILE")
    ] = None,
    gif: Annotated[Path | None, typer.Option(help="A film for slides and issues.", metavar="FILE")] = None,
    mp4: Annotated[Path | None, typer.Option(help="A film, sharper and smaller.", metavar="FILE")] = None,
    png: Annotated[Path | None, typer.Option(help="One frame, of --at.", metavar="FILE")] = None,
    sumo_gui: Annotated[Path | None, typer.Option(help="What sumo-gui needs to show it.", metavar="DIR")] = None,
    at: Annotated[float | None, typer.Option(help="Seconds, for --png and --sumo-gui. Default: what decided.")] = None,
    from_s: Annotated[float | None, typer.Option("--from", help="Seconds at which the films begin.")] = None,
    to_s: Annotated[float | None, typer.Option("--to", help="Seconds at which the films end.")] = None,
    speed: Annotated[float, typer.Option(help="Of the films; 2 is twice as fast.")] = 1.0,
) -> int:
    """Look at a stored drive: what the planner saw, planned and did, and when it lost its points."""
    if not (html or gif or mp4 or png or sumo_gui):
        raise InputError("replay writes what it is asked for; give --html FILE, --gif, --mp4, --png or --sumo-gui DIR")
    from interplan_sumo.batch.run_folder import read_run
    from interplan_sumo.batch.stored_drive import StoredDrives
    from interplan_sumo.report.replay.data import MOST_DRIVES

    drives = StoredDrives(read_run(folder)).of(scenario, seed, planner or (), MOST_DRIVES)
    if html:
        from interplan_sumo.report.replay.page import write_replay

        write_replay(drives, html)
        _said(html)
    for film, first_s, last_s in ((gif, from_s, to_s), (mp4, from_s, to_s), (png, at, None)):
        if film:
            from interplan_sumo.report.film import write_film

            write_film(drives, film, from_s=first_s, to_s=last_s, speed=speed)
            _said(film)
    if sumo_gui:
        _open_in_sumo_gui(drives, sumo_gui, at)
    return DONE


def _open_in_sumo_gui(drives: Sequence[StoredDrive], folder: Path, at_s: float | None) -> None:
    """Write a folder for the drive, or one inside it for each of several."""
    from interplan_sumo.batch.run_folder import slug
    from interplan_sumo.report.sumo_gui.folder import write_sumo_gui

    for drive in drives:
        place = folder if len(drives) == 1 else folder / slug(drive.row.planner)
        _said(write_sumo_gui(drive, place, at_s=at_s))


def _said(path: Path) -> None:
    print(f"wrote {path}", file=sys.stderr)
