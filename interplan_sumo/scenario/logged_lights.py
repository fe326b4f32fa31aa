"""LoggedLight: what a connector's traffic light showed in a recording, as frozen data."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import Literal

from interplan_sumo.errors import ScenarioError
from interplan_sumo.world.signals import SignalStatus

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
