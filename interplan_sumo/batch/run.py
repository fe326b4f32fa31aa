"""Run: planners x scenarios x seeds into one run folder; the same call again goes on where it was stopped."""

from __future__ import annotations

import contextlib
import platform
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from types import FrameType
from typing import Protocol

from interplan_sumo.batch.backend import drive_answer, drive_outcomes
from interplan_sumo.batch.custom_references import keep_certified
from interplan_sumo.batch.drive_job import DriveSettings
from interplan_sumo.batch.in_process import alarm_works
from interplan_sumo.batch.jobs import Job, Overrides, ScenarioSource, chosen, jobs_for, own_maps, split_files
from interplan_sumo.batch.processes import Workers
from interplan_sumo.batch.records import Brief, Manifest, RequestedJobs, Row
from interplan_sumo.batch.run_folder import RunFolder, StoredRun, read_run
from interplan_sumo.batch.tasks import Limits, Outcome, Task
from interplan_sumo.batch.versions import versions
from interplan_sumo.errors import InputError
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.metrics.profile import DEFAULT_PROFILE
from interplan_sumo.metrics.score import SCORING_VERSION
from interplan_sumo.planner import RECOMMENDED, Planner, find_planner
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.network import read_network
from interplan_sumo.simulation.vehicle_types import read_vehicle_types, vehicle_type_file


@dataclass(frozen=True, slots=True)
class RunRequest:
    """What to run, where to, and within which limits."""

    planners: tuple[str, ...]
    folder: Path
    suite: str | None = None
    """`name==version`; None takes the default suite, or the files among `scenarios`."""
    scenarios: tuple[str, ...] = ()
    """Globs over scenario ids, none means all; and files with scenarios of one's own, which take the suite's place."""
    seeds: int = 1
    workers: int = 1
    """Processes of this machine; 0 runs in this one."""
    ray: str | None = None
    """The address of a Ray cluster whose CPUs are the workers instead; `local` starts one on this machine."""
    overrides: Overrides = field(default_factory=Overrides)
    limit: int | None = None
    """At most so many scenarios."""
    limits: Limits = field(default_factory=Limits)
    command: tuple[str, ...] = field(default=())
    """For the manifest."""
    made: Mapping[str, Callable[[], Planner]] = field(default_factory=dict[str, Callable[[], Planner]])
    """Planners that only this process can build, by the name that `planners` has for them; no worker can help, then."""

    @property
    def who(self) -> Workers:
        """Who does the drives."""
        return Workers(self.workers, self.ray)

    @classmethod
    def of(
        cls,
        planners: Sequence[str],
        folder: Path,
        *,
        suite: str | None = None,
        scenarios: Sequence[str] = (),
        seeds: int = 1,
        workers: str | None = None,
        changes: Sequence[str] = (),
        traffic: Path | None = None,
        limit: int | None = None,
        plan_limit_s: float = 10.0,
        job_limit_s: float = 3600.0,
        memory_gb: float = 8.0,
        command: Sequence[str] = (),
        made: Mapping[str, Callable[[], Planner]] | None = None,
    ) -> RunRequest:
        """From what users write; InputError for what cannot be read.

        `workers` as `Workers.parse` has it, `changes` as `Overrides.parse` does;
        no planner is the recommended one, a limit of 0 is none.
        """
        asked = Workers.parse(workers)
        return cls(
            planners=tuple(planners) or (RECOMMENDED,),
            folder=folder,
            suite=suite,
            scenarios=tuple(scenarios),
            seeds=seeds,
            workers=asked.processes,
            ray=asked.ray,
            overrides=Overrides.parse(changes, traffic),
            limit=limit,
            limits=Limits(
                plan_s=plan_limit_s or float("inf"),
                task_s=job_limit_s or float("inf"),
                memory_bytes=round(memory_gb * 2**30) or None,
            ),
            command=tuple(command),
            made=made or {},
        )


def changes(**overrides: str | None) -> list[str]:
    """Overrides by name, None for no change, as `Overrides.parse` reads them."""
    return [f"{name}={value}" for name, value in overrides.items() if value is not None]


class RunProgress(Protocol):
    """Told how a run goes on."""

    def begin(self, jobs: int, done: Iterable[Brief]) -> None:
        """So many jobs in all, of which these are done already; they are read while they are iterated over."""
        ...

    def finished(self, row: Row) -> None:
        """One more job has ended."""
        ...


