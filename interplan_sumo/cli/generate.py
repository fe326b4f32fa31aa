"""Command `scenarios generate`: new scenarios on any map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from interplan_sumo.cli.certify import proved
from interplan_sumo.cli.options import DONE, INCOMPLETE, JsonOption, WorkersOption, counted
from interplan_sumo.report.printing import print_json


def generate(
    map: Annotated[str, typer.Option(help="A shipped map's name, or a folder with a map.gpkg and its network.")],
    family: Annotated[str, typer.Option(help="A family, an ordinary type, 'all' families or all 'ordinary' types.")],
    out: Annotated[Path, typer.Option(help="The folder for scenarios, certificates and reports.")],
    count: Annotated[int, typer.Option(help="How many of each family.")] = 10,
    seed: Annotated[int, typer.Option(help="Equal seeds give equal scenarios.")] = 0,
    certify: Annotated[bool, typer.Option(help="Look for a drive that passes each.")] = True,
    workers: WorkersOption = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace what the folder holds.")] = False,
    as_json: JsonOption = False,
) -> int:
    """Find sites on a map and make new scenarios there, each checked and, where a drive passes, certified.

    The folder also holds what they need of a map that is not shipped, so that it can be moved and driven anywhere.
    Exit code 3 if the map has no room for as many as were asked for.
    """
    from interplan_sumo.maps.store import find_map, load_roads
    from interplan_sumo.verification.generation import carry, check_folder, families_of, write_generated
    from interplan_sumo.verification.generation import generate as generated
    from interplan_sumo.verification.map_bundling import own_maps_root

    check_folder(out, overwrite=overwrite)
    files = find_map(map)
    root = own_maps_root(files)
    made = [generated(load_roads(files.folder), name, count, seed, maps_beside=root) for name in families_of(family)]
    if root is not None and any(each.scenarios for each in made):
        carry(made, files, out, overwrite=overwrite)
    scenarios = [scenario for each in made for scenario in each.scenarios]
    proofs = proved(scenarios, workers) if certify else []
    total, passed = write_generated(out, made, proofs, overwrite=overwrite)
    short = {each.family: len(each.scenarios) for each in made if len(each.scenarios) < count}
    if as_json:
        print_json({"folder": str(out), "scenarios": total, "certified": passed if certify else None, "short": short})
    else:
        print(f"{counted(total, 'scenario')}{f', {passed} certified' if certify else ''}: {out}")
        for name, number in short.items():
            print(f"{name}: {number} of {count}; {out / 'rejected.csv'} says why places do not suit")
    return INCOMPLETE if short else DONE
