"""Ray: the same engine with its workers on a Ray cluster: an actor for each, which keeps one worker process there.

Ray is an extra and is imported only here. Traces come back through its object store: a drive's are some 0.1 to 0.5 MB,
so no file system needs to be shared. A limit, a crash or a hang is found out by the actor beside the worker process;
what the parent sees from afar is only that an actor, or its machine, is gone.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import sys
import threading
import time
import warnings
from collections.abc import Generator, Sequence
from typing import Any

from interplan_sumo.batch.engine import run_with
from interplan_sumo.batch.processes import available_cores, environment
from interplan_sumo.batch.records import WorkerAnswer
from interplan_sumo.batch.remote_jobs import Portable
from interplan_sumo.batch.remote_worker import HostInfo, RemoteWorker, WorkerReply
from interplan_sumo.batch.tasks import Limits, Outcome, Task
from interplan_sumo.batch.versions import versions
from interplan_sumo.batch.worker_pool import PATIENCE_S, POLL_S, Ending, Report, Worker
from interplan_sumo.errors import InputError
from interplan_sumo.extras import library

LOCAL = "local"
"""The address that stands for a cluster of this machine's own, started for the run."""
KNOCK_S = 10.0
STORE_BYTES = 256 << 20
"""Object store of such a cluster: hundreds of traces on their way."""


def run_on_ray(tasks: Sequence[Task], jobs: Portable, *, address: str, limits: Limits) -> Generator[Outcome]:
    """Yield one outcome per task, as `engine.run_tasks` does, with a worker on every CPU of a Ray cluster.

    `address` is what `ray.init` takes: `auto`, `host:port` or `ray://host:port`;
    `local` starts one on this machine. Where this process is connected to Ray
    already, that cluster is taken. InputError without the extra, or if the
    cluster cannot be reached or has other versions than this machine.
    """
    if not tasks:
        return
    with connected(address) as cpus:
        pool = RayPool(_ray(), jobs, limits)
        try:
            yield from run_with(pool, tasks, cpus)
        finally:
            pool.stop_all()


class RayPool:
    """Workers that Ray actors keep; an actor whose worker ended takes the next one."""

    def __init__(self, ray: Any, jobs: Portable, limits: Limits) -> None:
        self._ray = ray
        self._jobs = jobs
        self._limits = limits
        self._actor = _actor_class(ray)
        self._staged = ray.put(jobs.stage_in())
        self._host = HostInfo(tuple(sys.path), os.getcwd())
        self._versions = versions()
        self._actors: dict[Worker, Any] = {}
        self._idle: list[Any] = []
        self._awaited: dict[Any, Worker] = {}
        """Calls under way, by the reference to what they will return."""

    @property
    def workers(self) -> list[Worker]:
        return list(self._actors)

    def start(self, group: str) -> Worker:
        actor = self._idle.pop() if self._idle else self._new_actor()
        worker = Worker(group, time.monotonic())
        self._actors[worker] = actor
        self._awaited[actor.open.remote(group)] = worker
        return worker

    def give(self, worker: Worker, task: Task) -> bool:
        self._awaited[self._actors[worker].do.remote(task, self._jobs.needs(task))] = worker
        worker.task, worker.task_since_s = task, time.monotonic()
        return True

    def release(self, worker: Worker) -> None:
        actor = self._actors.pop(worker)
        actor.close.remote()
        self._idle.append(actor)

    def stop(self, worker: Worker) -> None:
        """Take its actor back: the next worker that it opens ends this one."""
        self._idle.append(self._actors.pop(worker))

    def reports(self) -> list[Report]:
        if not self._awaited:
            return []
        self._ray.wait(list(self._awaited), timeout=POLL_S)
        there, _ = self._ray.wait(list(self._awaited), num_returns=len(self._awaited), timeout=0)
        return [self._report(reference, self._awaited.pop(reference)) for reference in there]

    def stop_all(self) -> None:
        """End all workers; what their actors have written over there is cleared away."""
        actors = [*self._actors.values(), *self._idle]
        self._actors, self._idle, self._awaited = {}, [], {}
        with contextlib.suppress(self._ray.exceptions.RayError, ConnectionError):
            for actor in actors:
                actor.stop.remote()
            gone = [actor.clear.remote() for actor in actors]
            if gone:
                self._ray.wait(gone, num_returns=len(gone), timeout=PATIENCE_S)
            for actor in actors:
                self._ray.kill(actor)

    def _new_actor(self) -> Any:
        return self._actor.remote(self._jobs, self._staged, self._limits, self._host)

    def _report(self, reference: Any, worker: Worker) -> Report:
        try:
            said: WorkerReply = self._ray.get(reference)
        except self._ray.exceptions.RayError as error:
            with contextlib.suppress(self._ray.exceptions.RayError):
                self._ray.kill(self._actors.pop(worker))
            return Report(worker, WorkerAnswer(), Ending(None, "idle", lost=_lost(error)))
        if said.versions:
            self._check_versions(said.versions)
        self._jobs.stage_out(said.files)
        if said.ending is not None:
            self.stop(worker)
        return Report(worker, said.answer, said.ending, said.printed)

    def _check_versions(self, there: dict[str, str]) -> None:
        for name, version in self._versions.items():
            if there.get(name) != version:
                raise InputError(
                    f"a machine of the Ray cluster has {name} {there.get(name, 'missing')}, this one has {version}; "
                    "equal results need equal versions: install the same on all"
                )


