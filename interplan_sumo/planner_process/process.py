"""Planner process: a planner in a process of its own, reached by pipes: the seat that runs have by default.

Whatever it does to its process, to its pipes or to the messages in them is a PlannerError here, and after one that
leaves the channel in doubt the process and all that it started is gone.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, Self, TypeVar

from interplan_sumo.errors import (
    InputError,
    PlannerError,
    PlannerLoadError,
    PlannerOverdueError,
    ProcessRefusedError,
    clean_line,
)
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.planner_process.channel import CLOSED, ChannelError, Overdue, PlannerChannel
from interplan_sumo.planner_process.command import command_of
from interplan_sumo.planner_process.conversation import answer, ask, greeting_of
from interplan_sumo.planner_process.deaths import KilledWhileBuiltError, death, killed_from_outside
from interplan_sumo.planner_process.family import descendants, kill_family
from interplan_sumo.planner_process.map_message import map_request
from interplan_sumo.planner_process.messages import (
    FORMS,
    MOST_PLAN_BYTES,
    MOST_SAID_BYTES,
    Failed,
    Greeting,
    plan_request,
    start_request,
    trajectory,
)
from interplan_sumo.planner_seat import PlannerSeat, TimedPlan
from interplan_sumo.world.roads import Roads

MOST_MAPS: Final = 16
"""That a planner keeps."""
PATIENCE_S: Final = 2.0
"""How long a planner that is no longer asked may take to end."""
_LAUNCHER: Final = Path(__file__).with_name("launcher.py")
_R = TypeVar("_R")


@dataclass(frozen=True, slots=True)
class PlannerLimits:
    """What a planner may use. Wall clock, of which pauses of this machine are no part."""

    call_s: float = 10.0
    """One call of `start()`, `plan()` or `report()`."""
    load_s: float = 600.0
    """Building the planner, and taking a map."""
    memory_bytes: int | None = 8 << 30
    """Private memory; None for no limit. Linux only."""


class PlannerProcess(PlannerSeat):
    """A running planner. Close it; one that failed to answer as it should is closed already."""

    def __init__(self, name: str, command: Sequence[str], limits: PlannerLimits | None = None) -> None:
        """Start it and wait until it can drive; PlannerLoadError if it cannot. `name` is for messages."""
        if os.name != "posix":
            raise InputError("planners have processes of their own on POSIX systems only; give --in-process")
        self._name, self._limits = name, limits or PlannerLimits()
        self._maps: list[Roads | None] = [None] * MOST_MAPS
        self._next_map = 0
        self._told_past = self._told_time = False
        self._ended = False
        self.killed_from_outside = False
        """Whether somebody else ended it, an operator or the system: nobody knows how the drive would have gone on."""
        try:
            ours, theirs = _pipes()
        except OSError as error:
            raise _refused(name, error) from None
        launch = [sys.executable, "-I", "-S", str(_LAUNCHER), str(theirs[0]), str(theirs[1])]
        try:
            self._process = subprocess.Popen(
                [*launch, str(self._limits.memory_bytes or 0), str(os.getpid()), *command],
                stdin=subprocess.DEVNULL,
                stdout=theirs[2],
                stderr=subprocess.STDOUT,
                pass_fds=theirs[:2],
            )
        except OSError as error:
            for each in ours:
                os.close(each)
            raise _refused(name, error) from None
        finally:
            for each in theirs:
                os.close(each)
        self._channel = PlannerChannel(*ours, partial(_is_alive, self._process))
        self._finish = weakref.finalize(self, _finish, self._process, self._channel)
        try:
            greeting = self._greet()
        except BaseException:
            self._end()
            raise
        self._form, self._reports = FORMS[greeting.form], greeting.report

    @classmethod
    def of(cls, spec: str, limits: PlannerLimits | None = None) -> Self:
        """The planner that `run --planner` takes."""
        return cls(spec, command_of(spec), limits)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Let it end, and end it; so it goes, too, when nobody holds it any more."""
        if not self._ended:
            self._ended = True
            self._finish()

    @property
    def pid(self) -> int:
        """Of its process."""
        return self._process.pid

    @property
    def has_ended(self) -> bool:
        """Whether it cannot be asked any more."""
        return self._ended

    @property
    def printed(self) -> str:
        """The end of what it printed."""
        return self._channel.printed

    # --- the seat ----------------------------------------------------------------------------

    def start(self, mission: Mission) -> None:
        slot = self._sent(mission.roads)
        self._ask("start()", start_request(mission, slot), self._form.done)
        self._told_past = False

    def plan(self, observation: Observation) -> TimedPlan:
        return self._planned(observation)

    def plan_while(self, observation: Observation, meanwhile: Callable[[], object]) -> TimedPlan:
        # whoever does not tell its time has it taken by our clock, which must not count what else is done
        return self._planned(observation, meanwhile) if self._told_time else super().plan_while(observation, meanwhile)

    def _planned(self, observation: Observation, meanwhile: Callable[[], object] | None = None) -> TimedPlan:
        asked_s = time.perf_counter()
        request = plan_request(observation, self._form.pack, with_past=not self._told_past)
        reply = self._ask("plan()", request, self._form.plan, MOST_PLAN_BYTES, meanwhile=meanwhile)
        took_s = time.perf_counter() - asked_s
        self._told_past, self._told_time = True, reply.wall_s is not None
        try:
            plan = trajectory(reply)
        except ValueError as error:
            raise PlannerError(f"the plan is none: {error}") from None
        wall_s = took_s if reply.wall_s is None or not 0.0 <= reply.wall_s <= took_s else reply.wall_s
        return TimedPlan(plan, wall_s)

    def report(self) -> dict[str, Any] | None:
        if self._ended or not self._reports:
            return None
        return self._ask("report()", {"type": "report"}, self._form.report).report

    # --- the conversation --------------------------------------------------------------------

    def _sent(self, roads: Roads) -> int:
        """The number under which the planner has a map, which is sent if it has not."""
        for slot, held in enumerate(self._maps):
            if held is roads:
                return slot
        slot, self._next_map = self._next_map, (self._next_map + 1) % MOST_MAPS
        request = map_request(roads, slot, self._form.pack)
        self._ask("taking the map", request, self._form.done, limit_s=self._limits.load_s)
        self._maps[slot] = roads
        return slot

    def _greet(self) -> Greeting:
        """What it says first."""
        try:
            greeting = greeting_of(self._channel, self._limits.load_s)
        except ChannelError as error:
            why = self._broken("while it was built", error)
        else:
            if greeting.error is None:
                return greeting
            why = greeting.error
            if why.startswith("planner "):
                raise PlannerLoadError(clean_line(why))
        last = self._channel.printed.strip().splitlines()[-1:]
        said = f"; it printed last: {last[0]}" if last else ""
        kind = KilledWhileBuiltError if self.killed_from_outside else PlannerLoadError
        raise kind(clean_line(f"planner {self._name!r} could not be built: {why}{said}"))

    def _ask(
        self,
        what: str,
        request: dict[str, Any],
        read: Callable[[bytes], _R | Failed],
        most_bytes: int = MOST_SAID_BYTES,
        limit_s: float | None = None,
        meanwhile: Callable[[], object] | None = None,
    ) -> _R:
        """Send a request, do something else and wait for its reply."""
        if self._ended:
            raise PlannerError("its process has ended")
        limit_s = self._limits.call_s if limit_s is None else limit_s
        try:
            ask(self._channel, self._form, request, limit_s)
            if meanwhile is not None:
                meanwhile()
            reply = answer(self._channel, self._form, read, most_bytes, limit_s)
        except ChannelError as error:
            kind = PlannerOverdueError if isinstance(error, Overdue) else PlannerError
            raise kind(self._broken(what, error)) from None
        except BaseException:  # of what was done meanwhile: nobody will read the reply
            self._end()
            raise
        if isinstance(reply, Failed):
            raise PlannerError(clean_line(reply.message))
        return reply

    def _broken(self, what: str, error: ChannelError) -> str:
        """End it; what it did, in words."""
        if str(error) != CLOSED:
            self._end()
            return f"{what}: it {error}" if what.startswith("while") else f"{what} {error}"
        until_s = time.monotonic() + 1.0  # most often it is just about to end
        while _is_alive(self._process) and time.monotonic() < until_s:
            time.sleep(0.002)
        alive = _is_alive(self._process)
        exit_code = self._end()
        self.killed_from_outside = not alive and killed_from_outside(exit_code)
        inside = f" {what}" if what.startswith("while") else f" inside {what}"
        return f"its process {CLOSED if alive else death(exit_code)}{inside}"

    def _end(self) -> int:
        """Kill it and all that it started; how it had ended."""
        if not self._ended:
            self._ended = True
            self._finish.detach()
            _kill(self._process, self._channel)
        return self._process.wait()


