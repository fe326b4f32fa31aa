"""A run of toy tasks into a run folder, to be killed."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from unittest.mock import patch

from interplan_sumo.batch import results, run_folder
from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.records import Manifest
from interplan_sumo.batch.run_folder import RunFolder
from interplan_sumo.batch.tasks import Limits, Task
from tests.batch.hasher import open_hasher
from tests.records import asked, manifest, row

PIECE = 5
"""Rows of a Parquet piece: few, so that a run of a dozen rows writes several."""


def toy_manifest(count: int) -> Manifest:
    return manifest(asked("toy", " ".join(f"toy/{n}" for n in range(count))))


def main(folder: Path, count: int, workers: int) -> None:
    with patch.object(results, "LINES_AT_ONCE", PIECE), patch.object(run_folder, "LINES_AT_ONCE", PIECE):
        run_toys(folder, count, workers)


def run_toys(folder: Path, count: int, workers: int) -> None:
    with RunFolder(folder, toy_manifest(count)) as held:
        tasks = [Task(n, "toy", n) for n in range(count) if (f"toy/{n}", "toy", 0) not in held.done]
        with closing(run_tasks(tasks, open_hasher, workers=workers, limits=Limits())) as outcomes:
            for outcome in outcomes:
                assert outcome.fault is None, outcome.fault
                held.append(row(f"toy/{outcome.task.payload}", 1.0, planner="toy", **outcome.value))
