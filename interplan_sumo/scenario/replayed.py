"""ReplayedTrack: a recorded road user as frozen data, one row per 0.1 s of the drive."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Literal

from interplan_sumo.errors import ScenarioError
from interplan_sumo.world.actors import ActorKind

ReplayedKind = Literal["vehicle", "pedestrian", "bicycle", "cone", "barrier", "sign", "object"]
REPLAYED: dict[str, ActorKind] = {
    "vehicle": ActorKind.VEHICLE,
    "pedestrian": ActorKind.PEDESTRIAN,
    "bicycle": ActorKind.BICYCLE,
    "cone": ActorKind.TRAFFIC_CONE,
    "barrier": ActorKind.BARRIER,
    "sign": ActorKind.CZONE_SIGN,
    "object": ActorKind.GENERIC_OBJECT,
}
"""nuPlan's class of each kind."""
COLUMNS = ("x_m", "y_m", "heading_rad", "vx_mps", "vy_mps")


@dataclass(frozen=True, slots=True)
class ReplayedTrack:
    """Where one road user is at each step: it appears at `first_step` and is gone after its last row.

    All columns have one length. ScenarioError names the column that cannot be.
    """

    id: str
    """Of the recording; planners see another one."""
    kind: ReplayedKind
    length_m: float
    width_m: float
    first_step: int
    """Step of the drive, 0 is its start."""
    x_m: tuple[float, ...]
    """Of the box centre in the map frame, as y_m."""
    y_m: tuple[float, ...]
    heading_rad: tuple[float, ...]
    vx_mps: tuple[float, ...]
    """In the map frame, as vy_mps."""
    vy_mps: tuple[float, ...]

    def __post_init__(self) -> None:
        what = f"replayed track {self.id!r}"
        if self.kind not in REPLAYED:
            raise ScenarioError(f"{what}: kind is {self.kind!r}, expected one of {', '.join(REPLAYED)}")
        for name in ("length_m", "width_m"):
            if not (isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ScenarioError(f"{what}: {name} is {getattr(self, name)}, expected positive metres")
        if self.first_step < 0:
            raise ScenarioError(f"{what}: first_step is {self.first_step}, expected 0 or more")
        if not self.x_m:
            raise ScenarioError(f"{what}: x_m is empty, expected a number for each step")
        for name in COLUMNS:
            column: tuple[float, ...] = getattr(self, name)
            if len(column) != len(self.x_m):
                raise ScenarioError(f"{what}: {name} has {len(column)} numbers, expected {len(self.x_m)} as x_m has")
            if not all(map(isfinite, column)):
                raise ScenarioError(f"{what}: {name} holds a number that is not finite")

    @property
    def end_step(self) -> int:
        """The first step at which it is gone."""
        return self.first_step + len(self.x_m)
