"""`python -m tools.make_maps [ROOT]`: draw or import the shipped maps with their SUMO networks, and check them."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from interplan_sumo.maps.check import MapReport, check_map
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.maps.store import MapFiles, write_maps_manifest
from interplan_sumo.maps.to_sumo import convert
from tools.make_maps import PLANS
from tools.make_maps.draw import draw_plan
from tools.make_maps.plan import Plan
from tools.make_maps.reading import read_plan
from tools.make_maps.real import RECIPES, make_real_map, read_recipe

VERSION = "1.0"


def make_map(plan: Plan, root: Path) -> MapReport:
    """Write `<root>/<name>/1.0/` with map, network and id map, list it in the root, and check it.

    The network is made from the map as it reads back from disk, so that both
    agree to the last digit.
    """
    files = MapFiles(plan.name, VERSION, root / plan.name / VERSION)
    write_map(draw_plan(plan), files.gpkg)
    roads = read_map(files.gpkg, plan.name)
    convert(roads, files.folder)
    write_maps_manifest(root)
    return check_map(files, roads)


def _make_all(root: Path) -> Iterator[tuple[str, MapReport]]:
    for name, file in PLANS.items():
        yield name, make_map(read_plan(file), root)
    for name, file in RECIPES.items():
        yield name, make_real_map(read_recipe(file), root)


if __name__ == "__main__":
    for name, report in _make_all(Path(sys.argv[1] if len(sys.argv) > 1 else "nets")):
        print(name, "is sound" if report.ok else "; ".join(map(str, report.problems)))
