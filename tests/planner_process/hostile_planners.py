"""Planners that do to their process, and to whatever they can reach, what `how` says."""

from __future__ import annotations

import atexit
import builtins
import ctypes
import gc
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from interplan_planners.straight_ahead import StraightAhead
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory

REPLIES = 4


class Hostile(StraightAhead):
    """Drives as StraightAhead does, and misbehaves from its second plan on; marks go to the file `mark`."""

    def __init__(self, how: str, mark: str = "") -> None:
        super().__init__()
        self._how, self._mark = how, mark
        self._plans = 0
        if how == "raise while it is built":
            raise RuntimeError("no weights")
        if how == "exit while it is built":
            print("these are my last words", flush=True)
            os._exit(7)

    def start(self, mission: Mission) -> None:
        super().start(mission)
        if self._how == "raise in start":
            raise ValueError(f"no model for {mission.roads.name}")
        if self._how == "exit in start":
            os._exit(3)
        if self._how == "hang in start":
            time.sleep(600)

    def report(self) -> object:
        match self._how:
            case "raise in report":
                raise ValueError("nothing to say")
            case "exit in report":
                os._exit(0)
            case "hang in report":
                time.sleep(600)
            case "report a number":
                return 7
            case "report a surrogate":
                return {"text": "\ud800", "model": "\x1b[2J"}
            case "report what is no number":
                return {"loss": math.nan, "queries": -1}
            case "report a million texts":
                return {str(n): "x" * 100 for n in range(10_000)}
            case _:
                pass
        return None

    def plan(self, observation: Observation) -> Trajectory:
        self._plans += 1
        plan = super().plan(observation)
        odd = misbehave(self._how, observation, self._mark) if self._plans > 1 else None
        return plan if odd is None else odd


class UnspeakableError(Exception):
    def __str__(self) -> str:
        raise RuntimeError("I have no words")


