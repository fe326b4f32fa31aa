"""Light cycles: what the traffic lights of a network show one after the other, from a moment on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, Self

from interplan_sumo.maps.network_file import FileProgram

SOON_S: Final = 2.5
"""A light that switches within this time is none to drive towards as if it stayed green."""


@dataclass(frozen=True, slots=True)
class Phase:
    """A part of a cycle."""

    index: int
    """In the light's program."""
    state: str
    """SUMO's letters, one per link."""
    duration_s: float


@dataclass(frozen=True)
class LightCycles:
    """The phases of each traffic light, in the order in which they come, over and over.

    The first one may have begun before; then what is over of it comes last.
    """

    phases: Mapping[str, tuple[Phase, ...]]

    @classmethod
    def of(cls, programs: Sequence[FileProgram]) -> Self:
        """From time 0 on; of several programs of a light SUMO runs the last. ValueError for one without phases."""
        found: dict[str, tuple[Phase, ...]] = {}
        for program in programs:
            if not program.phases:
                raise ValueError(f"traffic light {program.id} has no phase")
            phases = tuple(Phase(i, state, lasts_s) for i, (lasts_s, state) in enumerate(program.phases))
            found[program.id] = _later(phases, -program.offset_s)  # SUMO begins it at its offset
        return cls(found)

    def later(self, time_s: float) -> Self:
        """As they go on after a time."""
        if time_s == 0.0:
            return self
        return replace(self, phases={light: _later(phases, time_s) for light, phases in self.phases.items()})

    def beginning(self, states: Mapping[str, str]) -> Self:
        """With some lights at the beginning of a phase that has a state: of several the first in the program."""
        changed = dict(self.phases)
        for light, state in states.items():
            joined = _joined(self.phases[light])
            first = min((i for i, phase in enumerate(joined) if phase.state == state), key=lambda i: joined[i].index)
            changed[light] = (*joined[first:], *joined[:first])
        return replace(self, phases=changed)

    def states(self, light: str) -> tuple[str, ...]:
        """Those of a light, in the order in which they come."""
        return tuple(phase.state for phase in _joined(self.phases[light]))

    def at(self, light: str, time_s: float) -> str:
        """What a light shows after a time."""
        return _later(self.phases[light], time_s)[0].state

    @property
    def shown(self) -> dict[str, str]:
        """What each light shows first."""
        return {light: phases[0].state for light, phases in self.phases.items()}

    def stay_green(self, light: str, index: int) -> bool:
        """Whether a link's light is green at first, for it alone, and not about to switch."""
        first = self.phases[light][0]
        return first.state[index] == "G" and first.duration_s > SOON_S


NO_LIGHTS: Final = LightCycles({})


def _joined(phases: tuple[Phase, ...]) -> tuple[Phase, ...]:
    """With a first phase as it is when it begins."""
    first, last = phases[0], phases[-1]
    if len(phases) == 1 or first.index != last.index:
        return phases
    return (replace(first, duration_s=_rounded(first.duration_s + last.duration_s)), *phases[1:-1])


def _later(phases: tuple[Phase, ...], time_s: float) -> tuple[Phase, ...]:
    whole = _joined(phases)
    since_s = whole[0].duration_s - phases[0].duration_s + time_s
    over_s = _rounded(since_s) % sum(phase.duration_s for phase in whole)
    for at, phase in enumerate(whole):
        over_s = _rounded(over_s)
        if over_s < phase.duration_s:
            if over_s == 0.0:
                return (*whole[at:], *whole[:at])
            left = replace(phase, duration_s=_rounded(phase.duration_s - over_s))
            return (left, *whole[at + 1 :], *whole[:at], replace(phase, duration_s=over_s))
        over_s -= phase.duration_s
    return whole


def _rounded(time_s: float) -> float:
    """To SUMO's milliseconds."""
    return round(time_s, 3)
