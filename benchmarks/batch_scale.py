"""How a run grows: what a job costs the parent, how long rows take to read, what workers give and whether they leak.

    python benchmarks/batch_scale.py [--jobs 5000] [--rows 100000] [--episodes 500]
                                     [--parts engine reporting throughput memory]

`docs/running.md` quotes the figures and what they mean for a hundred thousand drives.
"""

from __future__ import annotations

import argparse
import gc
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from interplan_sumo.batch.drive_job import DriveSettings, drive_jobs
from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.jobs import Job
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.pieces import keep_pieces
from interplan_sumo.batch.records import AppliedOverrides, Manifest, MetricRecord, RequestedJobs, Row
from interplan_sumo.batch.results import RESULTS, write_rows
from interplan_sumo.batch.run_folder import RunFolder
from interplan_sumo.batch.tasks import Answer, Limits, Publish, Task, Work
from interplan_sumo.metrics.profile import DEFAULT_PROFILE, find_profile
from interplan_sumo.scenario.suite import find_suite

PLANNER = "straight_ahead"
"""Plans in no time: what is measured is everything else."""
SEEDS = 100
"""Drives of a scenario."""
DRIVES_PER_LINE = 50
WARMING_UP = 16
"""Drives before the clock starts: starting, importing and reading maps is not what is asked for."""
GOAL = 100_000
"""The number of drives that is extrapolated to."""


def main() -> None:
    """Measure the parts that are asked for, and print them."""
    parts: dict[str, Callable[[argparse.Namespace, Path], None]] = {
        "engine": engine,
        "reporting": reporting,
        "throughput": throughput,
        "memory": memory,
    }
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=5000, help="toy jobs of the part engine")
    parser.add_argument("--rows", type=int, default=GOAL, help="rows of the part reporting")
    parser.add_argument("--episodes", type=int, default=500, help="drives of the part memory")
    parser.add_argument("--parts", nargs="+", choices=parts, default=list(parts))
    arguments = parser.parse_args()
    for name in arguments.parts:
        with tempfile.TemporaryDirectory() as folder:
            parts[name](arguments, Path(folder))


def engine(arguments: argparse.Namespace, folder: Path) -> None:
    """Rate of jobs that do nothing, with rows appended and synced, and how the parent grows."""
    began_s, before_kb = time.perf_counter(), resident_kb()
    marks: dict[int, int] = {}
    for done, _ in enumerate(toy_run(folder, arguments.jobs), start=1):
        if done in (arguments.jobs // 10, arguments.jobs):
            gc.collect()
            marks[done] = resident_kb()
    wall_s = time.perf_counter() - began_s
    (few, few_kb), (many, many_kb) = marks.items()
    print(f"engine: {many / wall_s:.0f} toy jobs/s, {1e3 * wall_s / many:.2f} ms each with its row synced")
    print(
        f"  parent: {before_kb / 1e3:.0f} MB before, {few_kb / 1e3:.1f} after {few}, {many_kb / 1e3:.1f} after {many}"
    )
    each_kb = (many_kb - few_kb) / (many - few)
    print(f"  growth: {each_kb:.2f} kB per job, {each_kb * GOAL / 1e3:.0f} MB for {GOAL}")


def reporting(arguments: argparse.Namespace, folder: Path) -> None:
    """Seconds and peak memory of reports on many rows, by the lines alone and with pieces, each in its own process."""
    toy_folder(folder, arguments.rows).close()
    write_rows(folder / RESULTS, (toy_row(number) for number in range(arguments.rows)))
    size_mb = (folder / RESULTS).stat().st_size / 1e6
    print(f"reporting: {arguments.rows} rows, {size_mb:.0f} MB")
    report(folder, "text, by the lines alone")
    began_s, used_s = time.perf_counter(), time.process_time()
    keep_pieces(folder)
    made_s, used_s = time.perf_counter() - began_s, time.process_time() - used_s
    pieces_mb = sum(path.stat().st_size for path in (folder / "results").iterdir()) / 1e6
    print(f"  all pieces made: {made_s:.1f} s, {used_s:.1f} s of a core, {pieces_mb:.0f} MB")
    report(folder, "text")
    report(folder, "csv", "--csv")
    report(folder, "json", "--json")
    began_s = time.perf_counter()
    columns = pd.read_parquet(folder / "results").shape[1]
    print(f"  pandas.read_parquet: {time.perf_counter() - began_s:.1f} s, {columns} columns")


def report(folder: Path, name: str, *options: str) -> None:
    """Time `interplan-sumo report` from its start, and ask it for its peak memory and what it computed."""
    program = (
        "import resource, sys, time; from interplan_sumo.cli import main; main(sys.argv[1:]); "
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time(), file=sys.stderr)"
    )
    command = [sys.executable, "-c", program, "report", str(folder), *options]
    began_s = time.perf_counter()
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=True)
    wall_s, (peak_kb, cpu_s) = time.perf_counter() - began_s, map(float, done.stderr.split()[-2:])
    print(f"  report as {name}: {wall_s:.1f} s, {cpu_s:.1f} s of a core, {peak_kb / 1e3:.0f} MB at most", flush=True)


