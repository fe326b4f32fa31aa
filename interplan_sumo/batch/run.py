"""Run: planners x scenarios x seeds into one run folder; the same call again goes on where it was stopped."""

from __future__ import annotations

import contextlib
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from interplan_sumo.batch.backend import drive_answer, drive_outcomes
from interplan_sumo.batch.briefs import Brief
from interplan_sumo.batch.custom_references import keep_certified
from interplan_sumo.batch.drive_job import DriveSettings
from interplan_sumo.batch.jobs import Job, Selection, interleaved, jobs_for, own_maps
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import JobKey, Manifest, PlannerRecord, RequestedJobs, Row, Shard
from interplan_sumo.batch.run_folder import RunFolder, StoredRun, read_run
from interplan_sumo.batch.tasks import Outcome, Task
from interplan_sumo.batch.versions import scored_versions
from interplan_sumo.errors import InputError, check_names, clean_line, counted
from interplan_sumo.interruption import terminated_like_interrupted
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.metrics.profile import DEFAULT_PROFILE, find_profile
from interplan_sumo.planner import RECOMMENDED, Planner, find_planner
from interplan_sumo.planner_process.process import PlannerProcess
from interplan_sumo.planner_source import PlannerSource
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.network import read_network
from interplan_sumo.simulation.traffic import TRAFFIC_VERSION
from interplan_sumo.simulation.vehicle_types import read_vehicle_types, vehicle_type_file


