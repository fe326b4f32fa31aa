"""Neighbours of blockages: agents beside or before what blocks the next lane, who keep out of that lane.

SUMO's cars do not look far: they change into a lane that is free for now, and
stand there for good; and beside a blockage SUMO may slide a standing car into it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from interplan_sumo.simulation.agent_registry import AgentSnapshot
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.simulation.obstacles import LaneBlockage
from interplan_sumo.simulation.vehicle_types import VehicleType

BEFORE_M = 80.0
"""So far before a blockage nobody changes into its lane any more."""
BESIDE_M = 20.0
"""The front of an agent that is beside a blockage is no farther from its ends than the longest vehicle is long."""


class _Beside(NamedTuple):
    """Where agents are beside or before a blockage: within reach of its middle, and on another lane of its edge."""

    x_m: float
    y_m: float
    reach_m: float
    lanes: frozenset[str]
    blockage: LaneBlockage

    @classmethod
    def of(cls, network: SumoNetwork, blockage: LaneBlockage) -> _Beside:
        lane, half_m = network.lanes[blockage.lane], (blockage.end_m - blockage.start_m) / 2.0
        middle = lane.plain_line.pose_at(lane.arc_of(blockage.start_m + half_m))
        lanes = frozenset(network.edges[lane.edge]) - {lane.id}
        return cls(middle.x_m, middle.y_m, half_m + max(BESIDE_M, BEFORE_M), lanes, blockage)


class BlockageNeighbours:
    """Finds them, step by step."""

    def __init__(
        self, network: SumoNetwork, blocked: Sequence[LaneBlockage], drivers: Mapping[str, VehicleType]
    ) -> None:
        """`drivers` by agent, as they come."""
        self._beside = [_Beside.of(network, each) for each in blocked]
        self._drivers = drivers

    def agents(self, snapshot: AgentSnapshot) -> frozenset[str]:
        """Names of those that are beside a blockage now, or so little before it that they better keep their lane."""
        found: set[str] = set()
        for x_m, y_m, reach_m, lanes, each in self._beside:
            near = (snapshot.front_x - x_m) ** 2 + (snapshot.front_y - y_m) ** 2 < reach_m**2
            names = [snapshot.names[row] for row in near.nonzero()[0].tolist()]
            for name, here, front_m in zip(names, snapshot.lanes(names), snapshot.positions_m(names), strict=True):
                rear_m = front_m - self._drivers[name].length_m
                if here in lanes and front_m > each.start_m - BEFORE_M and rear_m < each.end_m:
                    found.add(name)
        return frozenset(found)
