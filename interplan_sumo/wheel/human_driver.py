"""Human driver: somebody at the keys as a planner: sees what planners see, plans what hands say, in real time."""

from __future__ import annotations

import time
from dataclasses import dataclass
from math import atan
from typing import Any, Final, Literal

import numpy as np

from interplan_sumo.planner import Mission, Observation
from interplan_sumo.policy import (
    HARDEST_BRAKE_MPS2,
    HARDEST_PUSH_MPS2,
    LARGEST_TIRE_ANGLE_RAD,
    plan_of,
    speed_limit_mps,
)
from interplan_sumo.report.replay.agents_timeline import KIND_LOOKS
from interplan_sumo.report.replay.drawn_scene import DrawnScene
from interplan_sumo.wheel.cockpit import Act, Cockpit
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.signals import Signals
from interplan_sumo.world.trace import EgoTrack
from interplan_sumo.world.trajectory import Trajectory

SIDEWAYS_MPS2: Final = 4.0
"""Wheels turned all the way do not make for more at any speed; nuPlan's bound of comfort is 4.89."""
TURN_RATE_RADPS: Final = 0.8
"""How fast hands turn the wheels."""
JERK_MPS3: Final = 12.0
"""How fast feet change the acceleration, but for the hardest braking, which comes at once."""
HARD_MPS2: Final = 5.0
SAME_M: Final = 1e-3
"""How far the ego may be from the stored drive where a person takes it over."""


@dataclass(frozen=True, eq=False)
class Handover:
    """A stored drive up to the moment when a person takes it over."""

    planner: str
    plans: tuple[Trajectory, ...]
    """Of the frames before that."""
    track: EgoTrack

    @property
    def frame(self) -> int:
        return len(self.plans)


def largest_turn_rad(speed_mps: float, shape: EgoShape) -> float:
    """The tyre angle that full steering means at a speed."""
    return min(LARGEST_TIRE_ANGLE_RAD, atan(shape.wheelbase_m * SIDEWAYS_MPS2 / max(speed_mps, 0.1) ** 2))