def throughput(_arguments: argparse.Namespace, folder: Path) -> None:
    """Drives per second by two workers against one, one after the other so that a change of load shows."""
    jobs = drives(40)
    rates: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(2):
        for workers, found in rates.items():
            outcomes = driven(jobs, folder, workers)
            for _ in range(WARMING_UP):
                next(outcomes)
            began_s = time.perf_counter()
            found.append(sum(1 for _ in outcomes) / (time.perf_counter() - began_s))
    one, two = (max(found) for found in rates.values())
    print(f"throughput: {one:.2f} drives/s with 1 worker, {two:.2f} with 2: {two / one:.2f} times; all: {rates}")


def memory(arguments: argparse.Namespace, folder: Path) -> None:
    """Memory of one worker over many drives, and what processes are left."""
    processes: Counter[int] = Counter()
    for done, value in enumerate(driven(drives(arguments.episodes), folder, 1), start=1):
        processes[value["process"]] += 1
        if done % DRIVES_PER_LINE == 0:
            print(f"memory: {done} drives, the worker has {value['resident_kb'] / 1e3:.0f} MB", flush=True)
    print(f"  {len(processes)} process did them; children left: {children()}")


def drives(count: int) -> list[Job]:
    """The drives of the smoke suite, seed after seed."""
    scenarios = find_suite("smoke==1").scenarios
    return [Job(scenarios[n % len(scenarios)], PLANNER, n // len(scenarios)) for n in range(count)]


def driven(jobs: Sequence[Job], folder: Path, workers: int) -> Iterator[dict[str, Any]]:
    """What each drive gives, and the memory of the process that did it."""
    tasks = [Task(job.key, job.planner, job) for job in jobs]
    settings = DriveSettings(folder, RunOptions(), find_profile(DEFAULT_PROFILE))
    with closing(run_tasks(tasks, partial(open_weighed, settings), workers=workers, limits=Limits())) as outcomes:
        for outcome in outcomes:
            assert outcome.fault is None, outcome.fault
            yield outcome.value


def open_weighed(settings: DriveSettings, group: str, publish: Publish) -> Work:
    """Drives that tell how much memory their process has afterwards."""
    drive = drive_jobs(settings)(group, publish)

    def work(job: Job) -> Answer:
        value, fault = drive(job)
        return value | {"resident_kb": resident_kb(), "process": os.getpid()}, fault

    return work


def toy_run(folder: Path, count: int) -> Iterator[Row]:
    """A run whose jobs do nothing, as `batch.run` goes about it."""
    with toy_folder(folder, count) as held:
        tasks = [Task(n, "toy", n) for n in range(count)]
        with closing(run_tasks(tasks, open_toy, workers=2, limits=Limits())) as outcomes:
            for outcome in outcomes:
                row = toy_row(outcome.task.payload)
                held.append(row)
                yield row


def toy_folder(folder: Path, count: int) -> RunFolder:
    """The folder of a run of so many drives, SEEDS of each scenario."""
    asked = RequestedJobs(("toy",), tuple(f"lane_change_mtd/{n}" for n in range(-(-count // SEEDS))), SEEDS)
    return RunFolder(
        folder,
        Manifest(
            suite="toy==1",
            suite_hash="",
            profile=DEFAULT_PROFILE,
            overrides=AppliedOverrides(),
            versions={},
            traffic_version=2,
            command=(),
            created="",
            platform="",
            plan_limit_s=None,
            requests=(asked,),
        ),
    )


def toy_row(number: int) -> Row:
    """A row with as many keys and figures as a real one."""
    names = [term.name for term in find_profile(DEFAULT_PROFILE).terms]
    metrics = {
        name: MetricRecord(
            0.5 + 0.5 * (number % 7 > 0),
            {"goal": True} | {f"figure_{f}": number / (f + 1) for f in range(12)},
            f"as it is, {number} m from where it was" if number % 7 == 0 else None,
        )
        for name in names
    }
    return Row(
        scenario_id=f"lane_change_mtd/{number // SEEDS}",
        family="lane_change_mtd",
        planner="toy",
        seed=number % SEEDS,
        score=number % 101 / 100,
        metrics=metrics,
        gates=tuple(names[:5]),
        weights=dict.fromkeys(names[5:], 1.0),
        fault=None,
        official=True,
        overrides=AppliedOverrides(),
        perception="full",
        trace_hash=f"{number:064}",
        times_s={},
        versions={},
        traffic_version=2,
        reached_goal=True,
        isolated=True,
        planner_hash=None,
        site="toy/1",
        scenario_hash="",
        trace=f"traces/{number}",
    )


def open_toy(_group: str, _publish: Publish) -> Work:
    return lambda number: ({"square": number * number}, None)


def resident_kb() -> int:
    """Memory of this process that is in RAM; Linux only."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1000


def children() -> list[str]:
    """The processes that this one has started and not yet reaped, with their state; Linux only."""
    found: list[str] = []
    for thread in Path("/proc/self/task").iterdir():
        for pid in (thread / "children").read_text().split():
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
            if "resource_tracker" not in Path(f"/proc/{pid}/cmdline").read_text():
                found.append(f"{pid} {state}")
    return found


if __name__ == "__main__":
    main()
