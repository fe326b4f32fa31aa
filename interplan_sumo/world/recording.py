"""A recording: real traffic as somebody measured it, one track per road user."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, Ints, frozen


@dataclass(frozen=True, eq=False)
class RecordedTrack:
    """One road user over consecutive steps, without gaps. Arrays are made read-only."""

    id: str
    kind: ActorKind
    length_m: float
    width_m: float
    first_step: int
    """The step of the recording at which it appears."""
    poses: Floats
    """(K, 3) x, y of the box centre in the map frame and heading, one row per step."""
    velocity_mps: Floats
    """(K, 2) in the map frame."""
    model: str = "car"
    """car, truck, bus or motorcycle for vehicles that move by an engine."""

    def __post_init__(self) -> None:
        for name, width in (("poses", 3), ("velocity_mps", 2)):
            array = frozen(getattr(self, name))
            if array.ndim != 2 or array.shape[1] != width or not len(array):
                raise ValueError(f"Track.{name} has shape {array.shape}, expected (K, {width})")
            if not np.isfinite(array).all():
                raise ValueError(f"Track.{name} of {self.id} holds a number that is not finite")
            object.__setattr__(self, name, array)
        if len(self.poses) != len(self.velocity_mps):
            raise ValueError(f"Track {self.id} has {len(self.poses)} poses and {len(self.velocity_mps)} velocities")

    @property
    def end_step(self) -> int:
        """The first step at which it is gone."""
        return self.first_step + len(self.poses)

    def at(self, step: int) -> int | None:
        """Row of a step, None where it is not there."""
        return step - self.first_step if self.first_step <= step < self.end_step else None


@dataclass(frozen=True, eq=False)
class Recording:
    """Tracks of all road users over one stretch of time, in the frame of one map."""

    name: str
    crs: str
    """Of the poses; the same as that of the map it belongs to."""
    step_s: float
    tracks: tuple[RecordedTrack, ...]
    """Sorted by id."""
    ego_id: str | None = None
    """The track of the car that measured, where there is one."""
    notes: tuple[str, ...] = ()
    """What could not be used, and what was assumed."""
    start_step: int = 0
    """Where scenes may begin; what lies before is the past of the ego."""
    map_name: str | None = None
    """The map that it was recorded on, where its file says so."""
    lights: Mapping[str, Ints] = field(default_factory=dict[str, Ints])
    """By connector of the map: (steps,) SignalStatus at each step, UNKNOWN where nothing was recorded."""

    @cached_property
    def steps(self) -> int:
        """How many steps the recording has."""
        return max((track.end_step for track in self.tracks), default=0)