def _actor_class(ray: Any) -> Any:
    """`RemoteWorker` as a class of actors that hear `stop` while they are at work."""

    class RemoteActor(RemoteWorker):
        @ray.method(concurrency_group="control")
        def stop(self) -> None:
            super().stop()

    return ray.remote(num_cpus=1, max_restarts=0, concurrency_groups={"control": 1})(RemoteActor)


def _lost(error: Exception) -> str:
    """Why a worker is out of reach, in one line."""
    said = [line.strip() for line in str(error).splitlines() if line.strip()]
    what = said[-1] if "creation task" in str(error) else said[0] if said else ""
    return f"its worker on the Ray cluster was lost: {what.rstrip('.') or type(error).__name__}"


def _ray() -> Any:
    return library("ray", "--workers ray", "ray")


@contextlib.contextmanager
def connected(address: str) -> Generator[int]:
    """Inside the block this process is a client of the cluster, which has so many CPUs; InputError as `run_on_ray`."""
    ray = _ray()
    if ray.is_initialized():
        yield _cpus(ray)
        return
    options: dict[str, Any] = {"address": address, "log_to_driver": False, "logging_level": "ERROR"}
    if address == LOCAL:
        options |= {"num_cpus": available_cores(), "include_dashboard": False, "object_store_memory": STORE_BYTES}
    try:
        _knock(address)
        with environment({"RAY_USAGE_STATS_ENABLED": "0"}), _own_sigterm(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what it warns of is in the error, too
            ray.init(**options)
    except (ConnectionError, TimeoutError, RuntimeError, ValueError, OSError, ImportError) as error:
        why = next(iter(str(error).splitlines()), "").partition(". ")[0].rstrip(".") or type(error).__name__
        raise InputError(
            f"cannot reach a Ray cluster at {address!r}: {why}; start one with `ray start --head`, "
            "or give --workers ray for one of this machine's own"
        ) from None
    try:
        yield _cpus(ray)
    finally:
        ray.shutdown()


def _cpus(ray: Any) -> int:
    return max(1, int(ray.cluster_resources().get("CPU", 1)))


def _knock(address: str) -> None:
    """OSError if nobody listens at `host:port`, for which Ray itself would wait for minutes."""
    host, _, port = address.removeprefix("ray://").partition("/")[0].rpartition(":")
    if host and port.isdecimal():
        socket.create_connection((host.strip("[]"), int(port)), timeout=KNOCK_S).close()


@contextlib.contextmanager
def _own_sigterm() -> Generator[None]:
    """Keep this process's answer to SIGTERM, which Ray replaces with one of its own."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
