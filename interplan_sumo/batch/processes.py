"""Processes: what the operating system must do so that no job can hurt another and none is left behind."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
import threading
from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

from interplan_sumo.errors import InputError
from interplan_sumo.planner_process.family import kill_family

SINGLE_THREAD = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""One thread per worker: the workers are the parallelism, and sums keep one order."""

_INTERRUPTS = (signal.SIGINT, signal.SIGTERM)
_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_PR_SET_DUMPABLE = 4
_PR_SET_CHILD_SUBREAPER = 36
_PR_GET_CHILD_SUBREAPER = 37


def available_cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return max(1, len(os.sched_getaffinity(0)))
    return os.cpu_count() or 1


@dataclass(frozen=True, slots=True)
class Workers:
    """Who does the jobs, as the command line asks for it."""

    processes: int
    """Of this machine; 0 works in this one."""
    ray: str | None = None
    """The address of a Ray cluster to use instead; `local` starts one on this machine."""

    @property
    def in_this_process(self) -> bool:
        return self.processes == 0 and self.ray is None

    @classmethod
    def parse(cls, text: str | None) -> Workers:
        """From `N`, `ray`, `ray:ADDRESS` or `ray://HOST:PORT`; all cores for None. InputError for anything else."""
        if text is None:
            return cls(available_cores())
        name, _, address = text.partition(":")
        if name == "ray":
            return cls(0, text if address.startswith("//") else address or "local")
        try:
            return cls(int(text))
        except ValueError:
            raise InputError(f"--workers {text!r} is no number of processes; give one, or ray[:ADDRESS]") from None


@contextlib.contextmanager
def environment(values: dict[str, str]) -> Generator[None]:
    """Environment variables as given inside the block; children started in it inherit them."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextlib.contextmanager
def interrupts_held() -> Generator[None]:
    """Inside the block Ctrl-C waits; processes started in it inherit that, until `become_worker` ends it.

    Otherwise a Ctrl-C at the terminal would hit workers that are still importing, and each would print a traceback.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def uninterrupted() -> Generator[None]:
    """Ctrl-C and SIGTERM inside the block are answered at its end, so that what it does is done whole."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held: list[int] = []
    before = {each: signal.signal(each, lambda number, _: held.append(number)) for each in _INTERRUPTS}
    try:
        yield
    finally:
        for each, answer in before.items():
            signal.signal(each, answer if answer is not None else signal.SIG_DFL)
        if held:
            signal.raise_signal(held[0])


def become_worker(memory_bytes: int | None) -> None:
    """Make this process a worker: own session, dies with its parent, no core dumps, memory capped.

    What a planner of it leaves behind stays below it, and no planner may look into it.

    The cap counts private writable memory (RLIMIT_DATA, enforced by Linux): an
    allocation beyond it raises MemoryError where it happens.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to answer
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if hasattr(os, "setsid"):
        with contextlib.suppress(OSError):
            os.setsid()
    if sys.platform == "linux":
        parent = os.getppid()
        _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:  # the parent died before the line above
            os._exit(1)
        _prctl(_PR_SET_CHILD_SUBREAPER, 1)
        _prctl(_PR_SET_DUMPABLE, 0)
    if sys.platform != "win32":
        import resource

        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
        if memory_bytes is not None:
            with contextlib.suppress(ValueError, OSError):
                resource.setrlimit(resource.RLIMIT_DATA, (memory_bytes, resource.getrlimit(resource.RLIMIT_DATA)[1]))


@contextlib.contextmanager
def adopted_orphans() -> Generator[None]:
    """Inside the block, processes that a dead worker leaves behind become children of this one, which can reap them."""
    if sys.platform != "linux":
        yield
        return
    before = ctypes.c_int(0)
    _prctl(_PR_GET_CHILD_SUBREAPER, ctypes.addressof(before))
    _prctl(_PR_SET_CHILD_SUBREAPER, 1)
    try:
        yield
    finally:
        _prctl(_PR_SET_CHILD_SUBREAPER, before.value)


def kill_worker(worker: Any) -> None:
    """Kill a worker and everything it started, and leave no zombie.

    `worker` is its multiprocessing process, not yet joined: its process id is
    still its own, so its session cannot be somebody else's.
    """
    kill_family(worker.pid, session=worker.pid)
    worker.kill()  # in case it died before it had a group
    worker.join()
    if hasattr(os, "waitpid"):
        with contextlib.suppress(ChildProcessError):
            while os.waitpid(-worker.pid, 0)[0]:
                pass


def _prctl(option: int, value: int) -> None:
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None, use_errno=True).prctl(option, ctypes.c_ulong(value), 0, 0, 0)
