"""Commands about maps: list, check, convert, render."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from interplan_sumo.cli.options import DONE, LOOKS, OUR_FAULT, JsonOption, MapArgument
from interplan_sumo.errors import InputError
from interplan_sumo.report.printing import print_entries, print_json

maps_app = typer.Typer(help="Maps and their SUMO networks.", **LOOKS)


@maps_app.command("list")
def list_maps(as_json: JsonOption = False) -> None:
    """The shipped maps."""
    from interplan_sumo.report.listings import map_entries

    print_entries(map_entries(), as_json=as_json)


@maps_app.command("check")
def check_map(
    folder: MapArgument,
    source: Annotated[Path | None, typer.Option(help="Compare the network with this map.gpkg.", metavar="FILE")] = None,
    as_json: JsonOption = False,
) -> int:
    """How faithful a map's SUMO network is: deviations, missing and extra ways, lights, broken rules."""
    from interplan_sumo.maps.check import check_map as check
    from interplan_sumo.maps.geopackage import read_map
    from interplan_sumo.maps.store import find_map, load_roads

    files = find_map(folder)
    report = check(files, load_roads(folder) if source is None else read_map(source, files.name))
    if as_json:
        print_json(report.as_json())
    else:
        details = report.as_json()
        problems = details.pop("problems")
        print_entries([{"": key, "value": _in_words(value)} for key, value in details.items()], as_json=False)
        for problem in problems:
            print(f"problem: {problem}")
    return DONE if report.ok else OUR_FAULT


@maps_app.command("convert")
def convert_map(folder: MapArgument) -> None:
    """Build the SUMO network of a map beside it, with the id map that ties the two."""
    from interplan_sumo.maps.store import find_map, load_roads
    from interplan_sumo.maps.to_sumo import convert

    files = find_map(folder)
    convert(load_roads(folder), files.folder)
    print(f"wrote {files.network} and {files.ids}; measure it: interplan-sumo maps check {folder}")


@maps_app.command("render")
def render_map(
    folder: MapArgument,
    picture: Annotated[Path, typer.Argument(help="Its ending says which kind.", metavar="FILE.png")],
    lane_ids: Annotated[bool, typer.Option("--lane-ids", help="Write the id on every lane.")] = False,
) -> None:
    """Draw a map: lanes, directions, connectors, limits, crossings, lights."""
    from interplan_sumo.maps import render
    from interplan_sumo.maps.store import load_roads

    try:
        render.render_map(load_roads(folder), picture, lane_ids=lane_ids)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot write the picture {picture}: {error}") from None
    print(f"wrote {picture}")


def _in_words(value: Any) -> Any:
    """Figures of a report for people: rounded, long lists counted."""
    match value:
        case float():
            return f"{value:.4g}"
        case dict():
            return ", ".join(f"{k} {v:.4g}" for k, v in value.items())
        case list() | tuple():
            return len(value)
        case _:
            return value
