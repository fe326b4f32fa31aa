"""In process: tasks without workers, so that breakpoints and prints of a planner reach the user."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Generator, Sequence
from types import FrameType
from typing import Any

from interplan_sumo.batch.tasks import TRAFFIC_RETRIES, OpenGroup, Outcome, SharedPhase, Task
from interplan_sumo.batch.worker import attempt
from interplan_sumo.errors import InputError


def run_in_process(tasks: Sequence[Task], open_group: OpenGroup) -> Generator[Outcome]:
    """As `engine.run_tasks`, in this process and one after the other.

    Nobody keeps limits, and a crash is not survived.
    """
    phases = SharedPhase([0])
    home = os.getpid()
    with _Interrupts() as interrupts:

        def publish(phase: str) -> None:
            if os.getpid() != home:  # a planner forked, and its copy came back from plan()
                os._exit(0)
            phases.publish(phase)

        works: dict[str, Any] = {}
        for group in dict.fromkeys(task.group for task in tasks):
            works[group] = open_group(group, publish)
        for task in tasks:
            retries_left = TRAFFIC_RETRIES
            while True:
                began_s = time.monotonic()
                publish("setup")
                reply = attempt(works[task.group], task.payload, phases)
                publish("idle")
                if interrupts.seen:
                    raise KeyboardInterrupt
                if reply.input_error is not None:
                    raise InputError(reply.input_error)
                fault = reply.fault
                if fault is None or fault.kind != "traffic" or not retries_left:
                    break
                retries_left -= 1
            yield Outcome(task, reply.value, fault, time.monotonic() - began_s, reply.traceback)
            if fault is not None:  # what a fault leaves behind must not reach the next task
                works[task.group] = open_group(task.group, publish)


class _Interrupts:
    """Tells the user's Ctrl-C from a KeyboardInterrupt that a planner raises."""

    def __init__(self) -> None:
        self.seen = False
        self._before: Any = None

    def __enter__(self) -> _Interrupts:
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, *error: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _note(self, _signal: int, _frame: FrameType | None) -> None:
        self.seen = True
        raise KeyboardInterrupt
