"""Lights: SUMO's state strings per traffic light, and what each connector shows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from interplan_sumo.errors import TrafficError
from interplan_sumo.world.signals import Signals, SignalStatus

_STATUS = {"G": SignalStatus.GREEN, "g": SignalStatus.GREEN, "y": SignalStatus.YELLOW, "Y": SignalStatus.YELLOW,
           "r": SignalStatus.RED, "u": SignalStatus.RED, "s": SignalStatus.RED}  # fmt: skip
_LETTER = {SignalStatus.YELLOW: "y", SignalStatus.RED: "r", SignalStatus.UNKNOWN: "o"}


class Lights:
    """The traffic lights of a network."""

    def __init__(self, links: Mapping[str, tuple[str, int]]) -> None:
        """`links`: controlled connector -> (traffic light, index in its state string)."""
        self._links = links
        self._connectors = tuple(sorted(links))
        self.ids = tuple(sorted({light for light, _ in links.values()}))
        numbered = (links[connector] for connector in self._connectors)
        self._link_of = tuple((self.ids.index(light), index) for light, index in numbered)

    def signals(self, states: list[str]) -> Signals:
        """What the connectors show, from one state string per light in the order of `ids`."""
        status = [_STATUS.get(states[light][link], SignalStatus.UNKNOWN) for light, link in self._link_of]
        return Signals(self._connectors, np.array(status, dtype=np.int8))

    def imposed(
        self, wanted: Mapping[str, SignalStatus], states: Mapping[str, str], programs: Mapping[str, Iterable[str]]
    ) -> dict[str, str]:
        """The state strings with `wanted` in them, per light that it concerns; TrafficError for unknown connectors.

        `programs` are the states of each light's own program: who never has
        priority there must yield under an imposed green, too. A light of
        unknown status is off: its connectors yield.
        """
        changed: dict[str, str] = {}
        for connector, status in wanted.items():
            if connector not in self._links:
                raise TrafficError(f"no traffic light controls connector {connector!r}")
            light, index = self._links[connector]
            letter = _LETTER.get(status) or ("G" if any(state[index] == "G" for state in programs[light]) else "g")
            state = changed.get(light, states[light])
            changed[light] = state[:index] + letter + state[index + 1 :]
        return changed
