"""Worker pool: processes on this machine, each with its own line to the parent and at most one task in hand.

What ends a worker that hangs, crashes or is killed, and in which phase it was, is found out here; what that means
for its task is the engine's to say.
"""

from __future__ import annotations

import atexit
import contextlib
import multiprocessing
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, Protocol

from interplan_sumo.batch.processes import SINGLE_THREAD, environment, interrupts_held, kill_worker, uninterrupted
from interplan_sumo.batch.records import RecordError, WorkerAnswer, decode
from interplan_sumo.batch.tasks import Limits, OpenGroup, SharedPhase, Task
from interplan_sumo.batch.worker import serve
from interplan_sumo.planner_process.awake import AwakeClock

POLL_S = 0.1
GRACE_S = 5.0
"""Of a worker that opens its group: it tells itself what was over its limit."""
PATIENCE_S = 5.0
"""How long a worker that was told to leave may take before it is ended."""
MOST_BYTES = 1 << 28
"""Of an answer; more is none."""
OUTPUT_KEPT = 2000
"""Characters of what a worker printed that are kept with a fault."""


@dataclass(slots=True, eq=False)
class Worker:
    """One worker as the engine sees it: the group it serves and the task it has in hand."""

    group: str
    task_since_s: float
    """Monotonic: when it was given its task; without one, when it began to open its group or had done so."""
    ready: bool = False
    """Whether it has opened its group."""
    task: Task | None = None
    tasks: int = 0
    """How many it was given."""


@dataclass(frozen=True, slots=True)
class Ending:
    """How a worker ended without an answer."""

    exit_code: int | None
    phase: str
    limit: str | None = None
    """The limit for which it was ended, in words."""
    lost: str | None = None
    """Why it is out of reach, where that is all that is known: its machine is gone."""


@dataclass(frozen=True, slots=True)
class Report:
    """What a pool has heard from a worker: an answer, or how it ended."""

    worker: Worker
    answer: WorkerAnswer
    """Nothing said if it ended."""
    ending: Ending | None = None
    printed: str = ""
    """The end of what it printed."""


class WorkerPool(Protocol):
    """Workers that serve groups, wherever they are."""

    @property
    def workers(self) -> Sequence[Worker]:
        """Those that may be given tasks, or will be once they are ready."""
        ...

    def start(self, group: str) -> Worker:
        """A new worker; it reports as soon as it has opened its group."""
        ...

    def give(self, worker: Worker, task: Task) -> bool:
        """Hand a task to a worker that is ready and has none; False if it has died meanwhile."""
        ...

    def reports(self) -> list[Report]:
        """What there is to hear, after waiting a moment; those who ended or ran over a limit are no longer of it."""
        ...

    def release(self, worker: Worker) -> None:
        """Let an idle worker end by itself, so that what it opened is closed in order."""
        ...

    def stop(self, worker: Worker) -> None:
        """End a worker and everything it started, at once."""
        ...


@dataclass(slots=True)
class _Process:
    """What belongs to a worker on this machine."""

    process: BaseProcess
    line: Connection
    phases: SharedPhase
    output: Path
    since_s: float
    """By the pool's clock: when it was started, given its task or told to leave."""
    over: Ending | None = None
    """Phase and limit, if it was killed for one."""


