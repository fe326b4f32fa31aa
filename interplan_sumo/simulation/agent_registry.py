"""The background agents of an episode: their types and routes, the ids under which others see them, and where they are.

SUMO knows an agent by its name, everyone else by its token.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from interplan_sumo.simulation.agent_kinematics import AgentKinematics
from interplan_sumo.simulation.pedestrians import People
from interplan_sumo.simulation.vehicle_types import ENTRY, VehicleType
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.geometry import Floats

_KINDS = {"pedestrian": ActorKind.PEDESTRIAN, "bicycle": ActorKind.BICYCLE}


class AgentSnapshot(NamedTuple):
    """All agents at one instant, in SUMO's frame: what the decisions about the ego are made from."""

    names: Sequence[str]
    rows: Mapping[str, int]
    """By name."""
    front_x: Floats  # (N,)
    front_y: Floats  # (N,)
    heading_rad: Floats  # (N,)
    speed_mps: Floats  # (N,)
    turned_rad: Mapping[int, float]
    """As in `AgentKinematics`."""
    displaced: frozenset[int]
    """Rows of cars that are elsewhere than where SUMO has them."""
    lanes: Callable[[Sequence[str]], list[str]]
    """The SUMO lanes of agents, '' is nowhere; asked for only when they may have to react."""
    positions_m: Callable[[Sequence[str]], list[float]]
    """Lane positions of the front bumpers of agents."""
    choice: Callable[[str], Sequence[str]]
    """The SUMO lanes that an agent means to take, from its own on; asked for only where a lane leads to several."""