def _is_alive(process: subprocess.Popen[bytes]) -> bool:
    """Whether it runs; it is not waited for, so that its number stays its own."""
    if not hasattr(os, "waitid"):
        return process.poll() is None
    with suppress(ChildProcessError):
        return os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None
    return False


def _finish(process: subprocess.Popen[bytes], channel: PlannerChannel) -> None:
    """Close the channel, give it the time to end by itself, and kill what is left."""
    family = descendants(process.pid)
    channel.close()
    until_s = time.monotonic() + PATIENCE_S
    while _is_alive(process) and time.monotonic() < until_s:
        time.sleep(0.005)
    _kill(process, channel, family)


def _kill(process: subprocess.Popen[bytes], channel: PlannerChannel, known: Mapping[int, int] | None = None) -> None:
    kill_family(process.pid, known=known)
    process.wait()
    channel.close()


def _refused(name: str, error: OSError) -> ProcessRefusedError:
    return ProcessRefusedError(
        f"cannot start a process for planner {name!r}: {error.strerror or error}; give fewer --workers, or repeat the "
        "command when the machine has room"
    )


def _pipes() -> tuple[tuple[int, int, int], tuple[int, int, int]]:
    """Our ends and the planner's: requests, replies, and what it prints. OSError without descriptors."""
    made: list[int] = []
    try:
        for _ in range(3):
            made += os.pipe()
    except OSError:
        for each in made:
            os.close(each)
        raise
    asked, ask, hear, told, read, printed = made
    return (ask, hear, read), (asked, told, printed)
