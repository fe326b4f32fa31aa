"""Command `traffic calibrate`: drivers fitted to recordings."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from interplan_sumo.cli.options import DONE, JsonOption, take_one_thread
from interplan_sumo.errors import InputError


def calibrate_drivers(
    recordings: Annotated[
        list[Path],
        typer.Argument(help="Recordings of a known format, plain track files, folders of these.", metavar="RECORDING"),
    ],
    out: Annotated[Path, typer.Option(help="The vehicle-type file to write.", metavar="FILE.xml")],
    road: Annotated[str, typer.Option(help="Whose published drivers fill the gaps: city or motorway.")] = "city",
    limit: Annotated[
        list[str] | None, typer.Option(help="The speed limit of a place, in m/s.", metavar="PLACE=MPS")
    ] = None,
    drivers: Annotated[int, typer.Option(help="How many types are drawn.")] = 64,
    shift: Annotated[
        float, typer.Option(help="Quantiles by which all are more cautious (above 0) or bolder (below) than measured.")
    ] = 0.0,
    date: Annotated[str, typer.Option(help="When the recordings were made; goes into the file.")] = "",
    source: Annotated[str, typer.Option(help="Whose they are, under which licence; goes into the file.")] = "",
    as_fitted: Annotated[
        bool, typer.Option("--as-fitted", help="Leave city drivers as fitted, however they look in plain traffic.")
    ] = False,
    as_json: JsonOption = False,
) -> int:
    """Fit drivers to recordings and write them as a vehicle-type file, with the error on places left out."""
    take_one_thread()
    from interplan_sumo.realism.calibration import CalibrationOptions, calibrate, calibration_json
    from interplan_sumo.realism.calibration_tables import calibration_tables
    from interplan_sumo.realism.tracks import open_recordings
    from interplan_sumo.realism.vehicle_type_writer import write_vehicle_types
    from interplan_sumo.report.printing import console, print_json
    from interplan_sumo.world.files import check_place

    check_place(out, "give another file as --out")
    options = CalibrationOptions(road, _limits(limit or []), drivers, shift, date, source, as_fitted)  # type: ignore[arg-type]
    found = calibrate(open_recordings(recordings), options, lambda line: print(line, file=sys.stderr))
    write_vehicle_types(out, found.text())
    if as_json:
        print_json(calibration_json(found))
    else:
        for part in calibration_tables(found):
            console().print(part)
        console().print(f"{drivers} types in {out}. What they do: interplan-sumo traffic check {out}")
    return DONE


def _limits(given: list[str]) -> dict[str, float]:
    found: dict[str, float] = {}
    for text in given:
        place, equals, number = text.partition("=")
        try:
            found[place] = float(number)
        except ValueError:
            equals = ""
        if not (place and equals):
            raise InputError(f"--limit is {text!r}, expected PLACE=MPS such as main_street=13.9")
    return found
