"""Where red lights close a path: the stretches on which connectors of the route lie that show red."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from interplan_planners.common.corridor import Corridor
from interplan_planners.common.paths import DrivingPath
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.signals import Signals, SignalStatus


class RedLights:
    """The light-controlled connectors of a route, and where they lie on paths; asks about each pair once."""

    def __init__(self, roads: Roads, route_lanes: Iterable[str], half_width_m: float) -> None:
        self._roads = roads
        self._route_lanes = frozenset(route_lanes)
        self._half_width_m = half_width_m
        self._corridors: dict[DrivingPath, Corridor] = {}
        self._stretches: dict[tuple[DrivingPath, str], tuple[tuple[float, float], ...]] = {}

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
            key = (path, connector)
            if key not in self._stretches:
                if path not in self._corridors:
                    self._corridors[path] = Corridor(path.line, self._half_width_m)
                shapes = np.array([self._roads[connector].polygon], dtype=object)
                self._stretches[key] = self._corridors[path].occupied_m(shapes).get(0, ())
            found += self._stretches[key]
        return found
