"""The command `export`: training data from runs and certificates."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from msgspec import structs

from interplan_sumo.cli.completion import run_folders, suite_names
from interplan_sumo.cli.options import DONE, JsonOption, QuietOption, WorkersOption
from interplan_sumo.errors import counted
from interplan_sumo.report.printing import print_json

if TYPE_CHECKING:
    from interplan_sumo.dataset.drives import Drive
    from interplan_sumo.dataset.records import DatasetManifest


def export(
    out: Annotated[Path, typer.Option(help="The dataset's folder: new, empty, or an older dataset, to be replaced.")],
    runs: Annotated[
        list[Path] | None, typer.Argument(help="Run folders.", metavar="RUN", autocompletion=run_folders)
    ] = None,
    certificates: Annotated[
        list[str] | None,
        typer.Option(
            help="NAME==VERSION of a suite whose certified drives to take.", metavar="SUITE", autocompletion=suite_names
        ),
    ] = None,
    recordings: Annotated[
        list[Path] | None, typer.Option(help="A recording, a nuPlan log, or a folder of logs.", metavar="SOURCE")
    ] = None,
    map: Annotated[
        str,
        typer.Option(help="The map of the recordings, as `maps import` made it; for nuPlan the folder of its maps."),
    ] = "",
    every: Annotated[float, typer.Option(help="Seconds between the samples of a drive.")] = 0.5,
    min_score: Annotated[float, typer.Option(help="Only drives with at least this score, 0 to 1.")] = 0.9,
    holdout_maps: Annotated[
        list[str] | None, typer.Option(help="A map for the split `test` only.", metavar="MAP")
    ] = None,
    holdout_seeds: Annotated[
        list[int] | None, typer.Option(help="A seed for the split `val` only.", metavar="SEED")
    ] = None,
    exclude: Annotated[list[str] | None, typer.Option(help="A family to leave out.", metavar="FAMILY")] = None,
    workers: WorkersOption = None,
    quiet: QuietOption = False,
    as_json: JsonOption = False,
) -> int:
    """Write what planners saw, and what came of it, as arrays to train on. Options with a name may be repeated."""
    from interplan_sumo.batch.processes import available_cores
    from interplan_sumo.dataset.drives import DriveSelection
    from interplan_sumo.dataset.export import ExportRequest
    from interplan_sumo.dataset.export import export as export_drives

    request = ExportRequest(
        folder=out,
        runs=tuple(runs or ()),
        certificates=tuple(certificates or ()),
        recordings=tuple(recordings or ()),
        map=map,
        every_s=every,
        choice=DriveSelection(min_score, tuple(exclude or ()), tuple(holdout_maps or ()), tuple(holdout_seeds or ())),
        workers=available_cores() if workers is None else workers,
    )
    began_s = time.perf_counter()
    manifest = export_drives(request, None if quiet else say_drive)
    entry = summary(out, manifest, time.perf_counter() - began_s)
    print_json(entry) if as_json else print_summary(entry)
    return DONE


def say_drive(drive: Drive, done: int, drives: int) -> None:
    print(f"[{done}/{drives}] {drive.scenario.id}, {drive.planner}, seed {drive.seed}", file=sys.stderr, flush=True)


def summary(out: Path, manifest: DatasetManifest, wall_s: float) -> dict[str, Any]:
    return {
        "folder": str(out),
        "hash": manifest.hash,
        **structs.asdict(manifest.counts),
        "left_out": manifest.left_out,
        "bytes": sum(shard.bytes for shard in manifest.shards),
        "wall_s": round(wall_s, 3),
    }


def print_summary(entry: dict[str, Any]) -> None:
    by_split = ", ".join(f"{count} {split}" for split, count in entry["by_split"].items())
    print(
        f"{counted(entry['samples'], 'sample')} ({by_split}) of {counted(entry['drives'], 'drive')}: {entry['folder']}"
    )
    print(f"{entry['bytes'] / 1e6:.1f} MB in {entry['wall_s']:.0f} s, hash {entry['hash'][:16]}")
    if entry["left_out"]:
        print(f"left out: {', '.join(f'{count} {reason}' for reason, count in entry['left_out'].items())}")
