"""Engine: does many tasks over workers that may hang, crash or be killed, and accounts for every one.

It knows nothing of driving. A task belongs to a group (here: a planner); a
worker serves one group, so that planners never share a process. A worker has
at most one task in hand, so a death costs one task and blocks nobody.
"""

from __future__ import annotations

import tempfile
import time
from collections import deque
from collections.abc import Generator, Hashable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from interplan_sumo.batch.in_process import run_in_process
from interplan_sumo.batch.processes import adopted_orphans
from interplan_sumo.batch.tasks import PLANNER_PHASES, TRAFFIC_RETRIES, Fault, Limits, OpenGroup, Outcome, Task
from interplan_sumo.batch.worker_pool import Ending, ProcessPool, Report, Worker, WorkerPool
from interplan_sumo.errors import InputError, PlannerLoadError
from interplan_sumo.planner_process.deaths import death, killed_from_outside

OUTSIDE_KILLS_FORGIVEN = 2
"""A task whose worker somebody else killed is done again this often; then it is taken to be the task's own doing."""
TURN: Final = 20
"""After so many tasks a worker makes room for a group that has none, so that all are heard of early."""


def run_tasks(tasks: Sequence[Task], open_group: OpenGroup, *, workers: int, limits: Limits) -> Generator[Outcome]:
    """Yield one outcome per task, in the order in which they end.

    `workers` 0 does them in this process. `open_group` and the payloads must
    be picklable. Raises InputError as soon as a group cannot be opened or a
    task raises one: no further task is begun. Closing the iterator, or an
    exception thrown into the caller, ends all workers.
    """
    if not tasks:
        return
    if workers == 0:
        yield from run_in_process(tasks, open_group)
        return
    with tempfile.TemporaryDirectory(prefix="interplan-sumo-") as folder, adopted_orphans():
        pool = ProcessPool(open_group, limits, Path(folder))
        try:
            yield from run_with(pool, tasks, workers)
            pool.close()
        finally:
            pool.stop_all()


def run_with(pool: WorkerPool, tasks: Sequence[Task], workers: int) -> Generator[Outcome]:
    """Have a pool of up to `workers` do the tasks; outcomes and errors as in `run_tasks`.

    The pool outlives it: who is still there when it ends is the caller's to stop.
    """
    state = _Bookkeeping()
    for task in tasks:
        state.waiting.setdefault(task.group, deque()).append(task)
    _try_groups(list(state.waiting), pool, workers, state.opened)
    while any(state.waiting.values()) or any(w.task for w in pool.workers):
        _staff(state.waiting, pool, workers)
        for report in pool.reports():
            outcome = _settle(report, pool, state)
            if outcome is not None:
                yield outcome


@dataclass(slots=True)
class _Bookkeeping:
    """What is still to be done and what went wrong on the way."""

    waiting: dict[str, deque[Task]] = field(default_factory=dict)
    """By group."""
    outside_kills: dict[Hashable, int] = field(default_factory=dict)
    """By the key of the task."""
    lost: dict[Hashable, int] = field(default_factory=dict)
    """With their machine."""
    traffic_faults: dict[Hashable, int] = field(default_factory=dict)
    failed_openings: dict[str, int] = field(default_factory=dict)
    """By group, in a row."""
    opened: set[str] = field(default_factory=set[str])
    """Groups that a worker has opened."""

    def tries(self, task: Task) -> int:
        """How often a task that ends now was begun, as far as processes were killed."""
        return 1 + min(self.outside_kills.get(task.key, 0), OUTSIDE_KILLS_FORGIVEN)

    def again(self, task: Task, counted: dict[Hashable, int], most: int) -> bool:
        """Put a task back in front, unless that was done `most` times for this reason; whether it was."""
        counted[task.key] = counted.get(task.key, 0) + 1
        if counted[task.key] > most:
            return False
        self.waiting[task.group].appendleft(task)
        return True


def _settle(report: Report, pool: WorkerPool, state: _Bookkeeping) -> Outcome | None:
    """Book what was heard from a worker; the outcome of its task, if that ended for good."""
    worker, answer = report.worker, report.answer
    if answer.ready:
        worker.ready, worker.task_since_s = True, time.monotonic()
        state.failed_openings.pop(worker.group, None)
        state.opened.add(worker.group)
        return None
    task, worker.task = worker.task, None
    if task is None and not worker.ready:
        return _not_opened(report, pool, state)
    if answer.input_error is not None:
        raise InputError(answer.input_error)
    if task is None:  # it died while idle
        return None
    wall_s = time.monotonic() - worker.task_since_s
    fault = answer.fault
    if report.ending is not None:
        counted = state.lost if report.ending.lost is not None else state.outside_kills
        if _from_outside(report.ending) and state.again(task, counted, OUTSIDE_KILLS_FORGIVEN):
            return None
        fault = _blame(report.ending)
    if fault is None:
        return Outcome(task, answer.value, None, wall_s, printed=report.printed, tries=state.tries(task))
    if worker in pool.workers:
        pool.stop(worker)  # after a fault nobody knows what state a process is in
    if answer.killed_from_outside and state.again(task, state.outside_kills, OUTSIDE_KILLS_FORGIVEN):
        return None
    if fault.kind == "traffic" and state.again(task, state.traffic_faults, TRAFFIC_RETRIES):
        return None
    return Outcome(task, answer.value, fault, wall_s, answer.traceback, report.printed, state.tries(task))


