"""Logged lights: what recorded traffic lights show step by step, for whoever moves the traffic."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from interplan_sumo.scenario.logged_lights import LoggedLight
from interplan_sumo.world.signals import Signals, SignalStatus


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
