"""Kept answers: what workers find of tasks is kept in files, one each, so that a search that was stopped goes on.

A machine that had no time or memory left says nothing of a task: what was its fault is not kept, and tried again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.processes import Workers
from interplan_sumo.batch.records import Fault, FaultClass
from interplan_sumo.batch.remote_jobs import Portable
from interplan_sumo.batch.tasks import Limits, OpenGroup, Task
from interplan_sumo.world.files import replacing, writing

Kept = TypeVar("Kept", bound=msgspec.Struct)
OF_THE_MACHINE: Final[frozenset[FaultClass]] = frozenset({"timeout", "harness"})


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
        if (answer := _known(place(task), kind)) is not None:
            yield task.payload, answer
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
        if fault is None or fault.kind not in OF_THE_MACHINE:
            path = place(outcome.task)
            with writing(path, "give another folder as --out"):
                path.parent.mkdir(parents=True, exist_ok=True)
                with replacing(path) as fresh:
                    fresh.write_bytes(msgspec.json.encode(found))
        yield outcome.task.payload, found


def _known(path: Path, kind: type[Kept]) -> Kept | None:
    """What a file has kept; None where there is none, or one that is damaged."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=kind)
    except (FileNotFoundError, msgspec.DecodeError):
        return None
