"""The ego's proxy: a car in SUMO, on the centre line of one lane, that stands for the ego.

Its place and speed are set from outside in every step; they are never read back.
"""

from __future__ import annotations

from math import cos, sin

from interplan_sumo.simulation.agent_kinematics import navigation_deg
from interplan_sumo.simulation.anchor import Anchor, find_anchor, touches_road
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.simulation.sumo import Commanding, finite, sumo
from interplan_sumo.world.ego import EgoShape, EgoState

EGO = "ego"
EGO_TYPE = "interplan_ego"
SPEED_AS_TOLD = 32
"""SUMO's speed mode without any of its own rules."""
NO_LANE_CHANGE = 0
KEEP_ROUTE = 1
ANYWHERE = 2


class EgoProxy:
    """The proxy of one episode."""

    def __init__(
        self,
        network: SumoNetwork,
        origin_m: tuple[float, float],
        shape: EgoShape,
        route: tuple[str, ...],
        ego: EgoState,
    ) -> None:
        """Add it to SUMO; `route` are SUMO edges."""
        self._network = network
        self._origin = origin_m
        self._shape = shape
        self._route = route
        self._off_route = False
        self.anchor: Anchor | None = None
        """Where SUMO sees the ego; None while it is off the road."""
        with Commanding("adding the ego"):
            kind = sumo.vehicletype
            kind.copy("DEFAULT_VEHTYPE", EGO_TYPE)
            kind.setLength(EGO_TYPE, shape.length_m)
            kind.setWidth(EGO_TYPE, shape.width_m)
            kind.setSpeedDeviation(EGO_TYPE, 0.0)
            kind.setSpeedFactor(EGO_TYPE, 1.0)
            kind.setMaxSpeed(EGO_TYPE, 60.0)
            sumo.route.add(EGO, route)
            sumo.vehicle.add(EGO, EGO, EGO_TYPE, departLane="0", departPos="0", departSpeed="0")
            sumo.vehicle.setSpeedMode(EGO, SPEED_AS_TOLD)
            sumo.vehicle.setLaneChangeMode(EGO, NO_LANE_CHANGE)
        self.place(ego)

    def enter(self, ego: EgoState) -> None:
        """It has entered, with a speed that SUMO would refuse to one that enters above the limit."""
        with Commanding("giving the ego its speed"):
            sumo.vehicle.setPreviousSpeed(EGO, finite("the ego's speed", max(0.0, ego.speed_mps)), 0.0)

    def place(self, ego: EgoState) -> None:
        """Put it where the ego will be after the step; TrafficError for a pose that is not finite."""
        x_m, y_m = finite("the ego's x", ego.x_m - self._origin[0]), finite("the ego's y", ego.y_m - self._origin[1])
        heading_rad, speed_mps = finite("its heading", ego.heading_rad), finite("its speed", ego.speed_mps)
        reach_m = self._shape.length_m / 2.0
        front = (x_m + reach_m * cos(heading_rad), y_m + reach_m * sin(heading_rad))
        anchor = find_anchor(self._network, front, heading_rad, self.anchor, self._route)
        if anchor is not None and not touches_road(self._network, ego, self._shape, self._origin, anchor):
            anchor = None  # off the road no agent reacts to the ego, so SUMO must not see it either
        hidden = anchor is None or self._is_out_of_order()
        self.anchor = anchor
        with Commanding("moveToXY of the ego to ({:.2f}, {:.2f})", ego.x_m, ego.y_m):
            sumo.vehicle.setSpeed(EGO, max(0.0, speed_mps))
            if anchor is None or hidden:
                sumo.vehicle.moveToXY(EGO, "", -1, *self._network.nowhere, 0.0, ANYWHERE)
                self._off_route = True
                return
            lane = self._network.lanes[anchor.lane]
            angle_deg = navigation_deg(anchor.heading_rad)
            keep = KEEP_ROUTE if anchor.on_route and self._is_on_route() else ANYWHERE
            self._off_route = keep is ANYWHERE
            sumo.vehicle.moveToXY(EGO, lane.edge, lane.index, anchor.x_m, anchor.y_m, angle_deg, keep)

    def _is_out_of_order(self) -> bool:
        """Whether it has passed somebody in its lane, or the other way round.

        SUMO does not notice: whoever follows goes on taking the ego for its leader, and drives into the one between.
        Taken off the road for a step it is put back in its place.
        """
        if self.anchor is None:
            return False
        with Commanding("looking who is beside the ego"):
            names = sumo.lane.getLastStepVehicleIDs(self.anchor.lane)
            if EGO not in names:
                return False
            at = names.index(EGO)
            near_m = [sumo.vehicle.getLanePosition(name) for name in names[max(0, at - 1) : at + 2]]
        return near_m != sorted(near_m)

    def _is_on_route(self) -> bool:
        """Whether it has its route; wherever it is put beside it, SUMO gives it another."""
        if not self._off_route:
            return True
        lane = sumo.vehicle.getLaneID(EGO)  # getRoadID would crash while the ego is nowhere
        if not lane or lane.startswith(":"):
            return False  # SUMO takes no new route inside a junction
        edge = sumo.vehicle.getRoute(EGO)[sumo.vehicle.getRouteIndex(EGO)]
        if edge not in self._route:
            return False
        sumo.vehicle.setRoute(EGO, self._route[self._route.index(edge) :])
        return True