class RunProgress(Protocol):
    """Told how a run goes on."""

    def begin(self, jobs: int, done: Iterable[tuple[JobKey, Brief]]) -> None:
        """So many jobs in all, of which these are done already; they are read while they are iterated over."""
        ...

    def finished(self, row: Row) -> None:
        """One more job has ended."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class _Plan:
    """A run that can begin."""

    folder: Path
    """As it was given, for messages."""
    selection: Selection
    jobs: Sequence[Job]
    manifest: Manifest
    settings: DriveSettings


def run(
    options: RunOptions,
    watch: RunProgress | None = None,
    *,
    made: Mapping[str, Callable[[], Planner]] | None = None,
    command: Sequence[str] = (),
) -> StoredRun:
    """Do every job that is asked for and that the folder does not hold yet.

    `made` builds planners that only this process knows, by the names that the
    options have for them; no worker can help, then. `command` is for the
    manifest. Raises InputError for anything that cannot be used, before the
    first job where it can be known. KeyboardInterrupt (Ctrl-C, or SIGTERM)
    leaves a folder that the same options complete.
    """
    plan = _planned(options, made or {}, command)
    for spec in plan.manifest.planners:
        if ":" in spec or "?" in spec or spec in options.redo:
            _try_to_build(spec, plan.settings)
    with RunFolder(plan.folder, plan.manifest, options.redo) as folder:
        left = interleaved([job for job in plan.jobs if job.key not in folder.done])
        if watch is not None:
            watch.begin(len(plan.jobs), folder.kept({job.key for job in plan.jobs}))
        _keep_inputs(folder, plan, options)
        tasks = [Task(job.key, job.planner, job) for job in left]
        driven = drive_outcomes(tasks, plan.settings, options.who, options.limits)
        with terminated_like_interrupted(), contextlib.closing(driven) as outcomes:
            for row in _rows(outcomes, plan):
                kept = folder.append(row)
                if watch is not None:
                    watch.finished(kept)
    return read_run(plan.folder)


def _planned(options: RunOptions, made: Mapping[str, Callable[[], Planner]], command: Sequence[str]) -> _Plan:
    """What a run will do; InputError for what cannot be used, as far as that is known before a planner is built."""
    if options.out is None:
        raise InputError("no run folder given; name one with --out")
    if made and not options.who.in_this_process:
        raise InputError(f"planner {next(iter(made))!r} exists in this process only; run with workers=0")
    planners = tuple(dict.fromkeys(options.planners)) or (RECOMMENDED,)
    for spec in planners:
        if spec not in made:
            find_planner(spec)
    profile = find_profile(options.profile or DEFAULT_PROFILE)
    selection = Selection.of(options)
    source, scenarios = selection.source, selection.scenarios
    shard = None if options.shard is None else Shard.parse(options.shard)
    every = jobs_for(scenarios, planners, options.seeds, options.overrides)
    jobs = every if shard is None else shard.of(every)
    if not jobs:
        raise InputError(
            f"--shard {options.shard} has none of the {counted(len(every), 'drive')}; split into fewer shards"
        )
    if options.behaviour is not None:
        vehicle_type_file(options.behaviour)
    check_inputs({job.scenario.id: job.scenario for job in jobs}.values(), options.traffic)
    sources = {spec: PlannerSource.of(spec) for spec in planners if spec not in made}
    check_names("planner of this run to redo", options.redo, planners)
    manifest = Manifest(
        suite=source.name,
        suite_hash=source.hash,
        profile=profile.name,
        overrides=options.overrides.canonical(),
        versions=scored_versions(),
        traffic_version=TRAFFIC_VERSION,
        command=tuple(clean_line(word) for word in command),
        created=time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        platform=platform.platform(),
        plan_limit_s=options.plan_limit_s or None,
        requests=(RequestedJobs(planners, tuple(s.id for s in scenarios), options.seeds),),
        shard=shard,
        planners={spec: PlannerRecord(source.hash, source.files) for spec, source in sources.items()},
    )
    settings = DriveSettings(
        folder=options.out.resolve(),
        options=here(options),
        profile=profile,
        own_scenarios=not source.official,
        made=made,
        planners=manifest.planners,
    )
    return _Plan(options.out, selection, jobs, manifest, settings)


def _keep_inputs(folder: RunFolder, plan: _Plan, options: RunOptions) -> None:
    """Put beside the results what they cannot be had again without."""
    source = plan.selection.source
    if not source.official:
        folder.keep_scenarios(source.scenarios, own_maps(source.scenarios))
        keep_certified(source.scenarios, plan.selection.files, folder.path)
    folder.keep_profile(plan.settings.profile)
    if options.traffic is not None:
        folder.keep_vehicle_types(options.traffic)


def _rows(outcomes: Iterable[Outcome], plan: _Plan) -> Iterator[Row]:
    """A row of each drive that has ended."""
    official = plan.selection.source.official and not plan.manifest.overrides
    named: dict[str, tuple[str, str]] = {}
    for outcome in outcomes:
        scenario = outcome.task.payload.scenario
        if scenario.id not in named:  # milliseconds, which thousands of workers would wait for
            site = scenario.site(load_roads(scenario.map, scenario.maps_beside))
            named[scenario.id] = (site, scenario.hash())
        isolated = plan.settings.options.isolated
        yield row_of_outcome(outcome, *named[scenario.id], plan.manifest, official=official, isolated=isolated)


def _try_to_build(spec: str, settings: DriveSettings) -> None:
    """InputError for a planner that cannot be built, before there is a folder or anything is taken from it."""
    seat = settings.seat(spec)
    if isinstance(seat, PlannerProcess):
        seat.close()


def here(options: RunOptions) -> RunOptions:
    """As workers have them: with files that are found from anywhere."""
    return replace(options, traffic=options.traffic and options.traffic.resolve())


def check_inputs(scenarios: Iterable[Scenario], vehicle_types: Path | None) -> None:
    """Read every map, network and vehicle-type file that the scenarios need; InputError before anything is driven."""
    for scenario in scenarios:
        scenario.check(load_roads(scenario.map, scenario.maps_beside))
        read_network(find_map(scenario.map, scenario.maps_beside).network)
        read_vehicle_types(vehicle_types or vehicle_type_file(scenario.traffic.behaviour))


def row_of_outcome(
    outcome: Outcome, site: str, scenario_hash: str, manifest: Manifest, *, official: bool, isolated: bool
) -> Row:
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
        done=None if sheet is None else sheet.done,
        unsafe=None if sheet is None else sheet.unsafe,
        beside={} if sheet is None else sheet.beside,
        fault=fault,
        official=official and outcome.tries == 1,
        overrides=manifest.overrides,
        perception=job.scenario.perception,
        trace_hash=answer.trace_hash,
        times_s=answer.times_s or {"total": round(outcome.wall_s, 6)},
        versions=manifest.versions,
        traffic_version=manifest.traffic_version,
        reached_goal=answer.reached_goal,
        isolated=isolated,
        planner_hash=manifest.planners[job.planner].hash if job.planner in manifest.planners else None,
        site=site,
        scenario_hash=scenario_hash,
        trace=answer.trace,
        planner_report=answer.planner_report,
        traceback=outcome.traceback,
        printed=outcome.printed if fault else "",
        tries=outcome.tries,
    )
