"""Engine: does many tasks over worker processes that may hang, crash or be killed, and accounts for every one.

It knows nothing of driving. A task belongs to a group (here: a planner); a
worker serves one group, so that planners never share a process. Each worker
has its own line to the parent and at most one task in hand, so a death costs
one task and blocks nobody.
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import tempfile
import time
from collections import deque
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from interplan_sumo.batch.in_process import run_in_process
from interplan_sumo.batch.phases import PLANNER_PHASES, PhaseBoard
from interplan_sumo.batch.processes import (
    SINGLE_THREAD,
    adopted_orphans,
    death,
    environment,
    interrupts_held,
    kill_group,
    killed_from_outside,
)
from interplan_sumo.batch.tasks import Fault, Limits, OpenGroup, Outcome, Task
from interplan_sumo.batch.worker import serve
from interplan_sumo.errors import InputError, PlannerLoadError

POLL_S = 0.1
OUTSIDE_KILLS_FORGIVEN = 2
"""A task whose worker somebody else killed is done again this often; then it is taken to be the task's own doing."""
TRAFFIC_RETRIES = 1
OUTPUT_KEPT = 2000
"""Characters of what a worker printed that are kept with a fault."""


@dataclass(slots=True)
class _Worker:
    group: str
    process: BaseProcess
    line: Connection
    board: PhaseBoard
    output: Path
    ready: bool = False
    task: Task | None = None
    task_since_s: float = 0.0
    phase_changes: int = -1
    phase_since_s: float = 0.0
    verdict: tuple[str, str] | None = None
    """Phase and reason, if the engine killed it for a limit."""


@dataclass(slots=True)
class _Crew:
    """The workers of one run and where they keep what they print."""

    open_group: OpenGroup
    limits: Limits
    folder: Path
    workers: list[_Worker] = field(default_factory=list)
    leaving: list[_Worker] = field(default_factory=list)
    started: int = 0

    def hire(self, group: str) -> _Worker:
        context = multiprocessing.get_context("spawn")
        ends: tuple[Any, Any] = context.Pipe(duplex=True)
        here, there = ends
        shared = context.RawArray("q", 2)
        self.started += 1
        output = self.folder / f"worker-{self.started}.txt"
        process = context.Process(
            target=serve,
            args=(there, shared, group, self.open_group, str(output), self.limits.memory_bytes),
            daemon=False,
            name=f"interplan-sumo worker {self.started}",
        )
        # Set iteration order, too, must not differ from worker to worker.
        with environment({**SINGLE_THREAD, "PYTHONHASHSEED": "0"}), interrupts_held():
            process.start()
        there.close()
        worker = _Worker(group, process, here, PhaseBoard(shared), output)
        worker.task_since_s = worker.phase_since_s = time.monotonic()
        self.workers.append(worker)
        return worker

    def dismiss(self, worker: _Worker) -> None:
        """Let an idle worker end by itself, so that what it opened is closed in order."""
        self.workers.remove(worker)
        with contextlib.suppress(OSError):
            worker.line.send(None)
        worker.task_since_s = time.monotonic()
        self.leaving.append(worker)

    def bury(self, worker: _Worker) -> None:
        """End a worker and everything it started, at once."""
        for crew in (self.workers, self.leaving):
            if worker in crew:
                crew.remove(worker)
        kill_group(worker.process)
        worker.line.close()

    def see_off(self, patience_s: float) -> None:
        """Bury those who left, and those who do not leave within `patience_s`."""
        for worker in list(self.leaving):
            if not worker.process.is_alive() or time.monotonic() - worker.task_since_s > patience_s:
                self.bury(worker)

    def disband(self) -> None:
        for worker in [*self.workers, *self.leaving]:
            self.bury(worker)


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
        yield from run_in_process(tasks, open_group, limits)
        return
    with tempfile.TemporaryDirectory(prefix="interplan-sumo-") as folder, adopted_orphans():
        crew = _Crew(open_group, limits, Path(folder))
        try:
            yield from _run(tasks, crew, workers)
            for worker in list(crew.workers):
                crew.dismiss(worker)
            while crew.leaving:
                crew.see_off(patience_s=5.0)
                connection.wait([w.process.sentinel for w in crew.leaving], timeout=POLL_S)
        finally:
            crew.disband()