def _not_opened(report: Report, pool: WorkerPool, state: _Bookkeeping) -> Outcome | None:
    """Book a worker that could not open its group: once it had been opened, that is the next task's fault.

    InputError if the group is another one than it was, or the machine starts no further process.
    """
    group, why = report.worker.group, _did_not_open(report)
    if report.answer.ends_run:
        raise InputError(why)
    if report.worker in pool.workers:
        pool.stop(report.worker)
    if _opens_again(report, state.failed_openings):
        return None
    if group not in state.opened:
        raise PlannerLoadError(why)
    state.failed_openings.pop(group, None)
    if not state.waiting[group]:
        return None
    return Outcome(state.waiting[group].popleft(), {}, Fault("planner", why), 0.0, printed=report.printed)


def _try_groups(groups: list[str], pool: WorkerPool, workers: int, tried: set[str]) -> None:
    """Open every group once before the first task, so that a planner that cannot be built ends the run at once."""
    if len(groups) == 1:
        return  # its first worker will tell
    opened: list[Worker] = []
    for first in range(0, len(groups), workers):
        for worker in opened:
            pool.release(worker)
        opened = _opened([pool.start(group) for group in groups[first : first + workers]], pool)
        tried.update(worker.group for worker in opened)


def _opened(started: list[Worker], pool: WorkerPool) -> list[Worker]:
    """These workers, or others in their place, once all have opened their groups."""
    failures: dict[str, int] = {}
    while not all(worker.ready for worker in started):
        for report in pool.reports():
            worker, answer = report.worker, report.answer
            if answer.ready:
                worker.ready, worker.task_since_s = True, time.monotonic()
                continue
            if worker not in started:
                continue  # one of those who had opened theirs before
            if not _opens_again(report, failures):
                raise PlannerLoadError(_did_not_open(report))
            if worker in pool.workers:
                pool.stop(worker)
            started[started.index(worker)] = pool.start(worker.group)
    return started


def _opens_again(report: Report, failures: dict[str, int]) -> bool:
    """Count a worker that did not open its group; whether that was somebody else's doing and is forgiven once more."""
    group, ending = report.worker.group, report.ending
    failures[group] = failures.get(group, 0) + 1
    outside = report.answer.killed_from_outside or (ending is not None and _from_outside(ending))
    return outside and failures[group] <= OUTSIDE_KILLS_FORGIVEN


def _staff(waiting: dict[str, deque[Task]], pool: WorkerPool, workers: int) -> None:
    """Give idle workers tasks, let those go whose group is done, start up to `workers`."""
    for worker in list(pool.workers):
        if worker.ready and worker.task is None:
            if not waiting[worker.group] or (worker.tasks >= TURN and _is_unserved(waiting, pool)):
                pool.release(worker)
            elif pool.give(worker, waiting[worker.group][0]):
                waiting[worker.group].popleft()
                worker.tasks += 1
    while len(pool.workers) < workers:
        # The group with most tasks for each worker it already has.
        opening = {g: sum(w.group == g and w.task is None for w in pool.workers) for g in waiting}
        serving = {g: sum(w.group == g for w in pool.workers) for g in waiting}
        short = [g for g in waiting if len(waiting[g]) > opening[g]]
        if not short:
            return
        pool.start(max(short, key=lambda g: len(waiting[g]) / (serving[g] + 1)))


def _is_unserved(waiting: dict[str, deque[Task]], pool: WorkerPool) -> bool:
    """Whether a group has tasks and no worker."""
    return not {group for group, tasks in waiting.items() if tasks} <= {worker.group for worker in pool.workers}


def _from_outside(ending: Ending) -> bool:
    """Whether somebody else ended the worker, or its machine was lost."""
    return ending.limit is None and (ending.lost is not None or killed_from_outside(ending.exit_code))


def _blame(ending: Ending) -> Fault:
    """The fault class of a worker that ended without an answer, by the phase it was in."""
    phase, died = ending.phase, death(ending.exit_code)
    if ending.lost is not None:
        return Fault("timeout", f"{ending.lost}, {OUTSIDE_KILLS_FORGIVEN + 1} times")
    if phase in PLANNER_PHASES:
        return Fault("planner", ending.limit or f"its process {died} inside {phase}()")
    if ending.limit is not None:
        return Fault("timeout", f"{ending.limit} (in phase {phase})")
    if killed_from_outside(ending.exit_code):
        return Fault("timeout", f"the worker {died} in phase {phase}")
    if phase == "idle":  # the task was done, the answer was not: only foreign code breaks the line or the interpreter
        return Fault("planner", f"broke the process it ran in, which {died} before it could answer")
    if phase in ("setup", "simulate"):
        return Fault("traffic", f"SUMO's process {died} in phase {phase}")
    return Fault("harness", f"the worker {died} in phase {phase}")


def _did_not_open(report: Report) -> str:
    """Why, in the words of the worker if it said any."""
    if report.answer.input_error is not None:
        return report.answer.input_error
    ending = report.ending or Ending(None, "load")
    why = ending.limit or ending.lost or f"its process {death(ending.exit_code)}"
    printed = report.printed.strip().splitlines()
    last = f"; it printed last: {printed[-1]}" if printed else ""
    return f"planner {report.worker.group!r} could not be built: {why}{last}"
