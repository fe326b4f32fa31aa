"""Red-light runners: who would come across the ego's way at about the time at which the ego does, but for its red."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from interplan_sumo.endurance.trip_way import TripWay
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.simulation.agent_registry import AgentRegistry
from interplan_sumo.simulation.sumo import sumo
from interplan_sumo.world.ego import EgoState

SOON_S: Final = (1.5, 7.0)
"""The ego, at its speed, is so far from where their ways cross."""
APART_S: Final = 2.5
"""And the other one is there at most so much earlier or later."""
LINE_M: Final = (3.0, 45.0)
"""The other one's front is so far before its stop line."""
RUNS_MPS: Final = 3.0
"""It drives as fast as this: who has stopped waits for green."""
AROUND_M: Final = 110.0


@dataclass(frozen=True, slots=True)
class _Crossing:
    """Another way over a junction with lights that crosses the ego's."""

    along_m: float
    """Where, along the ego's way."""
    other_m: float
    """And along the other connector."""


class RedLightRunners:
    """Those of one trip."""

    def __init__(self, way: TripWay, ids: NetworkIds) -> None:
        self._way = way
        self._origin_m = ids.origin_m
        self._connectors: dict[tuple[str, int], list[str]] = {}
        for connector, (light, index) in sorted(ids.links.items()):
            self._connectors.setdefault((light, index), []).append(connector)
        self._own = [
            (way.starts_m(number), lane, *ids.links[lane]) for number, lane in enumerate(way.lanes) if lane in ids.links
        ]
        """Where each lit connector of the ego's way begins, its id, its light and its place in that."""
        self._crossings: dict[tuple[str, str], _Crossing | None] = {}

    def nearest(self, ego: EgoState, agents: AgentRegistry) -> str | None:
        """SUMO's name of the one that would come nearest in time; None where nobody would, or the ego has no green."""
        arc_m, _ = self._way.line.project_point(ego.x_m, ego.y_m)
        mine = next((each for each in self._own if each[0] > arc_m), None)
        if mine is None or mine[0] - arc_m > SOON_S[1] * ego.speed_mps:
            return None
        _, own, light, index = mine
        shown: str = sumo.trafficlight.getRedYellowGreenState(light)
        if shown[index] not in "Gg":
            return None
        dx, dy = agents.front_x + self._origin_m[0] - ego.x_m, agents.front_y + self._origin_m[1] - ego.y_m
        found: list[tuple[float, int, str]] = []  # agents are in the order of the ids that others see
        for row in np.flatnonzero(np.hypot(dx, dy) <= AROUND_M).tolist():
            name = agents.names[row]
            apart_s = self._apart_s(ego.speed_mps, arc_m, name, own, light)
            if apart_s is not None and apart_s <= APART_S:
                found.append((apart_s, row, name))
        return min(found)[2] if found else None

    def _apart_s(self, ego_mps: float, arc_m: float, name: str, own: str, light: str) -> float | None:
        """Between the ego's coming to where its way crosses an agent's, and the agent's; None where it will not."""
        speed_mps = sumo.vehicle.getSpeed(name)
        if speed_mps < RUNS_MPS:
            return None
        ahead = next(iter(sumo.vehicle.getNextTLS(name)), None)
        if ahead is None or ahead[0] != light or ahead[3] not in "rR" or not LINE_M[0] <= ahead[2] <= LINE_M[1]:
            return None
        leader = sumo.vehicle.getLeader(name, ahead[2])
        if leader is not None and leader[0] and leader[1] < ahead[2]:
            return None
        for other in self._connectors.get((light, ahead[1]), ()):
            crossing = self._crossing(own, other)
            if crossing is None:
                continue
            own_s = (crossing.along_m - arc_m) / ego_mps
            if SOON_S[0] <= own_s <= SOON_S[1]:
                return abs(own_s - (ahead[2] + crossing.other_m) / speed_mps)
        return None

    def _crossing(self, own: str, other: str) -> _Crossing | None:
        """Where the ways over two connectors cross; None where they do not, or come from one lane or lead to one."""
        key = (own, other)
        if key not in self._crossings:
            self._crossings[key] = self._found(own, other)
        return self._crossings[key]

    def _found(self, own: str, other: str) -> _Crossing | None:
        here, there = self._way.roads.connectors[own], self._way.roads.connectors[other]
        if here.from_lane_id == there.from_lane_id or here.to_lane_id == there.to_lane_id:
            return None
        at = shapely.intersection(here.centerline.linestring, there.centerline.linestring)
        if at.is_empty:
            return None
        point = shapely.get_coordinates(at)[0]
        own_m, _ = here.centerline.project_point(float(point[0]), float(point[1]))
        other_m, _ = there.centerline.project_point(float(point[0]), float(point[1]))
        start_m = next(start_m for start_m, lane, *_ in self._own if lane == own)
        return _Crossing(start_m + own_m, other_m)