class ProcessPool:
    """Workers that are processes of this machine, and the folder in which they keep what they print."""

    def __init__(self, open_group: OpenGroup, limits: Limits, folder: Path) -> None:
        self._open_group = open_group
        self._limits = limits
        self._folder = folder
        self._started = 0
        self._present: dict[Worker, _Process] = {}
        self._leaving: dict[Worker, _Process] = {}
        self._clock = AwakeClock()
        atexit.register(self.stop_all)  # before multiprocessing waits for them, if all else was interrupted

    @property
    def workers(self) -> list[Worker]:
        return list(self._present)

    def start(self, group: str) -> Worker:
        context = multiprocessing.get_context("spawn")
        ends: tuple[Any, Any] = context.Pipe(duplex=True)
        here, there = ends
        shared = context.RawArray("q", 1)
        self._started += 1
        output = self._folder / f"worker-{self._started}.txt"
        process = context.Process(
            target=serve,
            args=(there, shared, group, self._open_group, str(output), self._limits.memory_bytes),
            daemon=False,
            name=f"interplan-sumo worker {self._started}",
        )
        worker = Worker(group, time.monotonic())
        # Set iteration order, too, must not differ from worker to worker.
        with environment({**SINGLE_THREAD, "PYTHONHASHSEED": "0"}), uninterrupted(), interrupts_held():
            process.start()
            self._present[worker] = _Process(process, here, SharedPhase(shared), output, self._clock.now_s())
        there.close()
        return worker

    def give(self, worker: Worker, task: Task) -> bool:
        own = self._present[worker]
        try:
            own.line.send(task.payload)
        except OSError:  # it died just now; `reports` will tell
            return False
        worker.task = task
        worker.task_since_s, own.since_s = time.monotonic(), self._clock.now_s()
        return True

    def release(self, worker: Worker) -> None:
        own = self._leaving[worker] = self._present[worker]
        del self._present[worker]
        with contextlib.suppress(OSError):
            own.line.send(None)
        own.since_s = self._clock.now_s()

    def stop(self, worker: Worker) -> None:
        with uninterrupted():
            for place in (self._present, self._leaving):
                own = place.pop(worker, None)
                if own is not None:
                    kill_worker(own.process)
                    own.line.close()
                    own.output.unlink(missing_ok=True)

    def reports(self) -> list[Report]:
        found = [report for worker in self._heard() if (report := self._listen(worker)) is not None]
        self._enforce()
        self._reap()
        return found

    def close(self) -> None:
        """Release all workers and wait until they are gone."""
        for worker in self.workers:
            self.release(worker)
        while self._leaving:
            self._reap()
            connection.wait([own.process.sentinel for own in self._leaving.values()], timeout=POLL_S)

    def stop_all(self) -> None:
        """Stop all workers, also if somebody presses Ctrl-C once more meanwhile."""
        with uninterrupted():
            for worker in [*self._present, *self._leaving]:
                self.stop(worker)
        atexit.unregister(self.stop_all)

    def _heard(self) -> list[Worker]:
        """The workers with something to say, or dead; waits a moment for one."""
        things = [thing for own in self._present.values() for thing in (own.line, own.process.sentinel)]
        ready = set(connection.wait(things, timeout=POLL_S)) if things else set()
        return [w for w, own in self._present.items() if own.line in ready or own.process.sentinel in ready]

    def _listen(self, worker: Worker) -> Report | None:
        """The worker's answer, or how it ended; None if there is nothing yet. A worker that ended is let go of."""
        own = self._present[worker]
        broken = False
        try:
            if own.line.poll():
                answer = decode(own.line.recv_bytes(MOST_BYTES), WorkerAnswer)
                return Report(worker, answer, printed=_end_of(own.output))
        except (EOFError, OSError, RecordError):
            broken = True
        if not broken and own.process.is_alive():
            return None
        phase = own.phases.phase
        own.process.join(timeout=0.5 if broken else None)  # a closed line: most often it is just about to end
        exit_code = own.process.exitcode
        ending = Ending(exit_code, phase) if own.over is None else Ending(exit_code, own.over.phase, own.over.limit)
        printed = _end_of(own.output)
        self.stop(worker)
        return Report(worker, WorkerAnswer(), ending, printed)

    def _enforce(self) -> None:
        """Kill workers that are over a limit; the next `_listen` finds them dead."""
        now_s = self._clock.now_s()
        limits = self._limits
        for worker, own in self._present.items():
            if own.over is not None or (worker.ready and worker.task is None):
                continue
            in_task_s = now_s - own.since_s
            if not worker.ready:
                if in_task_s > limits.load_s + GRACE_S:
                    own.over = Ending(None, "load", f"took longer than {limits.load_s:g} s to build")
            elif in_task_s > limits.task_s:
                own.over = Ending(None, own.phases.phase, f"no result after {limits.task_s:g} s")
            if own.over is not None:
                own.process.kill()

    def _reap(self) -> None:
        """Let go of those that left, and stop those that do not leave in time."""
        for worker, own in list(self._leaving.items()):
            if not own.process.is_alive() or self._clock.now_s() - own.since_s > PATIENCE_S:
                self.stop(worker)


def _end_of(output: Path) -> str:
    """The end of what a worker printed during its task."""
    try:
        with output.open("rb") as file:
            file.seek(0, 2)
            file.seek(max(0, file.tell() - 4 * OUTPUT_KEPT))
            return file.read().decode(errors="replace")[-OUTPUT_KEPT:]
    except OSError:
        return ""