def _run(tasks: Sequence[Task], crew: _Crew, workers: int) -> Generator[Outcome]:
    waiting: dict[str, deque[Task]] = {}
    for task in tasks:
        waiting.setdefault(task.group, deque()).append(task)
    _try_groups(list(waiting), crew, workers)
    outside_kills: dict[Any, int] = {}
    traffic_faults: dict[Any, int] = {}
    failed_openings: dict[str, int] = {}
    while any(waiting.values()) or any(w.task for w in crew.workers):
        _staff(waiting, crew, workers)
        for worker in _heard(crew):
            reply, ending = _listen(worker, crew)
            if reply is None and ending is None:
                continue
            if reply is not None and "ready" in reply:
                worker.ready, worker.task_since_s = True, time.monotonic()
                failed_openings.pop(worker.group, None)
                continue
            if reply is not None and "input_error" in reply:
                raise InputError(str(reply["input_error"]))
            task, worker.task = worker.task, None
            if task is None:  # it died while idle, or while opening what had opened before
                if not worker.ready:
                    failed_openings[worker.group] = failed_openings.get(worker.group, 0) + 1
                    if failed_openings[worker.group] > OUTSIDE_KILLS_FORGIVEN:
                        raise PlannerLoadError(_did_not_open(worker, ending))
                continue
            wall_s = time.monotonic() - worker.task_since_s
            if reply is not None:
                fault = Fault(*reply["fault"]) if reply["fault"] else None
                value: dict[str, Any] = reply["value"]
            else:
                value = {}
                exit_code, phase, limit = _unpacked(ending)
                if limit is None and killed_from_outside(exit_code):
                    outside_kills[task.key] = outside_kills.get(task.key, 0) + 1
                    if outside_kills[task.key] <= OUTSIDE_KILLS_FORGIVEN:
                        waiting[task.group].appendleft(task)
                        continue
                fault = _blame(exit_code, phase, limit)
            if fault is not None and fault.kind == "traffic":
                traffic_faults[task.key] = traffic_faults.get(task.key, 0) + 1
                if traffic_faults[task.key] <= TRAFFIC_RETRIES:
                    waiting[task.group].appendleft(task)
                    if worker in crew.workers:
                        crew.bury(worker)
                    continue
            printed = _printed(worker) if fault is not None else ""
            if fault is not None and worker in crew.workers:
                crew.bury(worker)  # after a fault nobody knows what state a process is in
            yield Outcome(task, value, fault, wall_s, printed)
        _enforce(crew)
        crew.see_off(patience_s=5.0)


def _try_groups(groups: list[str], crew: _Crew, workers: int) -> None:
    """Open every group once before the first task, so that a planner that cannot be built ends the run at once."""
    if len(groups) == 1:
        return  # its first worker will tell
    kept = 0
    for first in range(0, len(groups), workers):
        hired = [crew.hire(group) for group in groups[first : first + workers]]
        for worker in hired:
            for left in reversed(range(OUTSIDE_KILLS_FORGIVEN + 1)):
                ending = _await_ready(worker, crew)
                if ending is None:
                    break
                if left == 0 or not killed_from_outside(_unpacked(ending)[0]):
                    raise PlannerLoadError(_did_not_open(worker, ending))
                worker = crew.hire(worker.group)
            if kept < workers:
                kept += 1
            else:
                crew.dismiss(worker)


def _await_ready(worker: _Worker, crew: _Crew) -> _Ending | None:
    while True:
        connection.wait([worker.line, worker.process.sentinel], timeout=POLL_S)
        reply, ending = _listen(worker, crew)
        if reply is not None and "input_error" in reply:
            raise InputError(str(reply["input_error"]))
        if reply is not None:
            worker.ready = True
            return None
        if ending is not None:
            return ending
        _enforce(crew)


def _staff(waiting: dict[str, deque[Task]], crew: _Crew, workers: int) -> None:
    """Give idle workers tasks, let those go whose group is done, hire up to `workers`."""
    for worker in list(crew.workers):
        if worker.ready and worker.task is None:
            if not waiting[worker.group]:
                crew.dismiss(worker)
                continue
            task = waiting[worker.group].popleft()
            try:
                worker.line.send(task.payload)
            except OSError:  # it died just now; _listen will bury it
                waiting[worker.group].appendleft(task)
                continue
            worker.task = task
            worker.task_since_s = worker.phase_since_s = time.monotonic()
    while len(crew.workers) < workers:
        # The group with most tasks for each worker it already has.
        opening = {g: sum(w.group == g and w.task is None for w in crew.workers) for g in waiting}
        serving = {g: sum(w.group == g for w in crew.workers) for g in waiting}
        short = [g for g in waiting if len(waiting[g]) > opening[g]]
        if not short:
            return
        crew.hire(max(short, key=lambda g: len(waiting[g]) / (serving[g] + 1)))


