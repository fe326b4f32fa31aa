"""Kept answers: what workers find of tasks is kept in files, one each, so that a search that was stopped goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.processes import Workers
from interplan_sumo.batch.records import Fault
from interplan_sumo.batch.remote_jobs import Portable
from interplan_sumo.batch.tasks import Limits, OpenGroup, Task
from interplan_sumo.world.files import writing

Kept = TypeVar("Kept", bound=msgspec.Struct)


def kept_answers(
    tasks: Sequence[Task],
    place: Callable[[Task], Path],
    blamed: Callable[[Task, Fault], Kept],
    kind: type[Kept],
    jobs: OpenGroup | Portable,
    workers: Workers,
) -> Iterator[tuple[Any, Kept]]:
    """The payload of each task with its answer, in the order in which they end; one whose file is there is not done.

    `blamed` is the answer that stands for a fault. Portable `jobs` are needed to
    work on a Ray cluster. InputError if the files cannot be written.
    """
    unknown: list[Task] = []
    for task in tasks:
        if (path := place(task)).is_file():
            yield task.payload, msgspec.json.decode(path.read_bytes(), type=kind)
        else:
            unknown.append(task)
    if not unknown:
        return
    if workers.ray is not None:
        from interplan_sumo.batch.ray_backend import run_on_ray

        assert not callable(jobs)
        outcomes = run_on_ray(unknown, jobs, address=workers.ray, limits=Limits())
    else:
        open_group = jobs if callable(jobs) else jobs.open_in(Path())
        outcomes = run_tasks(unknown, open_group, workers=workers.processes, limits=Limits())
    for outcome in outcomes:
        fault = outcome.fault
        found = msgspec.convert(outcome.value, kind) if fault is None else blamed(outcome.task, fault)
        path = place(outcome.task)
        with writing(path, "give another folder as --out"):
            path.parent.mkdir(parents=True, exist_ok=True)
            fresh = path.with_suffix(".part")
            fresh.write_bytes(msgspec.json.encode(found))
            fresh.replace(path)
        yield outcome.task.payload, found
