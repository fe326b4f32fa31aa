"""Commands about maps: list, import, check, convert, render."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from interplan_sumo.cli.completion import starting
from interplan_sumo.cli.options import DONE, LOOKS, OUR_FAULT, JsonOption, MapArgument, naming
from interplan_sumo.errors import InputError, counted
from interplan_sumo.report.printing import print_entries, print_json

maps_app = typer.Typer(help="Maps and their SUMO networks.", **LOOKS)


@maps_app.command("list")
def list_maps(as_json: JsonOption = False) -> None:
    """The shipped maps."""
    from interplan_sumo.report.listings import map_entries

    print_entries(map_entries(), as_json=as_json)


def _formats() -> list[str]:
    from interplan_sumo.maps.importers.formats import MAP_FORMATS

    return list(MAP_FORMATS)


@maps_app.command("import", cls=naming("format", _formats))
def import_map(
    source: Annotated[Path, typer.Argument(help="A map file, or a folder that holds one.", metavar="SOURCE")],
    out: Annotated[Path, typer.Option(help="The map's folder to be; the map takes its name.", metavar="DIR")],
    format: Annotated[str, typer.Option(metavar="NAME", autocompletion=starting(_formats))],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the map that the folder holds.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Read a foreign map into nuPlan's schema and build its SUMO network; says what could not be taken over."""
    from interplan_sumo.maps.geopackage import read_map
    from interplan_sumo.maps.importers.importing import import_map as bring_in

    files, record = bring_in(source, format, out, overwrite=overwrite)
    roads = read_map(files.gpkg, files.name)
    left_out = {reason: len(ids) for reason, ids in record.left_out.items()}
    if as_json:
        print_json(
            {
                "name": files.name, "path": str(files.folder), "lanes": len(roads.lanes),
                "connectors": len(roads.connectors), "left_out": left_out, "notes": record.notes,
            }
        )  # fmt: skip
        return
    print(f"{files.folder}: {counted(len(roads.lanes), 'lane')}, {counted(len(roads.connectors), 'connector')}")
    for reason, count in left_out.items():
        print(f"left out: {count} x {reason}")
    for note in record.notes:
        print(f"note: {note}")
    print(f"measure it: interplan-sumo maps check {out} --source {source}")


@maps_app.command("check")
def check_map(
    folder: MapArgument,
    source: Annotated[
        Path | None, typer.Option(help="Compare with this file: a map.gpkg, or what was imported.", metavar="FILE")
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """How faithful a map's SUMO network is: deviations, missing and extra ways, lights, broken rules.

    With --source, an imported map is also held against a second reading of the
    file that it came from: no lane, link, light or limit may be lost. Of
    OpenDRIVE, netconvert's reading is told as well.
    """
    from dataclasses import asdict

    from interplan_sumo.maps.check import check_map as check
    from interplan_sumo.maps.geopackage import read_map
    from interplan_sumo.maps.importers.importing import check_source, second_opinion
    from interplan_sumo.maps.importers.record import read_record
    from interplan_sumo.maps.store import find_map, load_roads

    files = find_map(folder)
    if source is None or source.suffix == ".gpkg":
        details = check(files, load_roads(folder) if source is None else read_map(source, files.name)).as_json()
    else:
        record = read_record(files.folder)
        if record is None:
            raise InputError(f"{files.folder} was not imported; compare it with a map.gpkg")
        roads = load_roads(folder)
        details = check(files, roads).as_json() | {"source": asdict(check_source(files, roads, record, source))}
        details["problems"] = [*details["source"].pop("problems"), *details["problems"]]
        opinion = second_opinion(record, source)
        if opinion is not None:
            details["opinion"] = asdict(opinion)
            details["problems"] += details["opinion"].pop("problems")
        details["ok"] = not details["problems"]
    if as_json:
        print_json(details)
    else:
        _print_check(details)
    return DONE if details["ok"] else OUR_FAULT


def _print_check(details: dict[str, Any]) -> None:
    from interplan_sumo.maps.problem import MapProblem

    problems, source, opinion = details.pop("problems"), details.pop("source", None), details.pop("opinion", None)
    print_entries([{"": key, "value": _in_words(value)} for key, value in details.items()], as_json=False)
    if source is not None:
        by = "read again by other code" if source["second_reader"] else "no second reader: as the importer reads it"
        print(f"\nagainst {source['file']} ({source['format']}, {by}):")
        rows = [
            {"": key, "file": _in_words(pair["file"]), "map": _in_words(pair["map"])}
            for key, pair in source.items()
            if isinstance(pair, dict) and key != "streets"
        ]
        rows.append({"": "leaving", "file": source["leaving"], "map": ""})
        print_entries(rows, as_json=False)
        print("\nstreets:")
        print_entries([{"": key, "value": _in_words(value)} for key, value in source["streets"].items()], as_json=False)
    if opinion is not None:
        print(f"\nas {opinion['program']} reads the file, its roads outside junctions:")
        rows = [
            {"": key, "ours": _in_words(pair["ours"]), opinion["program"]: _in_words(pair["theirs"])}
            for key, pair in opinion.items()
            if isinstance(pair, dict)
        ]
        print_entries(rows, as_json=False)
        for explanation in opinion["explanations"]:
            print(f"differs: {explanation}")
    for problem in problems:
        print(f"problem: {MapProblem(**problem)}")


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
    from interplan_sumo.maps.render import render_map as draw
    from interplan_sumo.maps.store import load_roads

    draw(load_roads(folder), picture, lane_ids=lane_ids)
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
