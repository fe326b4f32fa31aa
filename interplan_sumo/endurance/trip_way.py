"""The way of a trip: lanes one after the other, and places along them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.scenario.route import route_centerline, route_lanes
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import Roads


@dataclass(frozen=True)
class TripWay:
    """The ego's way; arc lengths are along `line`."""

    scenario: Scenario
    roads: Roads

    @cached_property
    def line(self) -> Polyline:
        return route_centerline(self.roads, self.scenario)

    @cached_property
    def lanes(self) -> tuple[str, ...]:
        """Lanes and connectors of the map."""
        return route_lanes(self.roads, self.scenario)

    @cached_property
    def ends_m(self) -> Floats:
        """Where each of them ends."""
        return np.cumsum([self.roads[lane].centerline.length_m for lane in self.lanes])

    def at(self, arc_m: float) -> LanePosition | None:
        """The place there; None beyond the end."""
        number = int(np.searchsorted(self.ends_m, arc_m, side="right"))
        if number >= len(self.lanes):
            return None
        length_m = self.roads[self.lanes[number]].centerline.length_m
        return LanePosition(self.lanes[number], min(max(arc_m - float(self.ends_m[number]) + length_m, 0.0), length_m))

    def near(self, from_m: float, to_m: float) -> tuple[str, ...]:
        """The lanes and connectors that lie in part between two places."""
        first, last = np.searchsorted(self.ends_m, [from_m, to_m], side="right").tolist()
        return self.lanes[first : last + 1]

    def starts_m(self, number: int) -> float:
        """Where the lane of that number begins."""
        return float(self.ends_m[number - 1]) if number else 0.0

    def sumo_lanes(self, network: SumoNetwork, ids: NetworkIds) -> frozenset[str]:
        """Those of the way that are outside junctions."""
        pieces = (piece.sumo_lane for lane in self.lanes for piece in ids.pieces[lane])
        return frozenset(lane for lane in pieces if not network.lanes[lane].internal)
