"""What features and samples cost: python benchmarks/features_speed.py [--every 5]

Replays the certified drives of the smoke suite and times, on one core, the
arrays of one `plan()` call (median and 95th percentile), the first call on a
map, whole samples with futures and labels, and writing them; and counts bytes
per sample on disk.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from interplan_sumo.dataset.columns import Columns, count_of, joined, write_arrays
from interplan_sumo.dataset.drives import DriveSelection, chosen_drives, driven
from interplan_sumo.dataset.observation_replay import ObservationReplay
from interplan_sumo.dataset.samples import drive_samples
from interplan_sumo.features.lane_graph import lane_graph
from interplan_sumo.features.map_lines import map_lines
from interplan_sumo.features.view import EgoView


def seconds_since(began: float) -> float:
    return time.perf_counter() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--every", type=int, default=5, help="frames between samples")
    every: int = parser.parse_args().every
    drives = chosen_drives((), ("smoke==1",), DriveSelection(min_score=0.0)).drives
    parts: list[Columns] = []
    calls_ms: list[float] = []
    replay_s = samples_s = 0.0
    print(
        f"{'scenario':<20}{'map':>10}{'first call s':>14}{'graph s':>9}"
        f"{'actors':>8}{'lanes':>7}{'median ms':>11}{'p95 ms':>8}"
    )
    for number, drive in enumerate(drives):
        began = time.perf_counter()
        scenario, roads, trace = driven(drive)
        replay_s += seconds_since(began)
        began = time.perf_counter()
        map_lines(roads)
        first_s = seconds_since(began)
        began = time.perf_counter()
        lane_graph(roads)
        graph_s = seconds_since(began)
        replayed = ObservationReplay(scenario, roads, trace)
        view = EgoView(replayed.mission)
        here: list[float] = []
        actors, lanes = [], []
        for frame in range(len(trace)):
            seen = replayed.at(frame)
            began = time.perf_counter()
            arrays = view.arrays(seen)
            here.append(1e3 * seconds_since(began))
            actors.append(len(seen.actors))
            lanes.append(int(arrays["lanes_valid"].sum()))
        calls_ms += here
        print(
            f"{scenario.id:<20}{roads.name:>10}{first_s:>14.2f}{graph_s:>9.2f}{np.mean(actors):>8.0f}"
            f"{np.mean(lanes):>7.0f}{np.median(here):>11.2f}{np.quantile(here, 0.95):>8.2f}"
        )
        drive_samples(scenario, roads, trace, drive=number, every_frames=len(trace))  # the map's first labels
        began = time.perf_counter()
        parts.append(drive_samples(scenario, roads, trace, drive=number, every_frames=every))
        samples_s += seconds_since(began)
    columns = joined(parts)
    count = count_of(columns)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "shard.npz"
        began = time.perf_counter()
        write_arrays(path, columns)
        written_s, size = seconds_since(began), path.stat().st_size
    raw = sum(values.nbytes for values in columns.values())
    print(f"arrays(seen): median {np.median(calls_ms):.2f} ms, p95 {np.quantile(calls_ms, 0.95):.2f} ms")
    print(
        f"samples: {1e3 * samples_s / count:.1f} ms each; writing {1e3 * written_s / count:.1f} ms each; {count} in all"
    )
    print(f"replay of certificates: {replay_s / len(drives):.2f} s a drive")
    print(f"bytes per sample: {size / count:,.0f} on disk, {raw / count:,.0f} in memory")


if __name__ == "__main__":
    main()
