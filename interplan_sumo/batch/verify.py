"""Verify: drive rows of a run again, as its folder records them, and hold them against what is stored.

What is driven are the plans that the run stored, so no planner is loaded and none can have a say; or, where that is
asked for, the planners themselves, which shows whether they plan the same again.
"""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from msgspec import structs

from interplan_sumo.batch import custom_references
from interplan_sumo.batch.backend import drive_answer, drive_outcomes
from interplan_sumo.batch.drive_job import DriveSettings
from interplan_sumo.batch.jobs import Job, matching
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.overrides import Overrides
from interplan_sumo.batch.records import DriveAnswer, Fault, JobKey, Row
from interplan_sumo.batch.row_check import Remade, RowCheck, Verdict, compared
from interplan_sumo.batch.run import RunProgress, here
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.batch.stored_drive import own_scenarios
from interplan_sumo.batch.tasks import Task
from interplan_sumo.batch.trace_difference import difference
from interplan_sumo.batch.traffic_files import recorded_vehicle_types
from interplan_sumo.batch.verified import Means, VerifiedRow, keep_verified
from interplan_sumo.errors import InputError, RunFolderError, UnknownNameError, check_names
from interplan_sumo.metrics.profile import stored_profile
from interplan_sumo.planner import find_planner
from interplan_sumo.scenario.files import MAPS
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.world.trace import Trace, read_plans


@dataclass(frozen=True, slots=True)
class RowSample:
    """Which rows of a run to drive again."""

    size: int | None = 10
    """So many, drawn at random; None for all."""
    seed: int = 0
    """Of the draw. A larger sample of the same seed holds the smaller one."""
    scenarios: tuple[str, ...] = ()
    """Only ids that match one of these globs; none means all."""
    planners: tuple[str, ...] = ()
    """Only these, as the run was asked for them; none means all."""


@dataclass(frozen=True, slots=True)
class Verification:
    """What `verify` found."""

    run: StoredRun
    candidates: int
    """Rows with a score that the sample was drawn from."""
    checks: tuple[RowCheck, ...]
    """By scenario, planner and seed."""
    means: Means

    def count(self, verdict: Verdict) -> int:
        return sum(check.verdict == verdict for check in self.checks)

    @property
    def left_out(self) -> int:
        """Drives that were asked for and have no score: there is nothing to compare."""
        return len(self.run.missing)


def verify(
    run: StoredRun,
    sample: RowSample,
    options: RunOptions | None = None,
    watch: RunProgress | None = None,
    *,
    with_planner: bool = False,
) -> Verification:
    """Drive a sample of the rows again with their own scenario, seed and overrides, and compare.

    Their stored plans are driven; `with_planner` has their planners plan again
    instead. Of the options count who does it, its limits but for that of
    plan(), and `traffic`: the file that the run was given, where it is no
    longer found. Nothing is written to the run folder; `keep_verified` does
    that. Raises InputError for a planner, file or name that is not there any
    more, or for an empty run.
    """
    keys = _candidates(run, sample)
    drawn = _drawn(keys, sample)
    for planner in dict.fromkeys(key[1] for key in drawn) if with_planner else ():
        find_planner(planner)
    held, options = run.manifest.overrides, options or RunOptions()
    own = own_scenarios(run)
    options = replace(
        options,
        density=held.density,
        behaviour=held.behaviour,
        perception=held.perception,
        traffic=recorded_vehicle_types(run.path, run.manifest, options.traffic),
        plan_limit_s=run.manifest.plan_limit_s or 0.0,
    )
    overrides = options.overrides
    jobs: list[Job] = []
    checks: list[RowCheck] = []
    for key in drawn:
        row = run.rows[key]
        scenario, problem = _scenario(row, own, overrides)
        without = None if with_planner else _without_plans(run, row)
        if scenario is None:
            checks.append(RowCheck(row, "unverifiable", problem))
        elif without is not None:
            checks.append(without)
        else:
            jobs.append(Job(scenario, key[1], key[2]))
    if watch is not None:
        watch.begin(len(jobs), ())
    checks += _driven_again(run, jobs, options, bool(own), watch, with_planner)
    checks.sort(key=lambda check: check.row.key)
    return Verification(run, len(keys), tuple(checks), "planner" if with_planner else "plans")


def note_verified(found: Verification) -> None:
    """Keep in the run folder which of its rows came again; RunFolderError if it cannot be written."""
    equal = [VerifiedRow.of(check.row, found.means) for check in found.checks if check.verdict == "equal"]
    keep_verified(found.run.path, equal, [check.row.key for check in found.checks if check.verdict == "differs"])


def _candidates(run: StoredRun, sample: RowSample) -> list[JobKey]:
    """The rows with a score that the sample may hold, in an order that does not depend on the workers'."""
    scored = sorted(key for key, brief in run.briefs.items() if brief.score is not None)
    if not scored:
        raise RunFolderError(f"{run.path} holds no drive with a score, so there is nothing to verify; run it first")
    ids, planners = ({str(key[at]) for key in scored} for at in (0, 1))
    wanted = matching(ids, sample.scenarios, f"scenario in {run.path}")
    check_names(f"planner in {run.path}", sample.planners, planners)
    return [key for key in scored if key[0] in wanted and (not sample.planners or key[1] in sample.planners)]


