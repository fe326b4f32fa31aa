"""Score job: what a worker does to score a stored drive again, without simulating."""

from __future__ import annotations

from dataclasses import dataclass, replace

import msgspec
from msgspec import structs

from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.processes import available_cores
from interplan_sumo.batch.records import JobKey, Row, ScoreRecord
from interplan_sumo.batch.run import RunProgress
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.batch.stored_drive import StoredDrives
from interplan_sumo.batch.tasks import Answer, Limits, Publish, Task, Work
from interplan_sumo.batch.versions import SCORING
from interplan_sumo.errors import InputError
from interplan_sumo.metrics.profile import Profile, find_profile
from interplan_sumo.metrics.score import SCORING_VERSION

GROUP = "score"
FEW = 40
"""Drives that are scored sooner than processes start for them."""


class ScoreAnswer(msgspec.Struct, frozen=True):
    """What a worker says of one drive: its score, or what stood in the way."""

    score: ScoreRecord | None = None
    problem: str = ""


def rescore(
    run: StoredRun, profile: str, watch: RunProgress | None = None, *, workers: int | None = 0
) -> tuple[StoredRun, list[str]]:
    """The run under another profile, and what stood in the way of the rows that it now lacks.

    A planner's fault stays a zero. 0 workers work in this process, None takes
    all cores where there are more than a few drives; the scores are the same.
    """
    used = find_profile(profile)
    found: dict[JobKey, Row] = {key: row for key, row in run.rows.items() if row.fault}
    problems: dict[JobKey, str] = {}
    tasks = [Task(key, GROUP, row) for key, row in run.rows.items() if not row.fault]
    many = workers if workers is not None else available_cores() if len(tasks) > FEW else 0
    if watch is not None:
        watch.begin(len(tasks), ())
    jobs = _ScoreJobs(replace(run, rows={}), used)
    for outcome in run_tasks(tasks, jobs, workers=many, limits=Limits()):
        row: Row = outcome.task.payload
        answer = msgspec.convert(outcome.value, ScoreAnswer)
        if answer.score is None:
            why = f": {outcome.fault.message}" if outcome.fault else ""
            where = f"{row.scenario_id}, {row.planner}, seed {row.seed}"
            problems[row.key] = answer.problem or f"{run.path}: the drive of {where}{why}"
            continue
        found[row.key] = row.rescored(answer.score)
        if watch is not None:
            watch.finished(structs.replace(found[row.key], times_s={}))  # those are of the drive
    rows = {key: found[key] for key in run.rows if key in found}
    versions = run.manifest.versions | {SCORING: str(SCORING_VERSION)}
    manifest = structs.replace(run.manifest, profile=used.name, versions=versions)
    return StoredRun(run.path, manifest, rows), [problems[key] for key in run.rows if key in problems]


@dataclass(frozen=True, slots=True)
class _ScoreJobs:
    """Opens the drives of a run for a worker."""

    run: StoredRun
    profile: Profile

    def __call__(self, _group: str, publish: Publish) -> Work:
        drives = StoredDrives(self.run)

        def work(row: Row) -> Answer:
            publish("score")
            try:
                answer = ScoreAnswer(ScoreRecord.of(drives.read(row).sheet(self.profile)))
            except InputError as error:
                answer = ScoreAnswer(problem=str(error))
            return msgspec.to_builtins(answer), None

        return work
