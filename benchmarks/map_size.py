"""What a large map takes: python -m benchmarks.map_size [--lanes 2500 10000 40000 100000] [--import]

Draws a grid city of each size, writes it, reads it, checks nuPlan's rules, crops it to a site, makes its SUMO network
and checks that; with --import also takes a SUMO network of such a grid through `maps import` and `maps check --source`.
One column a size: CPU seconds of each step, netconvert's included, and the largest memory of the process in the end.
Sizes run in processes of their own. What is linear takes four times as long for four times the lanes.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import subprocess
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

from interplan_sumo.maps.check import check_map
from interplan_sumo.maps.crop import crop
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.maps.importers.importing import check_source, import_map
from interplan_sumo.maps.rules import schema_problems
from interplan_sumo.maps.store import MapFiles
from interplan_sumo.maps.to_sumo import convert, program_path, sumo_home
from tests.maps.road_worlds import GridPlan, grid_city

RADIUS_M = 250.0
_Made = TypeVar("_Made")


def cpu_s() -> float:
    """Of this process and of those that it has waited for."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


class Steps:
    """The time of each step, by its name."""

    def __init__(self) -> None:
        self.taken: dict[str, float] = {}

    def __call__(self, what: str, step: Callable[[], _Made]) -> _Made:
        start_s = cpu_s()
        made = step()
        self.taken[what] = cpu_s() - start_s
        return made


def measured(lanes: int, imports: bool) -> dict[str, float]:
    """Rows of the table for one size."""
    # A square grid of n junctions a side has 2 n (n - 1) roads, each with two lanes in both directions.
    side = next(n for n in range(2, 1000) if 8 * n * (n - 1) >= lanes)
    steps = Steps()
    with TemporaryDirectory() as folder:
        if imports:
            _imported(steps, side, Path(folder, "foreign"))
        else:
            _own(steps, side, Path(folder))
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"lanes": 8 * side * (side - 1), **steps.taken, "peak MiB": peak_mib}


def _own(steps: Steps, side: int, folder: Path) -> None:
    plan = GridPlan(columns=side, rows=side, lanes=2)
    files = MapFiles("grid", "1.0", folder / "grid" / "1.0")
    roads = grid_city(plan)
    steps("write", lambda: write_map(roads, files.gpkg))
    roads = steps("read", lambda: read_map(files.gpkg))
    steps("nuPlan's rules", lambda: schema_problems(roads))
    x_m, y_m = (at + math.floor(side / 2) * plan.spacing_m for at in plan.origin_m)
    steps("first crop (indexes the map)", lambda: crop(roads, [(x_m, y_m)], RADIUS_M))
    part = steps("second crop", lambda: crop(roads, [(x_m + 300.0, y_m)], RADIUS_M))
    steps("convert the crop", lambda: convert(part, folder / "crop"))
    steps("convert the city", lambda: convert(roads, files.folder))
    steps("check the network", lambda: check_map(files, roads))


def _imported(steps: Steps, side: int, folder: Path) -> None:
    folder.mkdir()
    grid = folder / "grid.net.xml"
    shape = ["--grid", f"--grid.number={side}", "--grid.length=150", "--default.lanenumber=2", "--no-turnarounds"]
    command = [str(program_path("netgenerate")), *shape, f"--output-file={grid}"]
    subprocess.run(command, env={**os.environ, "SUMO_HOME": str(sumo_home())}, check=True, capture_output=True)
    files, record = steps("import", lambda: import_map(grid, "sumo", folder / "city"))
    roads = read_map(files.gpkg, files.name)
    steps("check", lambda: check_map(files, roads))
    steps("compare with the file", lambda: check_source(files, roads, record, grid))


def main() -> None:
    parser = argparse.ArgumentParser(description="What a large map takes.")
    parser.add_argument(
        "--lanes", type=int, nargs="+", default=[2500, 10_000, 40_000, 100_000], help="at least so many"
    )
    parser.add_argument("--import", dest="imports", action="store_true", help="import a SUMO network of such a size")
    options = parser.parse_args()
    for lanes in options.lanes:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            rows = pool.submit(measured, lanes, options.imports).result()
        print(
            "  ".join(
                f"{what}: {value:.3g}" if value < 1000 else f"{what}: {value:.0f}" for what, value in rows.items()
            ),
            flush=True,
        )


if __name__ == "__main__":
    main()
