"""Actors: everything but the ego, one row per actor."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from operator import ge
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from interplan_sumo.world.geometry import Floats, box_corners, box_polygons, frozen


class ActorKind(IntEnum):
    """nuPlan's seven classes; the first three move by themselves."""

    VEHICLE = 0
    PEDESTRIAN = 1
    BICYCLE = 2
    TRAFFIC_CONE = 3
    BARRIER = 4
    CZONE_SIGN = 5
    GENERIC_OBJECT = 6

    @property
    def is_agent(self) -> bool:
        """Whether nuPlan counts it as an agent rather than a static object."""
        return self <= ActorKind.BICYCLE

    @property
    def words(self) -> str:
        """For people: `traffic cone`."""
        return self.name.lower().replace("_", " ")


ACTOR_COLUMNS = ("kind", "x_m", "y_m", "heading_rad", "length_m", "width_m", "vx_mps", "vy_mps")


@dataclass(frozen=True, eq=False)
class Actors:
    """Everything but the ego, at one instant: one row per actor.

    Positions are box centres in the map frame, metres. Headings are radians,
    counter-clockwise from +x. Velocities are in the map frame (not the car's).
    Rows are sorted by id. Arrays are made read-only.
    """

    ids: tuple[str, ...]
    kind: NDArray[np.int8]  # (N,) ActorKind
    x_m: Floats  # (N,)
    y_m: Floats  # (N,)
    heading_rad: Floats  # (N,)
    length_m: Floats  # (N,)
    width_m: Floats  # (N,)
    vx_mps: Floats  # (N,)
    vy_mps: Floats  # (N,)

    def __post_init__(self) -> None:
        for name in ACTOR_COLUMNS:
            array = frozen(getattr(self, name), np.int8 if name == "kind" else np.float64)
            if array.shape != (len(self.ids),):
                raise ValueError(f"Actors.{name} has shape {array.shape}, expected ({len(self.ids)},)")
            object.__setattr__(self, name, array)
        if any(map(ge, self.ids, self.ids[1:])):
            raise ValueError("Actors.ids must be unique and sorted")

    @classmethod
    def trusted(cls, ids: tuple[str, ...], *columns: NDArray[Any]) -> Actors:
        """Actors without the checks, for rows known to be good: sorted, columns in order of the fields."""
        actors = object.__new__(cls)
        actors.__dict__.update(zip(ACTOR_COLUMNS, columns, strict=True), ids=ids)  # this happens several times a step
        for column in columns:
            column.setflags(write=False)
        return actors

    @classmethod
    def none(cls) -> Actors:
        """An empty scene."""
        empty = np.zeros(0)
        return cls((), np.zeros(0, dtype=np.int8), empty, empty, empty, empty, empty, empty, empty)

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def speed_mps(self) -> Floats:
        """(N,) magnitude of the velocity."""
        return frozen(np.hypot(self.vx_mps, self.vy_mps))

    @cached_property
    def corners(self) -> Floats:
        """(N, 4, 2) box corners: front left, rear left, rear right, front right."""
        return frozen(box_corners(self.x_m, self.y_m, self.heading_rad, self.length_m, self.width_m))

    @cached_property
    def polygons(self) -> NDArray[np.object_]:
        """(N,) boxes as shapely polygons."""
        return box_polygons(self.x_m, self.y_m, self.heading_rad, self.length_m, self.width_m)

    def only(self, keep: ArrayLike) -> Actors:
        """The rows selected by a boolean mask (N,) or by increasing indices."""
        rows = np.asarray(keep)
        if rows.dtype == np.bool_:
            rows = rows.nonzero()[0]
        if len(rows) == len(self):
            return self
        known = self.__dict__
        columns = [known[name][rows] for name in ACTOR_COLUMNS]
        return Actors.trusted(tuple(map(self.ids.__getitem__, rows.tolist())), *columns)

    def within(self, x_m: float, y_m: float, radius_m: float) -> Actors:
        """The actors whose centre lies within `radius_m` of a point."""
        dx, dy = self.x_m - x_m, self.y_m - y_m
        return self.only(dx * dx + dy * dy <= radius_m * radius_m)