class HumanDriver:
    """The planner `human`: one plan each 0.1 s of real time, from what the hands hold then.

    The drive waits until the person starts, and while they pause or no page is
    open. `left` says why a drive has no end.
    """

    def __init__(
        self, cockpit: Cockpit, scene: DrawnScene, route: Polyline, *, rate: float = 1.0, handover: Handover | None
    ) -> None:
        """`rate` 0.5 is slow motion; `route` leads to the goal; a drive is taken over where a `handover` ends."""
        self._cockpit = cockpit
        self._scene = scene
        self._route = route
        self._rate = rate
        self._handover = handover
        self.left: Literal["", "restart", "quit", "differs"] = ""

    def start(self, mission: Mission) -> None:
        self._mission = mission
        self._frame = 0
        self._held = (0.0, 0.0)  # acceleration and tyre angle of the last plan
        self._due_s = 0.0
        self._used = 0
        self._lights: dict[str, int] = {}
        self.left = ""

    def plan(self, observation: Observation) -> Trajectory:
        frame = self._frame
        self._frame += 1
        self._show(frame, observation)
        before = self._handover
        if before is not None and frame < before.frame:
            return before.plans[frame]
        if before is not None and frame == before.frame:
            away_m = np.hypot(
                before.track.x_m[frame] - observation.ego.x_m, before.track.y_m[frame] - observation.ego.y_m
            )
            if away_m > SAME_M:
                self._leave("differs")
        if frame == (before.frame if before else 0):
            self._wait("ready")
        self._keep_time()
        return self._planned(observation)

    # --- time ---

    def _keep_time(self) -> None:
        """Wait until this step is due, and as long as the drive is paused."""
        while True:
            if not self._cockpit.watched:
                self._wait("paused")
            act = self._cockpit.next_act(self._due_s)
            if act is None:
                break
            self._answer(act)
        # who was late does not hurry afterwards
        self._due_s = max(self._due_s, time.monotonic() - 0.02) + self._mission.dt_s / self._rate

    def _wait(self, why: Literal["ready", "paused"]) -> None:
        """Until the person goes on."""
        self._cockpit.tell(why)
        while (act := self._cockpit.next_act()) not in ("start", "pause"):
            if act is not None:
                self._answer(act)
        self._cockpit.tell("driving")
        self._due_s = time.monotonic()

    def _answer(self, act: Act) -> None:
        if act == "pause":
            self._wait("paused")
        elif act in ("restart", "quit"):
            self._leave(act)

    def _leave(self, why: Literal["restart", "quit", "differs"]) -> None:
        self.left = why
        self._cockpit.leave()

    # --- what the hands mean ---

    def _planned(self, observation: Observation) -> Trajectory:
        hands, ego, shape, dt_s = self._cockpit.hands, observation.ego, self._mission.shape, self._mission.dt_s
        self._used = hands.number
        wanted_mps2 = hands.push * (HARDEST_PUSH_MPS2 if hands.push > 0.0 else HARDEST_BRAKE_MPS2)
        wanted_rad = hands.turn * largest_turn_rad(ego.speed_mps, shape)
        before_mps2, before_rad = self._held
        if wanted_mps2 > -HARD_MPS2:
            wanted_mps2 = _towards(before_mps2, wanted_mps2, JERK_MPS3 * dt_s)
        self._held = (wanted_mps2, _towards(before_rad, wanted_rad, TURN_RATE_RADPS * dt_s))
        push = wanted_mps2 / (HARDEST_PUSH_MPS2 if wanted_mps2 > 0.0 else HARDEST_BRAKE_MPS2)
        action = np.array([push, self._held[1] / LARGEST_TIRE_ANGLE_RAD], dtype=np.float32)
        return plan_of(action, ego, "acceleration_steering", shape)

    # --- what the person sees ---

    def _show(self, frame: int, observation: Observation) -> None:
        ego, (x0_m, y0_m) = observation.ego, self._scene.origin.tolist()
        self._cockpit.tell(
            "frame",
            frame=frame,
            number=self._used,
            ego=[round(float(ego.x_m - x0_m), 3), round(float(ego.y_m - y0_m), 3), round(float(ego.heading_rad), 4)],
            speed_mps=round(float(ego.speed_mps), 2),
            limit_mps=speed_limit_mps(self._mission.roads, ego),
            largest_turn_rad=round(largest_turn_rad(ego.speed_mps, self._mission.shape), 4),
            to_goal_m=round(self._route.length_m - self._route.project_point(ego.x_m, ego.y_m)[0], 1),
            agents=self._agents(observation),
            lights=self._changed_lights(observation.signals),
        )

    def _agents(self, observation: Observation) -> list[list[Any]]:
        """Of each: id, look, a word, length, width, x, y, heading, speed."""
        seen, (x0_m, y0_m) = observation.actors, self._scene.origin.tolist()
        found: list[list[Any]] = []
        for row, name in enumerate(seen.ids):
            look, word = KIND_LOOKS.get(ActorKind(int(seen.kind[row])), ("vehicle", "vehicle"))
            numbers = (
                (seen.length_m[row], 2), (seen.width_m[row], 2), (seen.x_m[row] - x0_m, 3), (seen.y_m[row] - y0_m, 3),
                (seen.heading_rad[row], 4), (seen.speed_mps[row], 2),
            )  # fmt: skip
            found.append([name, look, word, *(round(float(value), digits) for value, digits in numbers)])
        return found

    def _changed_lights(self, signals: Signals) -> dict[str, int]:
        now = dict(zip(signals.connector_ids, signals.status.tolist(), strict=True))
        drawn = self._scene.fields["lights"]
        changed = {name: status for name, status in now.items() if name in drawn and self._lights.get(name) != status}
        self._lights |= changed
        return changed


def _towards(now: float, wanted: float, most: float) -> float:
    return now + min(most, max(-most, wanted - now))