def run(request: RunRequest, watch: RunProgress | None = None) -> StoredRun:
    """Do every job of the request that its folder does not hold yet.

    Raises InputError for anything that cannot be used, before the first job
    where it can be known. KeyboardInterrupt (Ctrl-C, or SIGTERM) leaves a
    folder that the same request completes.
    """
    if not request.planners:
        raise InputError("no planner given; name one with --planner, such as --planner idm")
    if request.seeds < 1:
        raise InputError(f"seeds is {request.seeds}, expected 1 or more")
    if request.limit is not None and request.limit < 1:
        raise InputError(f"limit is {request.limit}, expected 1 or more")
    if request.workers < 0:
        raise InputError(f"workers is {request.workers}, expected 0 (in this process) or more")
    if request.made and not request.who.in_this_process:
        raise InputError(f"planner {next(iter(request.made))!r} exists in this process only; run with workers=0")
    for spec in request.planners:
        if spec not in request.made:
            find_planner(spec.partition("?")[0])
    files, globs = split_files(request.scenarios)
    source = ScenarioSource.of(request.suite, files)
    scenarios = chosen(source.scenarios, globs, request.limit)
    jobs = jobs_for(scenarios, request.planners, request.seeds, request.overrides)
    if request.overrides.behaviour is not None:
        vehicle_type_file(request.overrides.behaviour)
    check_inputs({job.scenario.id: job.scenario for job in jobs}.values(), request.overrides.vehicle_types)
    overrides = request.overrides.canonical()
    library_versions = versions() | {"scoring": str(SCORING_VERSION)}
    wanted = RequestedJobs(tuple(dict.fromkeys(request.planners)), tuple(s.id for s in scenarios), request.seeds)
    manifest = Manifest(
        suite=source.name,
        suite_hash=source.hash,
        profile=DEFAULT_PROFILE,
        overrides=overrides,
        versions=library_versions,
        command=tuple(request.command),
        created=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        platform=platform.platform(),
        plan_limit_s=request.limits.plan_s if isfinite(request.limits.plan_s) else None,
        requests=(wanted,),
    )
    with RunFolder(request.folder, manifest) as folder:
        left = [job for job in jobs if job.key not in folder.done]
        if watch is not None:
            watch.begin(len(jobs), folder.kept({job.key for job in jobs}))
        settings = DriveSettings(
            folder=request.folder.resolve(),
            profile=DEFAULT_PROFILE,
            vehicle_types=request.overrides.vehicle_types and request.overrides.vehicle_types.resolve(),
            # In this process an alarm keeps the limit: unlike the drive's own it rests while a debugger is at work.
            plan_limit_s=float("inf") if request.who.in_this_process and alarm_works() else request.limits.plan_s,
            own_scenarios=not source.official,
            made=request.made,
        )
        if not source.official:
            folder.keep_scenarios(source.scenarios, own_maps(source.scenarios))
            keep_certified(source.scenarios, files, request.folder)
        if request.overrides.vehicle_types is not None:
            folder.keep_vehicle_types(request.overrides.vehicle_types)
        tasks = [Task(job.key, job.planner, job) for job in left]
        named: dict[str, tuple[str, str]] = {}
        driven = drive_outcomes(tasks, settings, request.who, request.limits)
        with _terminated_like_interrupted(), contextlib.closing(driven) as outcomes:
            for outcome in outcomes:
                scenario = outcome.task.payload.scenario
                if scenario.id not in named:  # milliseconds, which thousands of workers would wait for
                    site = scenario.site(load_roads(scenario.map, scenario.maps_beside))
                    named[scenario.id] = (site, scenario.hash())
                official = source.official and not overrides
                row = _row(outcome, *named[scenario.id], manifest, official=official)
                folder.append(row)
                if watch is not None:
                    watch.finished(row)
    return read_run(request.folder)


def check_inputs(scenarios: Iterable[Scenario], vehicle_types: Path | None) -> None:
    """Read every map, network and vehicle-type file that the scenarios need; InputError before anything is driven."""
    for scenario in scenarios:
        scenario.check(load_roads(scenario.map, scenario.maps_beside))
        read_network(find_map(scenario.map, scenario.maps_beside).network)
        read_vehicle_types(vehicle_types or vehicle_type_file(scenario.traffic.behaviour))


def _row(outcome: Outcome, site: str, scenario_hash: str, manifest: Manifest, *, official: bool) -> Row:
    """A line of results.jsonl."""
    job: Job = outcome.task.payload
    answer, fault = drive_answer(outcome)
    sheet = answer.sheet if fault is None else None
    missing = 0.0 if fault is not None and fault.kind == "planner" else None
    return Row(
        scenario_id=job.scenario.id,
        family=job.scenario.family,
        planner=job.planner,
        seed=job.seed,
        score=missing if sheet is None else sheet.score,
        metrics={} if sheet is None else sheet.metrics,
        gates=() if sheet is None else sheet.gates,
        weights={} if sheet is None else sheet.weights,
        fault=fault,
        official=official,
        overrides=manifest.overrides,
        trace_hash=answer.trace_hash,
        times_s=answer.times_s or {"total": round(outcome.wall_s, 6)},
        versions=manifest.versions,
        reached_goal=answer.reached_goal,
        site=site,
        scenario_hash=scenario_hash,
        trace=answer.trace,
        planner_report=answer.planner_report,
        traceback=outcome.value.get("traceback", ""),
        printed=outcome.printed,
    )


@contextlib.contextmanager
def _terminated_like_interrupted() -> Generator[None]:
    """SIGTERM (a batch system's polite end) inside the block does what Ctrl-C does."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(_signal: int, frame: FrameType | None) -> None:
        answer = signal.getsignal(signal.SIGINT)
        if callable(answer):
            answer(signal.SIGINT, frame)  # what tells Ctrl-C from a planner's own KeyboardInterrupt must see this, too
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