def _heard(crew: _Crew) -> list[_Worker]:
    """The workers with something to say, or dead; waits a moment for one."""
    things: list[Any] = [w.line for w in crew.workers] + [w.process.sentinel for w in crew.workers]
    ready = set(connection.wait(things, timeout=POLL_S)) if things else set()
    return [w for w in crew.workers if w.line in ready or w.process.sentinel in ready]


_Ending = tuple[int | None, str, str | None]
"""Exit code, phase at the end, and the limit for which the engine ended it, if it did."""


def _listen(worker: _Worker, crew: _Crew) -> tuple[dict[str, Any] | None, _Ending | None]:
    """The worker's answer, or how it ended; neither if there is nothing yet. A worker that ended is buried."""
    broken = False
    try:
        if worker.line.poll():
            reply = json.loads(worker.line.recv_bytes())
            if isinstance(reply, dict):
                return reply, None
            broken = True
    except (EOFError, OSError, ValueError):
        broken = True
    if not broken and worker.process.is_alive():
        return None, None
    phase = worker.board.phase
    worker.process.join(timeout=0.5 if broken else None)  # a closed line: most often it is just about to end
    exit_code = worker.process.exitcode
    verdict = worker.verdict
    crew.bury(worker)
    return None, (exit_code, verdict[0] if verdict else phase, verdict[1] if verdict else None)


def _unpacked(ending: _Ending | None) -> _Ending:
    return ending if ending is not None else (None, "idle", None)


def _enforce(crew: _Crew) -> None:
    """Kill workers that are over a limit; the next `_listen` finds them dead."""
    now_s = time.monotonic()
    limits = crew.limits
    for worker in crew.workers:
        changes = worker.board.changes
        if changes != worker.phase_changes:
            worker.phase_changes, worker.phase_since_s = changes, now_s
        if worker.verdict is not None or (worker.ready and worker.task is None):
            continue
        phase = worker.board.phase
        in_phase_s, in_task_s = now_s - worker.phase_since_s, now_s - worker.task_since_s
        if not worker.ready:
            if in_task_s > limits.load_s:
                worker.verdict = ("load", f"took longer than {limits.load_s:g} s to build")
        elif phase == "plan" and in_phase_s > limits.plan_s + limits.grace_s:
            worker.verdict = ("plan", f"plan() took longer than {limits.plan_s:g} s")
        elif in_task_s > limits.task_s:
            worker.verdict = (phase, f"no result after {limits.task_s:g} s")
        if worker.verdict is not None:
            worker.process.kill()


def _blame(exit_code: int | None, phase: str, limit: str | None) -> Fault:
    """The fault class of a worker that ended without an answer, by the phase it was in."""
    if phase in PLANNER_PHASES:
        return Fault("planner", limit or f"its process {death(exit_code)} inside {phase}()")
    if limit is not None:
        return Fault("timeout", f"{limit} (in phase {phase})")
    if killed_from_outside(exit_code):
        return Fault("timeout", f"the worker {death(exit_code)} in phase {phase}")
    if phase == "idle":  # the task was done, the answer was not: only foreign code breaks the line or the interpreter
        return Fault("planner", f"broke the process it ran in, which {death(exit_code)} before it could answer")
    if phase in ("setup", "simulate"):
        return Fault("traffic", f"SUMO's process {death(exit_code)} in phase {phase}")
    return Fault("harness", f"the worker {death(exit_code)} in phase {phase}")


def _did_not_open(worker: _Worker, ending: _Ending | None) -> str:
    exit_code, _, limit = _unpacked(ending)
    printed = _printed(worker).strip().splitlines()
    last = f"; it printed last: {printed[-1]}" if printed else ""
    return f"planner {worker.group!r} could not be built: {limit or f'its process {death(exit_code)}'}{last}"


def _printed(worker: _Worker) -> str:
    """The end of what the worker printed during its task."""
    try:
        with worker.output.open("rb") as file:
            file.seek(0, 2)
            file.seek(max(0, file.tell() - 4 * OUTPUT_KEPT))
            return file.read().decode(errors="replace")[-OUTPUT_KEPT:]
    except OSError:
        return ""
