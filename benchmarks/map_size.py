"""How long a large map takes: python -m benchmarks.map_size [--lanes 10000] [--convert]

Draws a grid city, writes it, reads it, and crops it to a site; with --convert
also makes the SUMO network of that crop and of the whole city. Every step is timed alone, in order,
with the largest memory that the process had needed by its end.
"""

from __future__ import annotations

import argparse
import math
import resource
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from interplan_sumo.maps.crop import crop
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.geopackage_writer import write_map
from interplan_sumo.maps.rules import schema_problems
from tests.maps.road_worlds import GridPlan, grid_city

RADIUS_M = 250.0


@contextmanager
def timed(what: str) -> Generator[None]:
    start = time.perf_counter()
    yield
    seconds = time.perf_counter() - start
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{what:<44}{seconds:9.3f} s   peak {peak_mib:6.0f} MiB", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Times of a large map.")
    parser.add_argument("--lanes", type=int, default=10_000, help="at least so many lanes")
    parser.add_argument("--convert", action="store_true", help="also make SUMO networks (needs netconvert)")
    options = parser.parse_args()
    # A square grid of n junctions a side has 2 n (n - 1) roads, each with two lanes in both directions.
    side = next(n for n in range(2, 1000) if 8 * n * (n - 1) >= options.lanes)
    plan = GridPlan(columns=side, rows=side, lanes=2)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "grid" / "1.0" / "map.gpkg"
        with timed("draw"):
            roads = grid_city(plan)
        with timed("check nuPlan's rules"):
            problems = schema_problems(roads)
        with timed("write (checks included)"):
            write_map(roads, path)
        print(
            f"  {len(roads.lanes)} lanes, {len(roads.connectors)} connectors, {len(problems)} problems, "
            f"{path.stat().st_size / 2**20:.0f} MiB"
        )
        with timed("read"):
            roads = read_map(path)
        x_m, y_m = (at + math.floor(side / 2) * plan.spacing_m for at in plan.origin_m)
        with timed(f"first crop of {RADIUS_M:g} m (indexes the map)"):
            crop(roads, [(x_m, y_m)], RADIUS_M)
        with timed(f"second crop of {RADIUS_M:g} m"):
            part = crop(roads, [(x_m + 300.0, y_m)], RADIUS_M)
        print(f"  {len(part.lanes)} lanes, {len(part.connectors)} connectors")
        if options.convert:
            from interplan_sumo.maps.to_sumo import convert

            with timed("convert the crop"):
                convert(part, Path(folder) / "crop")
            with timed("convert the whole city"):
                convert(roads, Path(folder) / "whole")


if __name__ == "__main__":
    main()