class AgentRegistry:
    """All agents; obstacles and pedestrians are seen with them."""

    def __init__(
        self, types_file: Path, standing: Actors, crowd: People | None, origin_m: tuple[float, float], dt_s: float
    ) -> None:
        self.names: list[str] = []
        """Of the agents that are there, in the order of their tokens; a new list whenever an agent comes or goes."""
        self.rows: dict[str, int] = {}
        """By name."""
        self.drivers: dict[str, VehicleType] = {}
        self.routes: dict[str, tuple[str, ...]] = {}
        self.behaviours: dict[str, str] = {}
        """Name of the vehicle type by token, of all that have been there."""
        self.heights_m: dict[str, float] = {}
        """By token."""
        self.kinematics = AgentKinematics(dt_s)
        self.length_m: Floats = np.zeros(0)
        """(N,) of the agents that are there."""
        self.width_m: Floats = np.zeros(0)
        self._behaviour_of_entry = types_file.stem
        self._standing = standing
        self._crowd = crowd
        self._origin = origin_m
        self._tokens: dict[str, str] = {}
        self._index()

    @property
    def front_x(self) -> Floats:
        """(N,) middle of the front bumper, in SUMO's frame."""
        return self.kinematics.front_m[:, 0]

    @property
    def front_y(self) -> Floats:
        return self.kinematics.front_m[:, 1]

    def add(self, name: str, token: str, driver: VehicleType, route: tuple[str, ...]) -> None:
        """Know an agent that is about to enter."""
        self._tokens[name] = token
        self.drivers[name] = driver
        self.routes[name] = route

    def token_of(self, name: str) -> str:
        """The id under which others see an agent."""
        return self._tokens[name]

    def enter(self, names: Collection[str]) -> None:
        """These, which were added before, are there from now on."""
        self.names = sorted([*self.names, *names], key=self._tokens.__getitem__)
        rows = [row for row, name in enumerate(self.names) if name in names]
        for row in rows:
            name, driver = self.names[row], self.drivers[self.names[row]]
            self.behaviours[self._tokens[name]] = self._behaviour_of_entry if driver.name == ENTRY else driver.name
            self.heights_m[self._tokens[name]] = driver.height_m
        self.kinematics.insert(rows)
        self._index()

    def remove(self, names: Collection[str]) -> None:
        """These have left."""
        self.kinematics.keep([name not in names for name in self.names])
        self.names = [name for name in self.names if name not in names]
        self._index()

    def move(self, front_m: ArrayLike, angle_deg: ArrayLike, speed_mps: ArrayLike) -> None:
        """Take over SUMO's positions, navigation angles and speeds after a step; some keep beside the middle."""
        if self._left_m is not None:
            angle_rad = np.radians(np.asarray(angle_deg, dtype=np.float64))
            aside_m = np.stack((-np.cos(angle_rad), np.sin(angle_rad)), axis=1) * self._left_m[:, None]
            front_m = np.asarray(front_m, dtype=np.float64).reshape(-1, 2) + aside_m
        self.kinematics.move(front_m, angle_deg, speed_mps, self.length_m)

    def notice_people(self) -> None:
        """Other pedestrians than before are there."""
        self._index()

    def _index(self) -> None:
        """Columns that do not change from step to step."""
        self.rows = {name: row for row, name in enumerate(self.names)}
        drivers = [self.drivers[name] for name in self.names]
        self.length_m = np.array([d.length_m for d in drivers], dtype=np.float64)
        self.width_m = np.array([d.width_m for d in drivers], dtype=np.float64)
        self._half_m = self.length_m / 2.0
        left_m = np.array([d.left_m for d in drivers], dtype=np.float64)
        self._left_m = left_m if left_m.any() else None
        pedestrians = self._crowd.observe() if self._crowd is not None else Actors.none()
        others = (self._standing, pedestrians)
        tokens = [*(self._tokens[name] for name in self.names), *self._standing.ids, *pedestrians.ids]
        self._order = np.argsort(np.array(tokens, dtype=object), kind="stable")
        self._in_order = len(tokens) == len(self.names)
        self._ids_in_order = tuple(tokens[i] for i in self._order)
        kinds = np.array([_KINDS.get(d.vehicle_class, ActorKind.VEHICLE) for d in drivers], dtype=np.int8)
        self._kinds = np.concatenate((kinds, *(a.kind for a in others)))[self._order]
        self._lengths_m = np.concatenate((self.length_m, *(a.length_m for a in others)))[self._order]
        self._widths_m = np.concatenate((self.width_m, *(a.width_m for a in others)))[self._order]

    def snapshot(
        self,
        lanes: Callable[[Sequence[str]], list[str]],
        positions_m: Callable[[Sequence[str]], list[float]],
        choice: Callable[[str], Sequence[str]],
    ) -> AgentSnapshot:
        """All agents now; `lanes`, `positions_m` and `choice` ask SUMO."""
        moving = self.kinematics
        return AgentSnapshot(
            self.names, self.rows, self.front_x, self.front_y, moving.heading_rad, moving.speed_mps, moving.turned_rad,
            moving.displaced, lanes, positions_m, choice,
        )  # fmt: skip

    def actors(self) -> Actors:
        """Everyone and everything as others see them, rows sorted by id."""
        heading_rad, speed_mps, half_m = self.kinematics.heading_rad, self.kinematics.speed_mps, self._half_m
        cosine, sine = self.kinematics.cosine, self.kinematics.sine
        columns = [
            self.front_x + self._origin[0] - half_m * cosine,
            self.front_y + self._origin[1] - half_m * sine,
            heading_rad,
            speed_mps * cosine,
            speed_mps * sine,
        ]
        if not self._in_order:
            others = (self._standing, self._crowd.observe()) if self._crowd is not None else (self._standing,)
            names = ("x_m", "y_m", "heading_rad", "vx_mps", "vy_mps")
            rest = ([getattr(actors, name) for actors in others] for name in names)
            columns = [np.concatenate((c, *more))[self._order] for c, more in zip(columns, rest, strict=True)]
        x_m, y_m, heading_rad, vx_mps, vy_mps = columns
        return Actors.trusted(
            self._ids_in_order, self._kinds, x_m, y_m, heading_rad, self._lengths_m, self._widths_m, vx_mps, vy_mps
        )
