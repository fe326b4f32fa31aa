"""Traffic: the seam between the closed loop and whoever moves the background."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final, Protocol

from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.signals import Signals

TRAFFIC_VERSION: Final = 3
"""Goes up with every change that can change a trace; drives of different versions are not compared."""


class EgoPresence(Enum):
    """What the ego of a run is to its traffic."""

    DRIVES = "drives"
    UNSEEN = "unseen"
    """Nobody meets it, all else is as if it drove: the twin run against which reactions are measured."""
    ABSENT = "absent"
    """Nor does anything of ours act on the agents: plain SUMO."""


@dataclass(frozen=True, eq=False)
class TrafficState:
    """What the background looks like at one instant."""

    actors: Actors
    signals: Signals
    ax_without_ego: Mapping[str, float] | None = None
    """Of those that braked in the step before because of the ego: the acceleration (m/s2) that their own models would
    have chosen without it, by id. None where nobody has a model to ask."""


class Traffic(Protocol):
    """Moves everything but the ego, 0.1 s at a time. One step is react, place_ego, advance."""

    @property
    def behaviours(self) -> Mapping[str, str]:
        """Behaviour type of each agent by its id; constant over the episode, never shown to planners."""
        ...

    @property
    def heights_m(self) -> Mapping[str, float]:
        """Heights of vehicles and obstacles by id, of all that there were up to now."""
        ...

    def observe(self) -> TrafficState:
        """The scene now."""
        ...

    def react(self, ego: EgoState) -> None:
        """Let each agent decide on the ego as it is now, before any moves."""
        ...

    def place_ego(self, ego: EgoState) -> None:
        """Put the ego where it will be after the step."""
        ...

    def advance(self) -> None:
        """Move everything by one step."""
        ...

    def close(self) -> None:
        """Free what was opened; may be called twice."""
        ...
