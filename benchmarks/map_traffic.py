"""Fidelity and traffic per map: `python -m benchmarks.map_traffic [FOLDER ...] [--cars N] [--seeds N]`.

Converts each map afresh into a temporary folder, checks it, and drives 60 s of
random traffic on it. Without folders: the shipped maps and the golden ones.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.table import Table

from interplan_sumo.maps.check import check_map
from interplan_sumo.maps.geopackage import read_map
from interplan_sumo.maps.store import MapFiles, maps
from interplan_sumo.maps.to_sumo import convert
from tests.maps.sumo_runs import Overlap, random_traffic

GOLDEN = Path(__file__).parents[1] / "tests" / "golden" / "nuplan_metrics" / "maps"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, help="folders that hold a map.gpkg")
    parser.add_argument("--cars", type=int, default=160)
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    known = [files.folder for root in (None, GOLDEN) for files in maps(root).values()]
    folders: list[Path] = arguments.folders or known
    fidelity = Table(
        "map", "side", "lanes", "km", "connectors", "lane max/p99 [mm]", "connector max/p99 [mm]", "missing", "extra",
        "lights", "length distortion max", "kB", "convert [s]", "start [ms]", "ok",
    )  # fmt: skip
    traffic = Table("map", "seed", "cars", "mean m/s", "teleports", "collisions", "overlaps", "of these askew",
                    "emergency brakings")  # fmt: skip
    overlaps: list[tuple[str, int, Overlap]] = []
    for folder in folders:
        roads = read_map(folder / "map.gpkg")
        with TemporaryDirectory() as place:
            files = MapFiles(roads.name, folder.name, Path(place) / roads.name / folder.name)
            files.folder.mkdir(parents=True)
            shutil.copy(folder / "map.gpkg", files.gpkg)
            start = time.perf_counter()
            convert(roads, files.folder)
            seconds = time.perf_counter() - start
            report = check_map(files, roads)
            deviations = [
                f"{1000 * d.max:.1f} / {1000 * d.p99:.1f}"
                for d in (report.lane_deviation_m, report.connector_deviation_m)
            ]
            fidelity.add_row(
                roads.name, roads.driving_side, str(report.lanes), f"{report.lane_km:.1f}", str(report.connectors),
                *deviations, str(len(report.missing)), str(len(report.extra)), str(report.lights),
                f"{100 * report.lane_length_distortion.max:.1f} %",
                f"{(files.network.stat().st_size + files.ids.stat().st_size) / 1000:.0f}", f"{seconds:.1f}",
                f"{1000 * start_up_s(files.network):.0f}", "yes" if report.ok else "NO",
            )  # fmt: skip
            for seed in range(1, arguments.seeds + 1):
                run = random_traffic(files, roads, Path(place) / "run", seed=seed, vehicles=arguments.cars)
                traffic.add_row(
                    roads.name, str(seed), str(run.vehicles), f"{run.mean_speed_mps:.1f}", str(run.teleports),
                    str(run.collisions), str(len(run.overlaps)), str(sum(o.askew for o in run.overlaps)),
                    str(run.emergency_brakings),
                )  # fmt: skip
                overlaps += [(roads.name, seed, o) for o in run.overlaps]
    console = Console(width=200)
    console.print(fidelity, traffic)
    for name, seed, o in overlaps:
        console.print(f"{name} seed {seed}: {' and '.join(o.vehicles)} overlap by {o.depth_m:.2f} m at {o.time_s:.1f} s"
                      f"{', one of them askew after a lane change' if o.askew else ''}")  # fmt: skip


def start_up_s(network: Path) -> float:
    """Seconds that libsumo needs to load a network, in a process of its own; the best of three."""
    code = (
        "import sys,time,libsumo\n"
        "best=9e9\n"
        "for _ in range(3):\n"
        "    t=time.perf_counter()\n"
        "    libsumo.start(['sumo','-n',sys.argv[1],'--no-step-log','true','--no-warnings','true'])\n"
        "    best=min(best,time.perf_counter()-t); libsumo.close()\n"
        "print(best)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(network)], capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


if __name__ == "__main__":
    main()
