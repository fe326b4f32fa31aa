"""Planners that do to a run what planners do: each named after its fault."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace

import numpy as np

from interplan_planners.straight_ahead import StraightAhead
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.trajectory import Trajectory


class NeverBegins(StraightAhead):
    def start(self, mission: Mission) -> None:
        raise ValueError(f"no model for {mission.roads.name}")


class Raises(StraightAhead):
    def plan(self, observation: Observation) -> Trajectory:
        print(f"at {observation.time_s:.1f} s")
        if observation.time_s > 0.95:
            raise ValueError("I cannot see")
        return super().plan(observation)


class ReturnsNan(StraightAhead):
    def plan(self, observation: Observation) -> Trajectory:
        plan = super().plan(observation)
        return replace(plan, x_m=np.full(len(plan), np.nan))


class Interrupted(StraightAhead):
    """The user's Ctrl-C, while it plans."""

    number = signal.SIGINT

    def plan(self, observation: Observation) -> Trajectory:
        signal.raise_signal(self.number)
        return super().plan(observation)


class Terminated(Interrupted):
    """A batch system's polite end, while it plans."""

    number = signal.SIGTERM


class Chatters(StraightAhead):
    def plan(self, observation: Observation) -> Trajectory:
        print("x" * 4000)
        return super().plan(observation)


class CannotBeBuilt(StraightAhead):
    def __init__(self) -> None:
        raise RuntimeError("no weights")


class Slow(StraightAhead):
    """Drives as StraightAhead does, but gives a test the time to interrupt it."""

    def plan(self, observation: Observation) -> Trajectory:
        time.sleep(0.003)
        return super().plan(observation)


class Leaves(StraightAhead):
    """Ends the process that it is in as a program does that is done, or dies in it."""

    def __init__(self, method: str = "plan", number: int = 0) -> None:
        super().__init__()
        self._method = method
        self._number = number
        if method == "__init__":
            self._leave()

    def start(self, mission: Mission) -> None:
        if self._method == "start":
            self._leave()
        super().start(mission)

    def plan(self, observation: Observation) -> Trajectory:
        if self._method == "plan":
            self._leave()
        return super().plan(observation)

    def _leave(self) -> None:
        print(f"{self._method} leaves")
        if self._number:
            os.kill(os.getpid(), self._number)
        os._exit(0)
