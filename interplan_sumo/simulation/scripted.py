"""Traffic that follows a script: cars on rails, blind to the ego. For tests of the loop, of planners and of metrics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from interplan_sumo.simulation.traffic import TrafficState
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.signals import Signals


@dataclass(frozen=True, slots=True, eq=False)
class ScriptedActor:
    """An actor that moves along a line at constant speed and stands at its end."""

    id: str
    line: Polyline
    arc_m: float = 0.0
    """Where its centre starts on the line."""
    speed_mps: float = 0.0
    kind: ActorKind = ActorKind.VEHICLE
    length_m: float = 4.6
    width_m: float = 1.85
    behaviour: str = "scripted"


class ScriptedTraffic:
    """Traffic from a list of scripted actors and, if wanted, fixed signals."""

    def __init__(self, actors: Sequence[ScriptedActor] = (), signals: Signals | None = None, dt_s: float = 0.1) -> None:
        self._actors = sorted(actors, key=lambda actor: actor.id)
        self._signals = signals if signals is not None else Signals.none()
        self._dt_s = dt_s
        self._step = 0

    @property
    def behaviours(self) -> Mapping[str, str]:
        return {actor.id: actor.behaviour for actor in self._actors}

    def observe(self) -> TrafficState:
        rows: list[tuple[float, float, float, float, float]] = []
        for actor in self._actors:
            arc_m = actor.arc_m + actor.speed_mps * self._dt_s * self._step
            pose = actor.line.pose_at(arc_m)
            speed_mps = actor.speed_mps if arc_m < actor.line.length_m else 0.0
            velocity = speed_mps * np.cos(pose.heading_rad), speed_mps * np.sin(pose.heading_rad)
            rows.append((pose.x_m, pose.y_m, pose.heading_rad, *velocity))
        x, y, heading, vx, vy = np.array(rows, dtype=np.float64).reshape(-1, 5).T
        actors = Actors(
            ids=tuple(actor.id for actor in self._actors),
            kind=np.array([actor.kind for actor in self._actors], dtype=np.int8),
            x_m=x,
            y_m=y,
            heading_rad=heading,
            length_m=np.array([actor.length_m for actor in self._actors]),
            width_m=np.array([actor.width_m for actor in self._actors]),
            vx_mps=vx,
            vy_mps=vy,
        )
        return TrafficState(actors, self._signals)

    def react(self, ego: EgoState) -> None:
        """Nobody reacts."""

    def place_ego(self, ego: EgoState) -> None:
        """Nobody looks."""

    def advance(self) -> None:
        self._step += 1

    def close(self) -> None:
        """Nothing is open."""
