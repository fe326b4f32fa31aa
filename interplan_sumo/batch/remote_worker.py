"""Remote worker: keeps one worker process on a machine of a cluster, with the limits that local workers have.

It knows nothing of the cluster's software: the parent calls its methods over there and gets what happened as data.
The planner runs in a process of its own, so this one outlives whatever it does and can tell in which phase it did it.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from interplan_sumo.batch.processes import adopted_orphans
from interplan_sumo.batch.records import WorkerAnswer
from interplan_sumo.batch.remote_jobs import Files, Portable, write_files
from interplan_sumo.batch.tasks import Limits, Task
from interplan_sumo.batch.versions import versions
from interplan_sumo.batch.worker_pool import Ending, ProcessPool, Worker


@dataclass(frozen=True, slots=True)
class HostInfo:
    """What the parent's process is like, for planners that are looked up by their file."""

    path: Sequence[str]
    """Where Python looks for modules."""
    folder: str
    """The working folder."""


@dataclass(frozen=True, slots=True)
class WorkerReply:
    """What happened there: as `worker_pool.Report`, without the worker."""

    answer: WorkerAnswer = field(default_factory=WorkerAnswer)
    ending: Ending | None = None
    printed: str = ""
    files: Files = field(default_factory=dict)
    """What is to come home."""
    versions: dict[str, str] = field(default_factory=dict)
    """Of what drives there, once a group is open."""


class RemoteWorker:
    """One worker on another machine. Its methods are called one after the other, but `stop`: at any time."""

    def __init__(self, jobs: Portable, stage_in: Files, limits: Limits, host: HostInfo) -> None:
        sys.path.extend(place for place in host.path if place not in sys.path)
        with contextlib.suppress(OSError):  # another machine may not have it
            os.chdir(host.folder)
        # Worker processes import the main module of who starts them: the cluster's own is none of their business.
        vars(sys.modules["__main__"]).pop("__file__", None)
        self._stopped = threading.Event()
        self._jobs = jobs
        self._place = Path(tempfile.mkdtemp(prefix="interplan-sumo-"))
        self._printed = self._place / "printed"
        self._folder = self._place / "run"
        self._printed.mkdir()
        self._folder.mkdir()
        write_files(self._folder, stage_in)
        self._orphans = contextlib.ExitStack()
        self._orphans.enter_context(adopted_orphans())
        self._pool = ProcessPool(jobs.open_in(self._folder), limits, self._printed)
        self._worker: Worker | None = None

    def open(self, group: str) -> WorkerReply:
        """Start a worker for a group, in place of the one before."""
        self._pool.stop_all()
        self._worker = self._pool.start(group)
        return self._listen()

    def do(self, task: Task, needs: Files) -> WorkerReply:
        """Have the worker do a task, with the files that it needs."""
        write_files(self._folder, needs)
        if self._worker is None or not self._pool.give(self._worker, task):
            return WorkerReply(ending=Ending(None, "idle", lost="its worker died between two tasks"))
        said = self._listen()
        self._worker.task = None
        return said

    def close(self) -> None:
        """Let the worker end by itself."""
        self._pool.close()
        self._worker = None

    def stop(self) -> None:
        """End what is being done now."""
        self._stopped.set()

    def clear(self) -> None:
        """End the worker and clear away what it has written."""
        self._pool.stop_all()
        self._orphans.close()
        shutil.rmtree(self._place, ignore_errors=True)

    def _listen(self) -> WorkerReply:
        while not self._stopped.is_set():
            for report in self._pool.reports():
                if report.answer.ready:
                    report.worker.ready = True
                    return WorkerReply(report.answer, versions=versions())
                return WorkerReply(report.answer, report.ending, report.printed, self._jobs.collect(self._folder))
        self._pool.stop_all()
        return WorkerReply(ending=Ending(None, "idle", lost="it was stopped"))
