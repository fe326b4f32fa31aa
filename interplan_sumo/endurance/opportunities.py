"""Opportunities: which rare events could begin in the next second, from the state of the traffic alone.

Nothing here draws, and nothing depends on what was drawn but by way of the
state. An opportunity has the name of whom or where it is, for as long as it lasts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from typing import Final

import numpy as np

from interplan_sumo.endurance.kerbside import Crosswalk, ParkedCar, crosswalks_on, parked_car
from interplan_sumo.endurance.records import RareKind
from interplan_sumo.endurance.red_light_runners import RedLightRunners
from interplan_sumo.endurance.trip_way import TripWay
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.scenario.scenario import LanePosition
from interplan_sumo.scenario.sites import edges_m
from interplan_sumo.simulation.agent_registry import AgentRegistry
from interplan_sumo.simulation.ego_proxy import EGO
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.simulation.sumo import Commanding, sumo
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.roads import Lane

DRIVES_MPS: Final = 5.0
"""A leader or neighbour slower than this, or before an ego that is, surprises nobody."""
LEADER_M: Final = (4.0, 50.0)
"""Gap to one that may brake hard."""
NEIGHBOUR_M: Final = (2.0, 20.0)
"""Gap along the lane between the ego's front and one beside it that may cut in."""
NEIGHBOUR_MPS: Final = 5.0
"""It is as fast as the ego to within this."""
ROOM_M: Final = 8.0
"""Between it and whom the ego follows, besides its own length."""
LANE_LEFT_M: Final = 50.0
"""It has as much of its lane left."""
STOPS_M: Final = (40.0, 95.0)
"""How far ahead of the ego, in a straight line, a vehicle on its way may break down."""
STOPS_MPS: Final = (3.0, 15.0)
"""How fast it drives until then."""
BEFORE_JUNCTION_M: Final = 20.0
"""It has as much of its lane left to stop on."""
WALKER_M: Final = 118.0
"""So far along its way from the ego somebody may come to the kerb: beyond what it sees."""
WALKER_MPS: Final = (3.0, 16.0)
"""Of an ego that is met by somebody on foot."""
FROM_LANE_END_M: Final = 12.0
"""Nobody walks into the road so near to a junction: there are crossings."""
WIDEST_M: Final = 22.0
"""A road wider than this is crossed by nobody."""
CROSSWALK_M: Final = (106.0, 118.0)
"""So far along its way from the ego is a crosswalk to which somebody may come."""
BIN_M: Final = 10.0
"""Places along a lane are told apart to this."""
_LEFT_AHEAD, _RIGHT_AHEAD = 0b010, 0b011  # SUMO's codes for getNeighbors


@dataclass(frozen=True, slots=True)
class RareOpportunity:
    """Something that could begin now."""

    kind: RareKind
    name: str
    """The agent's id, or the place."""
    agent: str = ""
    """SUMO's name of it, if it is an agent."""
    place: LanePosition | None = None
    """On the ego's lane, if it is somewhere."""
    edges_m: tuple[float, float] = (0.0, 0.0)
    """From there to the left and to the right edge of the road."""
    parked: ParkedCar | None = None
    crosswalk: Crosswalk | None = None


