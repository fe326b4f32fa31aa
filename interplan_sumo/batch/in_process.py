"""In process: tasks without workers, so that breakpoints and prints of a planner reach the user."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Generator, Sequence
from types import FrameType
from typing import Any

from interplan_sumo.batch.tasks import TRAFFIC_RETRIES, Fault, Limits, OpenGroup, Outcome, SharedPhase, Task
from interplan_sumo.batch.worker import attempt
from interplan_sumo.errors import InputError


class Overrun(BaseException):
    """Raised inside a task by the alarm; not an Exception, so that no planner swallows it by accident."""


def run_in_process(tasks: Sequence[Task], open_group: OpenGroup, limits: Limits) -> Generator[Outcome]:
    """As `engine.run_tasks`, in this process and one after the other.

    Limits are kept by an alarm signal, where there is one and this is the main
    thread; they rest while a debugger is at work. A crash is not survived.
    """
    phases = SharedPhase([0, 0])
    home = os.getpid()
    with _Alarm(limits) as alarm, _Interrupts() as interrupts:

        def publish(phase: str) -> None:
            if os.getpid() != home:  # a planner forked, and its copy came back from plan()
                os._exit(0)
            phases.publish(phase)
            alarm.phase(phase)

        works: dict[str, Any] = {}
        for group in dict.fromkeys(task.group for task in tasks):
            works[group] = open_group(group, publish)
        for task in tasks:
            retries_left = TRAFFIC_RETRIES
            while True:
                began_s = time.monotonic()
                alarm.begin()
                publish("setup")
                reply = attempt(works[task.group], task.payload, phases)
                publish("idle")
                if interrupts.seen:
                    raise KeyboardInterrupt
                if reply.input_error is not None:
                    raise InputError(reply.input_error)
                fault = reply.fault
                if alarm.overrun is not None:
                    phase, reason = alarm.overrun
                    fault = Fault("planner", reason) if phase == "plan" else Fault("timeout", f"{reason} ({phase})")
                if fault is None or fault.kind != "traffic" or not retries_left:
                    break
                retries_left -= 1
            yield Outcome(task, reply.value, fault, time.monotonic() - began_s, reply.traceback)
            if fault is not None:  # what a fault leaves behind must not reach the next task
                works[task.group] = open_group(task.group, publish)


def alarm_works() -> bool:
    """Whether this thread can be woken from a call that takes too long."""
    return hasattr(signal, "SIGALRM") and threading.current_thread() is threading.main_thread()


class _Alarm:
    """Wakes a task that is over its limit with `Overrun`."""

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self.overrun: tuple[str, str] | None = None
        self._phase = "idle"
        self._deadline_s = float("inf")
        self._works = alarm_works()
        self._before: Any = None

    def __enter__(self) -> _Alarm:
        if self._works:
            self._before = signal.signal(signal.SIGALRM, self._ring)
        return self

    def __exit__(self, *error: object) -> None:
        if self._works:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, self._before)

    def begin(self) -> None:
        """A new task."""
        self.overrun = None
        self._deadline_s = time.monotonic() + self.limits.task_s

    def phase(self, name: str) -> None:
        """A new phase: set the alarm for whichever limit comes first."""
        self._phase = name
        if not self._works:
            return
        left_s = 0.0 if name in ("idle", "load") else max(self._deadline_s - time.monotonic(), 1e-3)
        if name == "plan":
            left_s = min(left_s, self.limits.plan_s)
        signal.setitimer(signal.ITIMER_REAL, left_s if left_s < 1e9 else 0.0)

    def _ring(self, _signal: int, _frame: FrameType | None) -> None:
        if _debugged():
            return
        reason = f"no result after {self.limits.task_s:g} s"
        if self._phase == "plan" and time.monotonic() < self._deadline_s:
            reason = f"plan() took longer than {self.limits.plan_s:g} s"
        self.overrun = (self._phase, reason)
        raise Overrun(reason)


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


def _debugged() -> bool:
    """Whether somebody is stepping through the code: pdb traces, newer debuggers use sys.monitoring."""
    trace = sys.gettrace()
    if trace is not None and not type(getattr(trace, "__self__", trace)).__module__.startswith("coverage"):
        return True
    monitoring = getattr(sys, "monitoring", None)
    return monitoring is not None and monitoring.get_tool(monitoring.DEBUGGER_ID) is not None
