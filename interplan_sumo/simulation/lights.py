"""Lights: SUMO's state strings per traffic light, what each connector shows, and what was recorded of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.errors import TrafficError
from interplan_sumo.scenario.recorded_parts import LoggedLight
from interplan_sumo.simulation.light_cycles import LightCycles
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
        rows: list[int] = []
        self._indices: list[list[int]] = []  # per light, of its connectors in its state string
        for light in self.ids:
            mine = [row for row, connector in enumerate(self._connectors) if links[connector][0] == light]
            self._indices.append([links[self._connectors[row]][1] for row in mine])
            rows += mine
        self._order = np.argsort(np.array(rows, dtype=np.int64), kind="stable")
        self._known: dict[tuple[int, str], NDArray[np.int8]] = {}

    def signals(self, states: list[str]) -> Signals:
        """What the connectors show, from one state string per light in the order of `ids`."""
        if not states:
            return Signals.none()
        status = np.concatenate([self._shown(light, state) for light, state in enumerate(states)])
        return Signals(self._connectors, status[self._order])

    def _shown(self, light: int, state: str) -> NDArray[np.int8]:
        """What one light's connectors show; states recur, so each is translated once."""
        shown = self._known.get((light, state))
        if shown is None:
            status = [_STATUS.get(state[index], SignalStatus.UNKNOWN) for index in self._indices[light]]
            shown = self._known[light, state] = np.array(status, dtype=np.int8)
        return shown

    def imposed(
        self, wanted: Mapping[str, SignalStatus], states: Mapping[str, str], cycles: LightCycles
    ) -> dict[str, str]:
        """The state strings with `wanted` in them, per light that it concerns; TrafficError for unknown connectors.

        A connector that never has priority in its light's own cycle must yield under
        an imposed green, too. A light of unknown status is off: its connectors yield.
        """
        changed: dict[str, str] = {}
        for connector, status in wanted.items():
            if connector not in self._links:
                raise TrafficError(f"no traffic light controls connector {connector!r}")
            light, index = self._links[connector]
            letter = _LETTER.get(status) or ("G" if any(state[index] == "G" for state in cycles.states(light)) else "g")
            state = changed.get(light, states[light])
            changed[light] = state[:index] + letter + state[index + 1 :]
        return changed


class LoggedLights:
    """The recorded status of connectors over a drive."""

    def __init__(self, lights: Iterable[LoggedLight], silent: Iterable[str] = ()) -> None:
        """`silent` are connectors without a record that share a light with recorded ones: their status is unknown."""
        self._lights = {light.connector: light for light in lights}
        self._silent = tuple(connector for connector in silent if connector not in self._lights)
        self._connectors = tuple(sorted(self._lights))

    @classmethod
    def on(cls, lights: Iterable[LoggedLight], links: Mapping[str, tuple[str, int]]) -> LoggedLights:
        """On a network: `links` are its controlled connectors -> (traffic light, index in its state string).

        Once a light shows what was recorded, its own program is over; so its
        other connectors are unknown. Those that no light of the network
        controls are left out. Lights without any record keep their program.
        """
        found = [light for light in lights if light.connector in links]
        touched = {links[light.connector][0] for light in found}
        return cls(found, (connector for connector, (light, _) in links.items() if light in touched))

    def changes(self, step: int) -> dict[str, SignalStatus]:
        """What switches at a step of the drive; at step 0 everything."""
        found = {name: light.at(step) for name, light in self._lights.items() if step in light.steps}
        return found | dict.fromkeys(self._silent, SignalStatus.UNKNOWN) if step == 0 else found

    def signals(self, step: int) -> Signals:
        """What the recorded connectors show at a step."""
        status = np.array([self._lights[name].at(step) for name in self._connectors], dtype=np.int8)
        return Signals(self._connectors, status)