class Opportunities:
    """Looks for them around the ego."""

    def __init__(self, way: TripWay, network: SumoNetwork, ids: NetworkIds) -> None:
        self._way = way
        self._network = network
        self._origin_m = ids.origin_m
        self._sumo_lanes = way.sumo_lanes(network, ids)
        self._edges: dict[str, tuple[float, float] | None] = {}
        self._parked: dict[str, ParkedCar | None] = {}
        self._crosswalks = crosswalks_on(way)
        self._runners = RedLightRunners(way, ids)

    def now(self, ego: EgoState, agents: AgentRegistry) -> list[RareOpportunity]:
        """All that there are at this instant."""
        with Commanding("looking for opportunities"):
            if not sumo.vehicle.getLaneID(EGO):
                return []
            found = [*self._kerb(ego), self._crosswalk(ego), self._breakdown(ego, agents)]
            if ego.speed_mps >= DRIVES_MPS:
                found += [self._braking(agents), self._cut_in(ego, agents), self._runner(ego, agents)]
        return [each for each in found if each is not None]

    def _braking(self, agents: AgentRegistry) -> RareOpportunity | None:
        """The one that the ego follows."""
        leader = sumo.vehicle.getLeader(EGO, LEADER_M[1])
        if leader is None or leader[0] not in agents.rows or not LEADER_M[0] <= leader[1] <= LEADER_M[1]:
            return None
        drives = sumo.vehicle.getSpeed(leader[0]) >= DRIVES_MPS
        return RareOpportunity("hard_braking_ahead", agents.token_of(leader[0]), leader[0]) if drives else None

    def _cut_in(self, ego: EgoState, agents: AgentRegistry) -> RareOpportunity | None:
        """The nearest beside the ego's lane, a little ahead of it."""
        lane = self._network.lanes[sumo.vehicle.getLaneID(EGO)]
        if lane.internal:
            return None
        leader = sumo.vehicle.getLeader(EGO, LEADER_M[1])
        for side in (_LEFT_AHEAD, _RIGHT_AHEAD):
            for name, gap_m in sumo.vehicle.getNeighbors(EGO, side):
                if name not in agents.rows or not NEIGHBOUR_M[0] <= gap_m <= NEIGHBOUR_M[1]:
                    continue
                here = self._network.lanes.get(sumo.vehicle.getLaneID(name))
                if here is None or here.edge != lane.edge:
                    continue
                left_m, speed_mps = here.length_m - sumo.vehicle.getLanePosition(name), sumo.vehicle.getSpeed(name)
                free_m = gap_m + agents.drivers[name].length_m + ROOM_M
                if (
                    left_m >= LANE_LEFT_M
                    and speed_mps >= DRIVES_MPS
                    and abs(speed_mps - ego.speed_mps) <= NEIGHBOUR_MPS
                    and (leader is None or leader[1] >= free_m)
                ):
                    return RareOpportunity("cut_in", agents.token_of(name), name)
        return None

    def _breakdown(self, ego: EgoState, agents: AgentRegistry) -> RareOpportunity | None:
        """The nearest one ahead on the ego's way."""
        network, origin_m = self._network, self._origin_m
        dx, dy = agents.front_x + origin_m[0] - ego.x_m, agents.front_y + origin_m[1] - ego.y_m
        away_m = np.hypot(dx, dy)
        ahead = dx * np.cos(ego.heading_rad) + dy * np.sin(ego.heading_rad) > 0.0
        rows = np.flatnonzero(ahead & (away_m >= STOPS_M[0]) & (away_m <= STOPS_M[1]))
        for row in rows[np.argsort(away_m[rows], kind="stable")].tolist():
            name = agents.names[row]
            lane = sumo.vehicle.getLaneID(name)
            if lane not in self._sumo_lanes:
                continue
            left_m = network.lanes[lane].length_m - sumo.vehicle.getLanePosition(name)
            if left_m >= BEFORE_JUNCTION_M and STOPS_MPS[0] <= sumo.vehicle.getSpeed(name) <= STOPS_MPS[1]:
                return RareOpportunity("blocked_lane", agents.token_of(name), name)
        return None

    def _runner(self, ego: EgoState, agents: AgentRegistry) -> RareOpportunity | None:
        """The one that could run a red light across the ego's way."""
        name = self._runners.nearest(ego, agents)
        return None if name is None else RareOpportunity("red_light_runner", agents.token_of(name), name)

    def _crosswalk(self, ego: EgoState) -> RareOpportunity | None:
        """The crosswalk without a light that is about to come into sight."""
        if not self._crosswalks or not WALKER_MPS[0] <= ego.speed_mps <= WALKER_MPS[1]:
            return None
        arc_m, _ = self._way.line.project_point(ego.x_m, ego.y_m)
        for each in self._crosswalks:
            x_m, y_m = each.walk.start
            near_m = hypot(x_m - ego.x_m, y_m - ego.y_m)
            if CROSSWALK_M[0] <= each.conflict_m - arc_m <= CROSSWALK_M[1] and near_m >= CROSSWALK_M[0]:
                return RareOpportunity("crosswalk", each.name, crosswalk=each)
        return None

    def _kerb(self, ego: EgoState) -> list[RareOpportunity]:
        """What may be at the place on the ego's way that is about to come into sight: a walker, a parked car."""
        if not WALKER_MPS[0] <= ego.speed_mps <= WALKER_MPS[1]:
            return []
        arc_m, _ = self._way.line.project_point(ego.x_m, ego.y_m)
        at = self._way.at(arc_m + WALKER_M)
        lane = None if at is None else self._way.roads[at.lane]
        if at is None or not isinstance(lane, Lane):
            return []
        at_m = (at.arc_m // BIN_M + 0.5) * BIN_M
        if not FROM_LANE_END_M <= at_m <= lane.centerline.length_m - FROM_LANE_END_M:
            return []
        there = lane.centerline.pose_at(at_m)
        if hypot(there.x_m - ego.x_m, there.y_m - ego.y_m) < WALKER_M - BIN_M:
            return []  # the way bends: it would be in sight
        name, place = f"{at.lane}@{at_m:.0f}", LanePosition(at.lane, at_m)
        if name not in self._edges:
            left_m, right_m = edges_m(self._way.roads, lane, at_m)
            fits = min(left_m, right_m) > 0.0 and left_m + right_m <= WIDEST_M
            self._edges[name] = (left_m, right_m) if fits else None
            along_m = arc_m + WALKER_M + at_m - at.arc_m
            self._parked[name] = parked_car(self._way, place, along_m, (left_m, right_m))
        edges, parked = self._edges[name], self._parked[name]
        found: list[RareOpportunity] = []
        if edges is not None:
            found.append(RareOpportunity("jaywalker", name, place=place, edges_m=edges))
        if parked is not None:
            found.append(RareOpportunity("door", name, place=place, parked=parked))
        return found


def by_kind(found: Sequence[RareOpportunity]) -> Mapping[RareKind, list[str]]:
    """Their names, as `RareEventDraws` takes them."""
    names: dict[RareKind, list[str]] = {}
    for each in found:
        names.setdefault(each.kind, []).append(each.name)
    return names
