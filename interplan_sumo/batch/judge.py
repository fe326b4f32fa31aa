"""Judge: a bundle is driven again from its plans and scored anew, and a run folder made of what came of it.

No planner is loaded, nothing that the bundle says is believed, and all scores are those that were made here.
"""

from __future__ import annotations

import contextlib
import platform
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from msgspec import structs

from interplan_sumo.batch.backend import drive_outcomes
from interplan_sumo.batch.bundle import Bundle, open_bundle
from interplan_sumo.batch.custom_references import keep_certified
from interplan_sumo.batch.drive_job import DriveSettings
from interplan_sumo.batch.jobs import Job, ScenarioSource, jobs_for, own_maps, scenario_file
from interplan_sumo.batch.judged import Judged, OtherDrive, keep_judged
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import MOST_SECONDS, AppliedOverrides, JobKey, Manifest, PlannerRecord, Row
from interplan_sumo.batch.row_check import Remade, RowCheck, compared
from interplan_sumo.batch.run import RunProgress, check_inputs, here, row_of_outcome
from interplan_sumo.batch.run_folder import RunFolder, StoredRun, read_run, slug, trace_place
from interplan_sumo.batch.tasks import Outcome, Task
from interplan_sumo.batch.verified import VerifiedRow, keep_verified
from interplan_sumo.batch.verify import Verification
from interplan_sumo.batch.versions import scored_versions
from interplan_sumo.errors import InputError, clean_line
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.profile import find_profile
from interplan_sumo.simulation.traffic import TRAFFIC_VERSION
from interplan_sumo.world.trace import write_plans


@dataclass(frozen=True, slots=True)
class Judgement:
    """What came of a bundle."""

    judged: Judged
    found: Verification
    """Of the folder that was made; the rows of its checks are what was claimed."""


def judge(path: Path, out: Path, options: RunOptions | None = None, watch: RunProgress | None = None) -> Judgement:
    """Judge a bundle into a folder of its own below `out`; the same call goes on where it was stopped.

    Of the options count who does it, its limits but for that of plan(), and
    `scenarios`: the file of a suite that does not ship, as of a hidden split.
    InputError, before anything is driven, for what is no bundle, or one of
    other scenarios or another traffic than those that are here.
    """
    options = options or RunOptions()
    files = tuple(scenario_file(each) or each for each in options.scenarios)
    options = replace(options, plan_limit_s=0.0, scenarios=files)
    with open_bundle(path) as bundle:
        source = ScenarioSource.of(None if options.scenarios else bundle.manifest.suite, options.scenarios)
        jobs = _checked_jobs(bundle, source)
        check_inputs(source.scenarios, None)
        place = out / slug(f"{bundle.card.name} {bundle.sha256[:12]}")
        stored = _driven(bundle, source, jobs, replace(options, out=place), watch)
        return _judgement(bundle, stored)


def _checked_jobs(bundle: Bundle, source: ScenarioSource) -> dict[JobKey, Job]:
    """The drives of the whole suite; InputError if they are not those of the bundle, or cannot be judged here."""
    path, manifest, name = bundle.path, bundle.manifest, bundle.card.name
    if source.hash != manifest.suite_hash:
        raise InputError(
            f"{path} was driven on other scenarios than those of {source.name} here; judge it with the version that "
            f"drove it{'' if source.official else ', or give another file as --scenarios'}"
        )
    if manifest.overrides or "@" in manifest.profile:
        raise InputError(f"{path} is no result: it was driven with changes, or scored by a profile that does not ship")
    if manifest.traffic_version != TRAFFIC_VERSION:
        raise InputError(
            f"{path} was driven in traffic {manifest.traffic_version}, this version has {TRAFFIC_VERSION}; "
            "judge it with the version that drove it"
        )
    find_profile(manifest.profile)
    seeds = manifest.requests[0].seeds
    jobs = {job.key: job for job in jobs_for(source.scenarios, [name], seeds)}
    if not name or jobs.keys() != bundle.rows.keys():
        raise InputError(f"{path} does not hold all drives of {source.name} by the planner that its card names")
    for key, row in bundle.rows.items():
        if row.scenario_hash != jobs[key].scenario.hash():
            raise InputError(f"{path}: scenario {key[0]} was another one when it was driven; drive the suite as it is")
        if row.trace is not None:
            bundle.plans(key)
    return jobs


