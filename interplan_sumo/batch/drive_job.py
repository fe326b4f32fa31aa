"""Drive job: what a worker does for one job: drive, write the trace down, score it."""

from __future__ import annotations

import json
import os
import shutil
import sys
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
from interplan_sumo.batch.records import DriveAnswer, ModelUse, PlannerRecord, ScoreRecord, decode
from interplan_sumo.batch.run_folder import is_full, place_folder, trace_place
from interplan_sumo.batch.stored_plans import StoredPlans
from interplan_sumo.batch.tasks import Answer, Fault, KilledFromOutsideError, OpenGroup, Publish, Work
from interplan_sumo.errors import PlannerChangedError, PlannerError, RunFolderError, clean_line
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.metric import plain
from interplan_sumo.metrics.profile import Profile
from interplan_sumo.metrics.score import score
from interplan_sumo.planner import Planner, load_planner
from interplan_sumo.planner_process.process import PlannerLimits, PlannerProcess
from interplan_sumo.planner_seat import InProcess, PlannerSeat
from interplan_sumo.planner_source import PlannerSource, changed_files
from interplan_sumo.scenario.suite import expert
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
    plans_of: Path | None = None
    """The run folder whose stored plans are driven again, by nobody who plans."""
    planners: Mapping[str, PlannerRecord] = field(default_factory=dict[str, PlannerRecord])
    """The versions that are to drive, by name; whatever is there drives where none is said."""

    def seat(self, name: str) -> PlannerSeat:
        """The planner, in a process of its own unless it is asked for in this one; InputError if it cannot be built."""
        if name in self.made:
            return InProcess(self.made[name]())
        if name in self.planners:
            _check_version(name, self.planners[name])
        if not self.options.isolated:
            return InProcess(load_planner(name))
        limits = self.options.limits
        return PlannerProcess.of(name, PlannerLimits(limits.plan_s, limits.load_s, limits.memory_bytes))


def drive_jobs(settings: DriveSettings) -> OpenGroup:
    """The function that a worker opens with a planner's name; picklable."""
    return partial(_open_planner, settings)


def _open_planner(settings: DriveSettings, name: str, publish: Publish) -> Work:
    # Only who drives waits for SUMO, half a second: a run whose workers do needs none in its own process.
    from interplan_sumo.simulation.episode import EpisodeOptions, drive

    seat_of = _seats(settings, name)
    options = EpisodeOptions(vehicle_types=settings.options.traffic)

    def work(job: Job) -> Answer:
        began_s = time.perf_counter()
        seat = seat_of(job)
        scenario = job.scenario
        if settings.maps_beside is not None and scenario.maps_beside is not None:
            scenario = replace(scenario, maps_beside=settings.maps_beside)
        episode = drive(scenario, seat, seed=job.seed, options=options, on_phase=publish)
        times_s: dict[str, float] = dict(episode.times_s)
        fault = None if episode.fault is None else Fault(episode.fault.kind, episode.fault.message)
        sheet, trace_hash, place = None, None, None
        publish("plan")
        report, fault = _report(seat, fault)
        if isinstance(seat, PlannerProcess):
            if fault is not None and fault.kind == "planner":
                sys.stderr.write(seat.printed)
            if seat.killed_from_outside:
                raise KilledFromOutsideError("" if fault is None else fault.message)
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


def _seats(settings: DriveSettings, name: str) -> Callable[[Job], PlannerSeat]:
    """Who drives a job: the planner, the same for all, or its plans that a run has stored."""
    folder = settings.plans_of
    if folder is not None:
        return lambda job: StoredPlans.of(folder / trace_place(job.key))
    seat = settings.seat(name)
    return lambda _: seat


def _check_version(name: str, wanted: PlannerRecord) -> None:
    """PlannerChangedError for a planner that was edited during the run, or is another one on this machine."""
    source = PlannerSource.of(name)
    if source.hash != wanted.hash:
        files = changed_files(wanted.files, source.files)
        raise PlannerChangedError(
            f"planner {name!r} is not the one that this run began with: {files[0] if files else 'its options'} "
            "differs; what was driven is kept: repeat the command"
        )


def _report(seat: PlannerSeat, fault: Fault | None) -> tuple[dict[str, Any] | None, Fault | None]:
    """What a planner says of the drive, as it can be stored, and the fault of the drive: the first that there is."""
    try:
        said = seat.report()
    except PlannerError as error:
        return None, fault or Fault("planner", str(error))
    if said is None:
        return None, fault
    try:
        text = msgspec.json.encode(plain(said))
        decode(text, ModelUse)
        return decode(text, dict[str, Any]) or None, fault
    except Exception as error:
        return {"error": clean_line(f"report() gave none: {type(error).__name__}: {error}")}, fault


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
