"""Actors: everything but the ego, one row per actor."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum
from functools import cached_property

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
        for column in fields(self)[1:]:
            dtype = np.int8 if column.name == "kind" else np.float64
            array = frozen(getattr(self, column.name), dtype)
            if array.shape != (len(self.ids),):
                raise ValueError(f"Actors.{column.name} has shape {array.shape}, expected ({len(self.ids)},)")
            object.__setattr__(self, column.name, array)
        if any(a >= b for a, b in zip(self.ids, self.ids[1:], strict=False)):
            raise ValueError("Actors.ids must be unique and sorted")

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
        rows = np.arange(len(self))[np.asarray(keep)]
        columns = {c.name: getattr(self, c.name)[rows] for c in fields(self)[1:]}
        return Actors(tuple(self.ids[i] for i in rows), **columns)

    def within(self, x_m: float, y_m: float, radius_m: float) -> Actors:
        """The actors whose centre lies within `radius_m` of a point."""
        return self.only(np.hypot(self.x_m - x_m, self.y_m - y_m) <= radius_m)
