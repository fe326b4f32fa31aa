"""Commands about traffic: what a vehicle-type file does here, `traffic realism` and `traffic calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from interplan_sumo.cli.calibrate import calibrate_drivers
from interplan_sumo.cli.options import DONE, LOOKS, JsonOption
from interplan_sumo.cli.realism import TakingSeveral, realism

traffic_app = typer.Typer(help="Vehicle-type files: how others drive.", **LOOKS)


@traffic_app.callback()
def traffic() -> None:
    """Vehicle-type files: how others drive."""


@traffic_app.command("check")
def check_file(
    file: Annotated[Path, typer.Argument(help="A vehicle-type file.", metavar="FILE.xml")],
    plot: Annotated[Path | None, typer.Option(help="Draw speeds and gaps there.", metavar="FILE.png")] = None,
    as_json: JsonOption = False,
) -> int:
    """What in a vehicle-type file acts here, what cannot, and what its drivers do in standard situations, in SUMO."""
    from interplan_sumo.report.printing import console, print_json
    from interplan_sumo.report.traffic_check import check_json, check_tables, check_traffic, plot_check

    found = check_traffic(file)
    if plot is not None:
        plot_check(found, plot)
    if as_json:
        print_json(check_json(found))
    else:
        place = console()
        for part in check_tables(found):
            place.print(part)
    return DONE


traffic_app.command("realism", cls=TakingSeveral)(realism)
traffic_app.command("calibrate")(calibrate_drivers)
