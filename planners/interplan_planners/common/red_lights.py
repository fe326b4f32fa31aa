"""Where red lights close a path: the stretches on which connectors of the route lie that show red."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from interplan_planners.common.corridor import Corridor
from interplan_planners.common.paths import DrivingPath
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import Signals, SignalStatus


@dataclass(frozen=True, slots=True)
class _Covered:
    """A path's strip, and which stretches of it connectors cover."""

    corridor: Corridor
    by: dict[str, tuple[tuple[float, float], ...]]


class RedLights:
    """The light-controlled connectors of a route, and where they lie on paths.

    It asks about each pair once, as long as somebody has the path.
    """

    def __init__(self, roads: Roads, route_lanes: Iterable[str], half_width_m: float) -> None:
        self._roads = roads
        self._route_lanes = frozenset(route_lanes)
        self._half_width_m = half_width_m
        self._known: WeakKeyDictionary[DrivingPath, _Covered] = WeakKeyDictionary()

    def closed(self, signals: Signals, ego: EgoState, shape: EgoShape) -> tuple[str, ...]:
        """The connectors of the route that show red, but for those that hold all of the ego (PDM's rule)."""
        red = sorted(signals.with_status(SignalStatus.RED) & self._route_lanes)
        if not red:
            return ()
        box = ego.polygon(shape)
        return tuple(connector for connector in red if not self._roads[connector].polygon.contains(box))

    def on_path(self, path: DrivingPath, closed: Iterable[str]) -> list[tuple[float, float]]:
        """The stretches of a path that closed connectors cover, as arc lengths."""
        found: list[tuple[float, float]] = []
        for connector in closed:
            if path not in self._known:
                self._known[path] = _Covered(Corridor(path.line, self._half_width_m), {})
            covered = self._known[path]
            if connector not in covered.by:
                shapes = np.array([self._roads[connector].polygon], dtype=object)
                covered.by[connector] = covered.corridor.occupied_m(shapes).get(0, ())
            found += covered.by[connector]
        return found
