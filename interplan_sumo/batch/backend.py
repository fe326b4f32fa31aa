"""Backend: who does drives: this process, processes of this machine, or the CPUs of a Ray cluster."""

from __future__ import annotations

import contextlib
from collections.abc import Generator, Sequence

import msgspec

from interplan_sumo.batch.drive_job import DriveSettings, drive_jobs
from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.processes import Workers
from interplan_sumo.batch.records import DriveAnswer, Fault
from interplan_sumo.batch.tasks import Limits, Outcome, Task


def drive_outcomes(
    tasks: Sequence[Task], settings: DriveSettings, workers: Workers, limits: Limits
) -> Generator[Outcome]:
    """How the drives end, in the order in which they do; as `engine.run_tasks`. Traces lie in the settings' folder."""
    if workers.ray is None:
        return run_tasks(tasks, drive_jobs(settings), workers=workers.processes, limits=limits)
    from interplan_sumo.batch.ray_backend import run_on_ray
    from interplan_sumo.batch.remote_jobs import RemoteJobs

    return run_on_ray(tasks, RemoteJobs(settings), address=workers.ray, limits=limits)


def drive_answer(outcome: Outcome) -> tuple[DriveAnswer, Fault | None]:
    """What came of a drive; one whose score is no number between 0 and 1 is a fault of ours."""
    try:
        answer = msgspec.convert(outcome.value, DriveAnswer)
    except msgspec.ValidationError as error:
        return DriveAnswer(), outcome.fault or Fault("harness", f"the worker's answer is none: {error}")
    if answer.sheet is None and outcome.fault is None:
        return answer, Fault("harness", "the worker's answer has no score")
    return answer, outcome.fault


@contextlib.contextmanager
def one_connection(workers: Workers) -> Generator[int]:
    """How many drives are made at a time; inside the block all that go to a Ray cluster share one connection to it.

    InputError if there is no such cluster.
    """
    if workers.ray is None:
        yield workers.processes
        return
    from interplan_sumo.batch.ray_backend import connected

    with connected(workers.ray) as cpus:
        yield cpus
