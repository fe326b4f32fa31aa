"""Worker: the far side of the engine: one process, one group of tasks, one task at a time."""

from __future__ import annotations

import contextlib
import faulthandler
import os
import sys
import threading
import traceback
from multiprocessing import connection, parent_process
from multiprocessing.connection import Connection
from typing import Any

from interplan_sumo.batch.processes import become_worker
from interplan_sumo.batch.records import Fault, WorkerAnswer, decode, encode, readable
from interplan_sumo.batch.tasks import (
    PLANNER_PHASES,
    KilledFromOutsideError,
    OpenGroup,
    Shared,
    SharedPhase,
    Work,
)
from interplan_sumo.errors import InputError, PlannerChangedError, ProcessRefusedError, TrafficError
from interplan_sumo.planner_process.deaths import KilledWhileBuiltError


def attempt(work: Work, task: Any, phases: SharedPhase) -> WorkerAnswer:
    """Do one task; whatever escapes becomes a fault by the phase in which it was raised.

    SystemExit and KeyboardInterrupt included: in a worker nobody but the task
    raises them. What is said can be stored: numbers that are not finite are
    null, texts are readable.
    """
    try:
        value, fault = work(task)
        said = None if fault is None else Fault(fault.kind, readable(fault.message))
        return decode(encode(WorkerAnswer(value=value, fault=said)), WorkerAnswer)
    except BaseException as error:
        if isinstance(error, KilledFromOutsideError):
            return WorkerAnswer(fault=Fault("planner", str(error)), killed_from_outside=True)
        phase = phases.phase
        text = readable(f"{type(error).__name__}: {error}" if str(error) else type(error).__name__)
        if phase in PLANNER_PHASES:
            return WorkerAnswer(fault=Fault("planner", f"raised {text}"))
        if isinstance(error, InputError):
            return WorkerAnswer(input_error=readable(str(error)))
        if isinstance(error, TrafficError):
            return WorkerAnswer(fault=Fault("traffic", readable(str(error))))
        fault = Fault("harness", f"{text} (in phase {phase})")
        return WorkerAnswer(fault=fault, traceback=readable(traceback.format_exc()))


def serve(
    line: Connection, shared: Shared, group: str, open_group: OpenGroup, output: str, memory_bytes: int | None
) -> None:
    """Body of a worker process: open the group, then answer tasks until told to stop (None) or the line closes.

    Tasks come pickled from the parent, answers go back as JSON: a planner that
    damages this process cannot run anything in the parent. What the process
    prints goes to the file `output`, emptied before each task.
    """
    _print_to(output)
    become_worker(memory_bytes)
    faulthandler.enable(file=sys.stderr)
    threading.Thread(target=_die_with_parent, daemon=True).start()
    home = os.getpid()
    if hasattr(os, "register_at_fork"):
        # A copy of this process must not answer in its name, nor keep the line open when it has died.
        os.register_at_fork(after_in_child=line.close)
    phases = SharedPhase(shared)

    def publish(phase: str) -> None:
        if os.getpid() != home:  # a planner forked, and its copy came back from plan()
            os._exit(0)
        phases.publish(phase)

    publish("load")
    try:
        work = open_group(group, publish)
    except InputError as error:
        killed = isinstance(error, KilledWhileBuiltError)
        ends = isinstance(error, PlannerChangedError | ProcessRefusedError)
        _answer(line, WorkerAnswer(input_error=readable(str(error)), killed_from_outside=killed, ends_run=ends))
        return
    except BaseException as error:
        why = f"planner {group!r} could not be built: {type(error).__name__}: {error}"
        _answer(line, WorkerAnswer(input_error=readable(why)))
        return
    publish("idle")
    _answer(line, WorkerAnswer(ready=True))
    while True:
        try:
            task = line.recv()
        except (EOFError, OSError):
            return
        if task is None:
            return
        with contextlib.suppress(OSError):
            os.ftruncate(1, 0)
        publish("setup")
        reply = attempt(work, task, phases)
        publish("idle")
        _flush()
        _answer(line, reply)


def _answer(line: Connection, answer: WorkerAnswer) -> None:
    line.send_bytes(encode(answer))


def _print_to(output: str) -> None:
    """Send what Python and native code print to a file, so that no worker writes into the parent's table."""
    handle = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    os.dup2(handle, 1)
    os.dup2(handle, 2)
    os.close(handle)


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            stream.flush()


def _die_with_parent() -> None:
    """End this process when its parent is gone, where the kernel does not do it (anywhere but Linux)."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