def _drawn(keys: Sequence[JobKey], sample: RowSample) -> list[JobKey]:
    if sample.size is not None and sample.size < 1:
        raise InputError(f"sample is {sample.size}, expected 1 or more")
    order = np.random.default_rng(sample.seed).permutation(len(keys))
    return sorted(keys[i] for i in order[: sample.size].tolist())


def _scenario(row: Row, own: dict[str, Scenario], overrides: Overrides) -> tuple[Scenario | None, str]:
    """The scenario as it was driven, or why it is not to be had."""
    try:
        found = own.get(row.scenario_id) or find_scenario(row.scenario_id)
    except UnknownNameError as error:
        return None, str(error)
    scenario = overrides.applied(found)
    if scenario.hash() != row.scenario_hash:
        return None, "the scenario has changed since it was driven; verify with the version that drove it"
    return scenario, ""


def _without_plans(run: StoredRun, row: Row) -> RowCheck | None:
    """The verdict on a row whose plans cannot be driven; None where they can."""
    if row.trace is None and row.fault is not None:
        return RowCheck(row, "equal", f"a {row.fault.kind} fault before the first step: there is nothing to drive")
    folder = run.path / (row.trace or "?")
    if not folder.is_dir():
        why = "its plans are not in the run folder; --with-planner drives the planner again"
        return RowCheck(row, "unverifiable", why)
    try:
        read_plans(folder)
    except InputError as error:
        return RowCheck(row, "differs", str(error))
    return None


def _driven_again(
    run: StoredRun,
    jobs: Sequence[Job],
    options: RunOptions,
    own: bool,
    watch: RunProgress | None,
    with_planner: bool,
) -> list[RowCheck]:
    """Do the jobs in a folder of their own, with the experts of the run, and compare each as it ends."""
    checks: list[RowCheck] = []
    with tempfile.TemporaryDirectory(prefix="interplan-sumo-verify-") as place:
        scratch = Path(place)
        if (run.path / custom_references.FOLDER).is_dir():
            shutil.copytree(run.path / custom_references.FOLDER, scratch / custom_references.FOLDER)
        if options.traffic is not None:  # SUMO reads no file with a comma in its path, which folders of sweeps have
            options = replace(options, traffic=Path(shutil.copy(options.traffic, scratch / options.traffic.name)))
        settings = DriveSettings(
            scratch,
            here(options),
            stored_profile(run.manifest.profile, run.path),
            own,
            run.path / MAPS if own else None,
            plans_of=None if with_planner else run.path,
        )
        tasks = [Task(job.key, job.planner, job) for job in jobs]
        with contextlib.closing(drive_outcomes(tasks, settings, options.who, options.limits)) as outcomes:
            for outcome in outcomes:
                row = run.rows[outcome.task.payload.key]
                answer, fault = drive_answer(outcome)
                checks.append(_check(run, row, answer, fault, scratch, with_planner))
                if watch is not None:
                    watch.finished(_made_again(row, answer, fault))
                if answer.trace is not None:
                    shutil.rmtree(scratch / answer.trace, ignore_errors=True)
    return checks


def _made_again(row: Row, answer: DriveAnswer, fault: Fault | None) -> Row:
    """The row as the drive made again would have it, for a watch."""
    score = None if answer.sheet is None or fault is not None else answer.sheet.score
    return structs.replace(row, score=score, fault=fault, times_s=answer.times_s)


def _check(
    run: StoredRun, row: Row, answer: DriveAnswer, fault: Fault | None, scratch: Path, with_planner: bool
) -> RowCheck:
    """Hold a drive made again against its row and its stored trace."""
    check = compared(row, Remade.of(answer, fault), with_planner=with_planner)
    if row.fault or fault or check.score is None:
        return check
    stored, problem = _stored_trace(run, row)
    if check.trace_hash != row.trace_hash:
        if stored is None or answer.trace is None:
            return replace(check, reason=problem)
        parted = difference(stored, Trace.read(scratch / answer.trace))
        said = "" if parted else "the drive repeats its trace file exactly: the hash in results.jsonl was changed"
        return replace(check, reason=said, difference=parted)
    if stored is not None and stored.hash() != row.trace_hash:
        return replace(
            check, verdict="differs", reason="the drive repeats its hash, its trace file does not: it was changed"
        )
    if check.verdict == "equal" and stored is None:
        missing = not (run.path / (row.trace or "?")).is_dir()
        return replace(check, verdict="equal" if missing else "differs", reason=problem)
    return check


def _stored_trace(run: StoredRun, row: Row) -> tuple[Trace | None, str]:
    """The trace file of a row, or why there is none."""
    folder = run.path / (row.trace or "?")
    if not folder.is_dir():
        return None, "no trace file: only the hashes were compared"
    try:
        return Trace.read(folder), ""
    except InputError as error:
        return None, str(error)