def _driven(
    bundle: Bundle, source: ScenarioSource, jobs: Mapping[JobKey, Job], options: RunOptions, watch: RunProgress | None
) -> StoredRun:
    """The run folder of what the plans make here."""
    place, claimed = options.out or Path(), bundle.manifest
    profile, name = find_profile(claimed.profile), bundle.card.name
    told = next(iter(claimed.planners.values()), None)
    manifest = Manifest(
        suite=source.name,
        suite_hash=source.hash,
        profile=profile.name,
        overrides=AppliedOverrides(),
        versions=scored_versions(),
        traffic_version=TRAFFIC_VERSION,
        command=(),
        created=_now(),
        platform=platform.platform(),
        plan_limit_s=None,
        requests=claimed.requests,
        planners={} if told is None else {name: PlannerRecord(clean_line(told.hash, 64), {})},
    )
    with RunFolder(place, manifest) as folder, tempfile.TemporaryDirectory(prefix="interplan-sumo-judge-") as scratch:
        if not source.official:
            folder.keep_scenarios(source.scenarios, own_maps(source.scenarios))
            keep_certified(source.scenarios, options.scenarios, place)
        left = [job for key, job in jobs.items() if key not in folder.done]
        if watch is not None:
            watch.begin(len(jobs), folder.kept(set(jobs)))
        for job in left:
            row = bundle.rows[job.key]
            if row.trace is not None:
                write_plans(bundle.plans(job.key), Path(scratch) / trace_place(job.key))
        settings = DriveSettings(
            place.resolve(), here(options), profile, own_scenarios=not source.official, plans_of=Path(scratch)
        )
        for row in _rows(bundle, left, settings, manifest, official=source.official):
            row = folder.append(row)
            if watch is not None:
                watch.finished(row)
    return read_run(place)


def _rows(
    bundle: Bundle, left: Sequence[Job], settings: DriveSettings, manifest: Manifest, *, official: bool
) -> Iterator[Row]:
    """What comes of the drives, as they end; one that failed before its first plan is not driven."""
    named: dict[str, str] = {}

    def row(outcome: Outcome) -> Row:
        scenario = outcome.task.payload.scenario
        if scenario.id not in named:
            named[scenario.id] = scenario.site(load_roads(scenario.map, scenario.maps_beside))
        claimed = bundle.rows[outcome.task.payload.key]
        outcome = replace(outcome, tries=claimed.tries)  # those of its planner, not of who drives its plans
        made = row_of_outcome(outcome, named[scenario.id], scenario.hash(), manifest, official=official, isolated=True)
        ended = made.fault is not None and made.fault.kind == "planner" and claimed.fault is not None
        return structs.replace(made, fault=claimed.fault) if ended else made

    tasks = [Task(job.key, job.planner, job) for job in left]
    for task in tasks:
        claimed = bundle.rows[task.payload.key]
        if claimed.trace is None:
            yield row(Outcome(task, {}, claimed.fault, 0.0))
    driven = [task for task in tasks if bundle.rows[task.payload.key].trace is not None]
    options = settings.options
    with contextlib.closing(drive_outcomes(driven, settings, options.who, options.limits)) as outcomes:
        for outcome in outcomes:
            yield row(outcome)


def _judgement(bundle: Bundle, stored: StoredRun) -> Judgement:
    """Hold what was claimed against what was made, and note it in the folder."""
    made = {key: stored.rows[key] for key in stored.keys}
    checks = {
        key: compared(bundle.rows[key], Remade(row.trace_hash, row.score, row.metrics, row.fault))
        for key, row in made.items()
    }
    equal = [key for key, check in checks.items() if check.verdict == "equal"]
    others = [key for key in checks if key not in set(equal)]
    keep_verified(stored.path, (VerifiedRow.of(made[key], "plans") for key in equal), others)
    claimed = bundle.manifest
    versions_then = {name: pair for check in checks.values() for name, pair in check.changed_versions.items()}
    judged = Judged(
        card=bundle.card,
        sha256=bundle.sha256,
        judged=_now(),
        driven=clean_line(claimed.created, 40),
        platform=clean_line(claimed.platform, 100),
        planner_hash=next((clean_line(each.hash, 64) for each in claimed.planners.values()), None),
        plan_s=_plan_s(bundle),
        drives=len(checks),
        equal=len(equal),
        others=tuple(_other(checks[key]) for key in others),
        changed_versions=versions_then,
    )
    keep_judged(judged, stored.path)
    found = Verification(stored, len(checks), tuple(checks[key] for key in sorted(checks)), "plans")
    return Judgement(judged, found)


def _other(check: RowCheck) -> OtherDrive:
    return OtherDrive(check.row.scenario_id, check.row.seed, check.reason, check.row.score, check.score)


def _plan_s(bundle: Bundle) -> float | None:
    """What a plan took on average, as the bundle says; None where it does not."""
    timed = [
        (row.times_s["planner"], key) for key, row in bundle.rows.items() if row.trace and "planner" in row.times_s
    ]
    plans = sum(len(bundle.plans(key)) for _, key in timed)
    spent_s = sum(spent_s for spent_s, _ in timed)
    return spent_s / plans if plans and spent_s / plans <= MOST_SECONDS else None


def _now() -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
