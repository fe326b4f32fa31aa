"""Drive job: what a worker does for one job: drive, write the trace down, score it."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from interplan_sumo.batch.custom_references import own_expert
from interplan_sumo.batch.jobs import Job
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import DriveAnswer, ModelUse, ScoreRecord, decode
from interplan_sumo.batch.run_folder import is_full, place_folder, trace_place
from interplan_sumo.batch.tasks import Answer, Fault, OpenGroup, Publish, Work
from interplan_sumo.errors import RunFolderError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.metric import plain
from interplan_sumo.metrics.profile import Profile
from interplan_sumo.metrics.score import score
from interplan_sumo.planner import Planner, load_planner
from interplan_sumo.scenario.suite import expert
from interplan_sumo.simulation.episode import EpisodeOptions, drive
from interplan_sumo.world.files import PART
from interplan_sumo.world.trace import Trace


@dataclass(frozen=True, slots=True)
class DriveSettings:
    """What all jobs of a run share."""

    folder: Path
    """The run folder."""
    options: RunOptions
    """With files that are found from anywhere."""
    profile: Profile
    own_scenarios: bool = False
    """Whether they belong to no suite: their experts are driven, then."""
    maps_beside: Path | None = None
    """Where the maps lie that came along with the scenarios, if not where the scenarios say."""
    made: Mapping[str, Callable[[], Planner]] = field(default_factory=dict[str, Callable[[], Planner]])
    """Planners that only this process can build, by name."""


def drive_jobs(settings: DriveSettings) -> OpenGroup:
    """The function that a worker opens with a planner's name; picklable."""
    return partial(_open_planner, settings)


def _open_planner(settings: DriveSettings, name: str, publish: Publish) -> Work:
    planner = settings.made[name]() if name in settings.made else load_planner(name)
    options = EpisodeOptions(vehicle_types=settings.options.traffic, plan_limit_s=settings.options.limits.plan_s)

    def work(job: Job) -> Answer:
        began_s = time.perf_counter()
        scenario = job.scenario
        if settings.maps_beside is not None and scenario.maps_beside is not None:
            scenario = replace(scenario, maps_beside=settings.maps_beside)
        episode = drive(scenario, planner, seed=job.seed, options=options, on_phase=publish)
        times_s: dict[str, float] = dict(episode.times_s)
        fault = None if episode.fault is None else Fault(episode.fault.kind, episode.fault.message)
        report, sheet, trace_hash, place = _own_report(planner), None, None, None
        if episode.trace is not None:
            publish("store")
            stored_s = time.perf_counter()
            trace_hash = episode.trace.hash()
            place = _store(settings.folder, job, episode.trace, trace_hash)
            times_s["storing"] = time.perf_counter() - stored_s
            if fault is None:
                publish("score")
                scored_s = time.perf_counter()
                roads = load_roads(scenario.map, scenario.maps_beside)
                reference = own_expert(scenario, settings.folder) if settings.own_scenarios else expert(scenario)
                sheet = ScoreRecord.of(score(episode.trace, roads, reference, scenario, settings.profile))
                times_s["scoring"] = time.perf_counter() - scored_s
        times_s["total"] = time.perf_counter() - began_s
        answer = DriveAnswer(
            reached_goal=episode.reached_goal,
            trace_hash=trace_hash,
            trace=place,
            sheet=sheet,
            times_s={name: round(seconds, 6) for name, seconds in times_s.items()},
            planner_report=report,
        )
        return msgspec.to_builtins(answer), fault

    return work


def _own_report(planner: Planner) -> dict[str, Any] | None:
    """What a planner says of the drive itself, if it has a `report()`; its faults are no faults of the drive."""
    report = getattr(planner, "report", None)
    if not callable(report):
        return None
    try:
        said = plain(report())
        decode(msgspec.json.encode(said), ModelUse)
        return decode(msgspec.json.encode(said), dict[str, Any]) or None
    except Exception as error:
        return {"error": f"report() gave none: {type(error).__name__}: {error}"}


def _store(folder: Path, job: Job, trace: Trace, trace_hash: str) -> str:
    """Write the trace beside its place and move it there once it is whole; where that is, relative to the folder."""
    place = trace_place(job.key)
    about = {
        "scenario": job.scenario.canonical(),
        "scenario_hash": job.scenario.hash(),
        "planner": job.planner,
        "seed": job.seed,
        "trace_hash": trace_hash,
    }

    def write(fresh: Path) -> None:
        trace.write(fresh)
        (fresh / "scenario.json").write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")

    place_trace(folder, place, write)
    return place


def place_trace(folder: Path, place: str, write: Callable[[Path], None]) -> None:
    """Have a trace written to a fresh folder and move that to its place in the run folder.

    RunFolderError if it cannot be written.
    """
    fresh = None
    try:
        (folder / "traces").mkdir(exist_ok=True)
        fresh = Path(tempfile.mkdtemp(prefix=PART, dir=folder / "traces"))
        write(fresh)
        os.chmod(fresh, 0o777 & ~_umask())
        place_folder(fresh, folder / place)
    except OSError as error:
        if fresh is not None:
            shutil.rmtree(fresh, ignore_errors=True)
        why = "no space left" if is_full(error) else error.strerror or error
        raise RunFolderError(
            f"cannot write the trace {folder / place}: {why}; "
            "what is there is intact: repeat the command when it can be written"
        ) from None


def _umask() -> int:
    """The user's file mode mask; mkdtemp ignores it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
