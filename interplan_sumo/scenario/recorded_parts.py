"""What a recording adds to a scenario, as frozen data: road users that are replayed, lights, and the ego's past."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from math import isfinite
from typing import Final, Literal

from interplan_sumo.errors import ScenarioError
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.signals import SignalStatus

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
TRACK_COLUMNS = ("x_m", "y_m", "heading_rad", "vx_mps", "vy_mps")


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
        _check_columns(self, TRACK_COLUMNS, what, len(self.x_m), " as x_m has")

    @property
    def end_step(self) -> int:
        """The first step at which it is gone."""
        return self.first_step + len(self.x_m)


# --- lights --------------------------------------------------------------------------------------

LightStatus = Literal["green", "yellow", "red", "unknown"]
STATUS: dict[str, SignalStatus] = {status.name.lower(): status for status in SignalStatus}
"""nuPlan's code of each status."""


@dataclass(frozen=True, slots=True)
class LoggedLight:
    """What one connector shows, whatever SUMO's own program would: from each of `steps` on, until the next one.

    ScenarioError names the column that cannot be.
    """

    connector: str
    steps: tuple[int, ...]
    """Steps of the drive, 0.1 s each, at which the status changes; the first is 0."""
    shows: tuple[LightStatus, ...]
    """The status from each of them on. Unknown: the recording says nothing; the light is off, drivers yield."""

    def __post_init__(self) -> None:
        what = f"logged light of connector {self.connector!r}"
        if not self.steps or self.steps[0] != 0:
            raise ScenarioError(f"{what}: steps begins with {list(self.steps[:1])}, expected 0, the start of the drive")
        if any(after <= before for before, after in zip(self.steps, self.steps[1:], strict=False)):
            raise ScenarioError(f"{what}: steps do not increase")
        if len(self.shows) != len(self.steps):
            raise ScenarioError(f"{what}: shows has {len(self.shows)} entries, expected {len(self.steps)} as steps has")
        for shown in self.shows:
            if shown not in STATUS:
                raise ScenarioError(f"{what}: shows {shown!r}, expected one of {', '.join(STATUS)}")

    def at(self, step: int) -> SignalStatus:
        """What it shows at a step of the drive, 0 or later."""
        return STATUS[self.shows[bisect_right(self.steps, step) - 1]]


# --- the ego's past -------------------------------------------------------------------------------

PAST_STEPS: Final = 20
"""2 s: with the present 21 samples."""
PAST_COLUMNS: Final = ("x_m", "y_m", "heading_rad", "speed_mps")


@dataclass(frozen=True, slots=True)
class EgoPast:
    """The ego at the 20 instants before the start, 0.1 s apart, oldest first. ScenarioError names what cannot be."""

    x_m: tuple[float, ...]
    """Of the box centre in the map frame, as y_m."""
    y_m: tuple[float, ...]
    heading_rad: tuple[float, ...]
    speed_mps: tuple[float, ...]
    """Along the heading."""

    def __post_init__(self) -> None:
        _check_columns(self, PAST_COLUMNS, "past", PAST_STEPS, ", 0.1 s apart")


def _check_columns(held: ReplayedTrack | EgoPast, names: tuple[str, ...], what: str, length: int, why: str) -> None:
    """ScenarioError names the column that has another length or holds a number that is not finite."""
    for name in names:
        column: tuple[float, ...] = getattr(held, name)
        if len(column) != length:
            raise ScenarioError(f"{what}: {name} has {len(column)} numbers, expected {length}{why}")
        if not all(map(isfinite, column)):
            raise ScenarioError(f"{what}: {name} holds a number that is not finite")
