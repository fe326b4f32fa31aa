"""A small run and its dataset, made once for the tests that read them."""

from __future__ import annotations

from pathlib import Path

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.run import run
from interplan_sumo.dataset.drives import DriveSelection
from interplan_sumo.dataset.export import ExportRequest

ANY_SCORE = DriveSelection(min_score=0.0)


def recorded_run(folder: Path, *scenarios: str, seeds: int = 1) -> Path:
    """A run of the IDM planner over scenarios of the benchmark."""
    run(RunOptions(("idm",), folder, suite="interplan==1", scenarios=scenarios, seeds=seeds, workers=0))
    return folder


def request(out: Path, *runs: Path, choice: DriveSelection = ANY_SCORE, **options: object) -> ExportRequest:
    """An export in this process, a sample every 2 s, shards of 4."""
    settled = {"every_s": 2.0, "workers": 0, "shard_samples": 4, **options}
    return ExportRequest(out, tuple(runs), choice=choice, **settled)  # type: ignore[arg-type]