def misbehave(how: str, observation: Observation, mark: str) -> Any:
    """One of the ways; what is returned is the plan."""
    ego = observation.ego
    match how:
        case "raise":
            raise ValueError("I cannot see")
        case "raise a surrogate":
            raise ValueError("\ud800\x1b[2J" + "x" * 10_000_000)
        case "raise without words":
            raise UnspeakableError
        case "raise an interrupt":
            raise KeyboardInterrupt
        case "raise the end of generators":
            raise GeneratorExit
        case "recurse":
            return misbehave(how, observation, mark)
        case "leave":
            sys.exit("enough")
        case "exit":
            os._exit(3)
        case "crash":
            ctypes.string_at(0)
        case "kill itself":
            os.kill(os.getpid(), signal.SIGKILL)
        case "be killed once":
            if not Path(mark).exists():
                Path(mark).touch()
                os.kill(os.getpid(), signal.SIGKILL)
        case "loop":
            while True:
                pass
        case "sleep in C":
            ctypes.CDLL(None).sleep(600)
        case "be deaf and loop":
            for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGALRM):
                signal.signal(number, signal.SIG_IGN)
            while True:
                time.sleep(1.0)
        case "stop itself":
            os.kill(os.getpid(), signal.SIGSTOP)
        case "fork":
            os.fork()
        case "fork and exit":
            if os.fork() == 0:
                time.sleep(600)
            os._exit(0)
        case "fork many":
            for _ in range(40):
                if os.fork() == 0:
                    time.sleep(600)
                    os._exit(0)
            raise RuntimeError("enough")
        case "leave a daemon":
            command = [sys.executable, "-S", "-c", "import time; time.sleep(600)"]
            daemon = subprocess.Popen(command, start_new_session=True)
            Path(mark).write_text(str(daemon.pid))
        case "close everything":
            os.closerange(0, 256)
        case "close what it prints to":
            os.closerange(1, 3)
        case "flood what it prints to":
            print("x" * 1_000_000)
        case "flood without end":
            while True:
                os.write(1, b"x" * 65536)
        case "babble":
            os.write(REPLIES, b"here I am" * 20)
        case "flood the channel":
            while True:
                os.write(REPLIES, b"\0\0\0\1" * 16384)
        case "lie about a length":
            os.write(REPLIES, (1 << 31).to_bytes(4, "little"))
            time.sleep(600)
        case "say half":
            os.write(REPLIES, (100).to_bytes(4, "little") + b"half")
            time.sleep(600)
        case "say half and exit":
            os.write(REPLIES, (100).to_bytes(4, "little") + b"half")
            os._exit(0)
        case "drip":
            os.write(REPLIES, (100_000).to_bytes(4, "little"))
            while True:
                os.write(REPLIES, b"x")
                time.sleep(0.01)
        case "forge a reply":
            os.write(REPLIES, (4).to_bytes(4, "little") + b"\x81\xa4type")
        case "nest":
            deep = b"\x91" * 60_000
            os.write(REPLIES, len(deep).to_bytes(4, "little") + deep)
        case "eat memory":
            return [np.empty(64 << 20) for _ in range(100)]
        case "leave threads":
            for _ in range(5):
                threading.Thread(target=time.sleep, args=(600,)).start()
        case "never end":
            atexit.register(time.sleep, 600)
        case "move the ego":
            object.__setattr__(ego, "x_m", ego.x_m + 100.0)
            object.__setattr__(observation.past.egos[-1], "x_m", 0.0)
            object.__setattr__(observation, "time_s", 0.0)
        case "write to the scene":
            for each in (observation.actors, observation.past.actors[0]):
                each.__dict__["x_m"] = np.zeros(len(each))
        case "signal who simulates":
            reached(lambda: os.kill(os.getppid(), signal.SIGCONT))
        case "write to who simulates":
            reached(lambda: os.open(f"/proc/{os.getppid()}/mem", os.O_RDWR))
        case "patch the score":
            import interplan_sumo.metrics.score as scoring

            scoring.score = lambda *_: 1.0  # type: ignore[assignment]
        case "patch the clock":
            import interplan_sumo.simulation.episode as episode

            episode.DT_S = 0.01
            episode.follow = lambda ego, *_: ego  # type: ignore[assignment]
        case "walk the frames":
            frame = sys._getframe()
            while frame is not None:
                for value in frame.f_locals.values():
                    if hasattr(value, "record") and hasattr(value, "goal_m"):
                        value.goal_m = 0.0
                frame = frame.f_back
            for thing in gc.get_objects():
                if type(thing).__name__ == "Loop":
                    thing.reached_goal = True
        case "break the interpreter":
            sys.modules.clear()
            os.getpid = lambda: 0
            raise RuntimeError("broken")
        case "return nothing":
            return 7
        case "return what is no number":
            plan = odd_plan(observation)
            plan.__dict__["x_m"] = np.full(len(plan), np.nan)
            return plan
        case "return texts":
            plan = odd_plan(observation)
            plan.__dict__["x_m"] = ["a"] * len(plan)
            return plan
        case "return columns of other lengths":
            plan = odd_plan(observation)
            plan.__dict__["x_m"] = np.zeros(3)
            return plan
        case "return far too much":
            many = np.arange(50_000.0)
            return Trajectory(observation.time_s + 1e-4 * many, many, many, many)
        case "lie about the length of a plan":
            plan = odd_plan(observation)
            plan.__dict__["x_m"] = Endless()
            return plan
        case "return complex numbers":
            time_s, x_m, y_m, heading_rad = odd_columns(observation)
            return Trajectory(time_s, x_m + 1j, y_m, heading_rad)  # type: ignore[arg-type]
        case "return masked numbers":
            time_s, x_m, y_m, heading_rad = odd_columns(observation)
            return Trajectory(time_s, np.ma.masked_array(x_m, mask=True), y_m, heading_rad)
        case "return a plan that raises":
            return Grim(*odd_columns(observation))
        case "exit when a plan is forgotten":
            return Haunted(*odd_columns(observation))
        case "replace what numbers are made by":
            builtins.float = lambda *_: 0.0  # type: ignore[assignment, misc]
            np.asarray = lambda *_, **__: np.zeros(3)  # type: ignore[assignment]
        case "jump":
            plan = odd_plan(observation)
            plan.__dict__["x_m"] = plan.x_m + 50.0
            return plan
        case _:
            pass
    return None


def reached(try_it: Callable[[], object]) -> None:
    with suppress(PermissionError):
        try_it()
        raise RuntimeError("it was reached")


class Endless(list[float]):
    """Says that it has more numbers than fit anywhere."""

    def __len__(self) -> int:
        return 1 << 40

    def __array__(self, *_: object, **__: object) -> Any:
        return np.lib.stride_tricks.as_strided(np.zeros(1), (1 << 30,), (0,))


class Grim(Trajectory):
    """Cannot be looked at."""

    def __getattribute__(self, name: str) -> Any:
        raise RuntimeError("look away")


class Haunted(Trajectory):
    """Takes its process with it."""

    def __del__(self) -> None:
        os._exit(9)


def odd_columns(observation: Observation) -> tuple[Floats, Floats, Floats, Floats]:
    ego, ahead_s = observation.ego, np.linspace(0.0, 4.0, 41)
    x_m, y_m = ego.x_m + ahead_s * ego.speed_mps, np.full(41, ego.y_m)
    return observation.time_s + ahead_s, x_m, y_m, np.zeros(41)


def odd_plan(observation: Observation) -> Trajectory:
    return Trajectory(*odd_columns(observation))
