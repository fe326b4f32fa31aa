"""Watch: whom the ego, pedestrians and askew bodies concern, and what each does about them, step after step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, sin, sqrt

import numpy as np
import shapely

from interplan_sumo.simulation import reactions
from interplan_sumo.simulation.anchor import Anchor
from interplan_sumo.simulation.askew import AskewBodies
from interplan_sumo.simulation.driving import Driving
from interplan_sumo.simulation.network import Network
from interplan_sumo.simulation.obstacles import Blockage
from interplan_sumo.simulation.passage import reached
from interplan_sumo.simulation.reactions import Agent, Attention, Cover, Decision, EgoOnNetwork, Treatment
from interplan_sumo.simulation.vehicle_types import VehicleType
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats

NOTICEABLE_MPS2 = 0.05
"""An agent whom the ego makes brake by less than this is left in peace: half of what counts as a reaction."""

BEND_M = 0.3
"""A lane bends away from its direction at the ego's front by less than this within the ego's length."""

LEAVE = Decision(Treatment.LEAVE, 0.0, False)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What to do in one step."""

    decisions: Mapping[str, Decision]
    """By agent; who is not named stays as it is."""
    straddles: bool
    """Whether the ego straddles two lanes."""


class Watch:
    """Keeps each agent's corridor and what it remembers of the ego."""

    def __init__(
        self,
        network: Network,
        origin_m: tuple[float, float],
        shape: EgoShape,
        drivers: Mapping[str, VehicleType],
        routes: Mapping[str, tuple[str, ...]],
        blocked: Sequence[Blockage],
        dt_s: float,
    ) -> None:
        self._network = network
        self._origin = origin_m
        self._shape = shape
        self._drivers = drivers
        self._routes = routes
        self._blocked = blocked
        self._dt_s = dt_s
        self._anticipations_s = tuple(sorted({driver.anticipation_s for driver in drivers.values()} - {0.0}))
        self._corridors: dict[str, tuple[str, dict[str, float]]] = {}
        self._watchers: dict[str, set[str]] = {}  # SUMO lane -> agents that have it in their corridor
        self._memory: dict[str, Attention] = {}
        self._treated: set[str] = set()
        self._askew = AskewBodies(network, drivers)
        self._pierced_lane: str | None = None
        self._stands: dict[str, dict[str, Cover]] = {}
        self._calm: EgoOnNetwork | None = None
        self._at_start = True
        self._known_names: Sequence[str] = ()
        self._known_numbers = np.zeros((5, 0))

    def _follow(self, driving: Driving) -> None:
        """Note on which SUMO lane each agent is now."""
        for name, lane in zip(driving.names, driving.lanes(), strict=True):
            known = self._corridors.get(name)
            if known is None or known[0] != lane:
                self._forget_corridor(name)
                ahead = reactions.corridor(self._network, lane, self._routes[name]) if lane else {}
                self._corridors[name] = (lane, ahead)
                for each in ahead:
                    self._watchers.setdefault(each, set()).add(name)

    def forget(self, name: str) -> None:
        """The agent has left."""
        self._memory.pop(name, None)
        self._treated.discard(name)
        self._askew.forget(name)
        self._forget_corridor(name)

    def _forget_corridor(self, name: str) -> None:
        known = self._corridors.pop(name, None)
        if known is not None:
            for lane in known[1]:
                self._watchers[lane].discard(name)

    def judge(
        self,
        ego: EgoState,
        anchor: Anchor | None,
        walked: Sequence[shapely.Polygon],
        standing: Mapping[str, shapely.Polygon],
        driving: Driving,
    ) -> Verdict:
        """What everyone does about the ego at `ego`, which SUMO sees at `anchor`, and about pedestrians.

        `walked` are the areas that walking pedestrians will cover, `standing`
        the boxes of those who stand, by name and place; in SUMO's frame.
        """
        on_network, ahead = self._locate(ego, anchor)
        suspects = self._askew.suspects(driving)
        calm = on_network.alone and ego.speed_mps >= 0.0
        things = self._in_the_way(standing) if standing else []
        calm = calm and not (walked or things or suspects or self._treated or self._at_start)
        calm = calm and not self._pierces(driving, anchor)
        if calm:  # everyone behind follows the ego, as SUMO does by itself; caught up with when that ends
            self._calm = on_network
            return Verdict({}, straddles=False)
        self._follow(driving)
        things += [("", reactions.cover(self._network, area, (0.0, 0.0))) for area in walked]
        lanes = [self._corridors[name][0] for name in driving.names] if suspects else ()
        things += self._askew.covers(suspects, lanes, driving)
        if self._calm is not None:
            self._decide(self._calm, {}, (), driving, ego, anchor)
            self._calm = None
        decisions = self._decide(on_network, ahead, things, driving, ego, anchor)
        self._at_start = False
        for name in self._treated - decisions.keys():
            decisions[name] = LEAVE
        for name, decision in decisions.items():
            if decision.treatment is not Treatment.LEAVE:
                self._treated.add(name)
            else:
                self._treated.discard(name)
                if not decision.reacting and decision.overlap == 0.0:
                    self._memory.pop(name, None)
        return Verdict(decisions, on_network.straddles)

    def _in_the_way(self, standing: Mapping[str, shapely.Polygon]) -> list[tuple[str, Mapping[str, Cover]]]:
        """Covers of the pedestrians who stand where cars drive; the kerb is not in the way."""
        for place, box in standing.items():
            if place not in self._stands:
                spans = reached(self._network, box).items()
                self._stands[place] = {lane: Cover(0.0, start_m, end_m, 0.0) for lane, (start_m, end_m) in spans}
        return [("", self._stands[place]) for place in standing if self._stands[place]]

    def _decide(
        self,
        on_network: EgoOnNetwork,
        ahead: Mapping[float, Mapping[str, Cover]],
        things: Sequence[tuple[str, Mapping[str, Cover]]],
        driving: Driving,
        ego: EgoState,
        anchor: Anchor | None,
    ) -> dict[str, Decision]:
        """What each agent that the ego or one of `things` may concern does about it."""
        concerned: set[str] = set()
        for covers in (on_network.covers, *ahead.values()):
            for lane in covers:
                concerned |= self._watchers.get(lane, set())
        if on_network.anchor_lane is not None:
            concerned |= self._watchers.get(on_network.anchor_lane, set())
        rows = [row for row in self._within_reach(driving, ego) if driving.names[row] in concerned]
        known = self._memory.keys() | self._treated
        for _, covers in things:
            for lane in covers:
                known |= self._watchers.get(lane, set())
        if known:
            known.difference_update([driving.names[row] for row in rows])
            rows = sorted([*rows, *(row for row, name in enumerate(driving.names) if name in known)])
        agents = [self._agent(driving, row) for row in rows]
        decisions = reactions.decide(agents, on_network, ahead, self._memory, self._dt_s, at_start=self._at_start)
        if things:
            decisions = reactions.yield_to(agents, things, decisions, self._dt_s)
        pierces = self._pierces(driving, anchor)
        blind = [
            each
            for each in agents
            if each.id in decisions and (pierces or decisions[each.id].treatment is Treatment.IGNORE)
        ]
        return reactions.yield_to(blind, self._ahead(blind, driving), decisions, self._dt_s) if blind else decisions

    def _ahead(self, agents: Sequence[Agent], driving: Driving) -> list[tuple[str, dict[str, Cover]]]:
        """Everyone and every obstacle in the corridors of agents.

        SUMO's drivers know the nearest vehicle ahead only: whoever is told to
        overlook the ego overlooks what lies behind it, too, and whoever
        follows an ego that passes others too closely would follow it through them.
        """
        lanes = {lane for agent in agents for lane in agent.corridor}
        found: list[tuple[str, dict[str, Cover]]] = []
        for row, name in enumerate(driving.names):
            lane, _ = self._corridors[name]
            if lane in lanes:
                front_m = driving.position_m(name)
                rear_m = front_m - self._drivers[name].length_m
                found.append((name, {lane: Cover(0.0, rear_m, front_m, float(driving.speed_mps[row]))}))
        found += [("", {b.lane: Cover(0.0, b.start_m, b.end_m, 0.0)}) for b in self._blocked if b.lane in lanes]
        return found

    def _pierces(self, driving: Driving, anchor: Anchor | None) -> bool:
        """Whether SUMO's ego, a car at the anchor, stands in an agent or in an obstacle, or has on this lane.

        SUMO keeps the order of the cars on a lane: whom the ego has passed
        through stays hidden behind it until the ego gets to another lane.
        """
        if anchor is None or anchor.lane != self._pierced_lane:
            self._pierced_lane = None
        if anchor is None:
            return False
        if self._pierced_lane is None and self._stands_in_somebody(driving, anchor):
            self._pierced_lane = anchor.lane
        return self._pierced_lane is not None

    def _stands_in_somebody(self, driving: Driving, anchor: Anchor) -> bool:
        length_m = self._shape.length_m
        rear_m = anchor.position_m - length_m
        for each in self._blocked:
            if each.lane == anchor.lane and each.start_m < anchor.position_m and rear_m < each.end_m:
                return True
        dx, dy = driving.front_x - anchor.x_m, driving.front_y - anchor.y_m
        lengths_m = self._numbers(driving.names)[4]
        reach_m = lengths_m + length_m  # farther away no front belongs to a body that touches the ego
        near = np.flatnonzero(dx * dx + dy * dy < reach_m * reach_m)
        if not len(near):
            return False
        cosine, sine = cos(anchor.heading_rad), sin(anchor.heading_rad)
        along_m, across_m = cosine * dx[near] + sine * dy[near], cosine * dy[near] - sine * dx[near]
        beside = np.abs(across_m) < self._shape.width_m
        return bool((beside & (along_m > -length_m) & (along_m < lengths_m[near])).any())

    def _within_reach(self, driving: Driving, ego: EgoState) -> list[int]:
        """Rows of the agents whom the ego, were it their leader, would make brake noticeably."""
        numbers = self._numbers(driving.names)
        cosine, sine = np.cos(driving.heading_rad), np.sin(driving.heading_rad)
        towards_mps = ego.vx_mps * (cosine * cos(ego.heading_rad) + sine * sin(ego.heading_rad))
        speed = driving.speed_mps
        wished_m = numbers[0] + speed * (numbers[1] + np.maximum(0.0, speed - towards_mps) * numbers[2])
        dx = driving.front_x + self._origin[0] - ego.x_m
        dy = driving.front_y + self._origin[1] - ego.y_m
        reach_m = wished_m * numbers[3] + self._shape.length_m
        return np.flatnonzero(dx * dx + dy * dy <= reach_m * reach_m).tolist()

    def _numbers(self, names: Sequence[str]) -> Floats:
        """(5, N) standstill gap, headway, 1 / (2 sqrt(a b)), noticeable per wished gap, length."""
        if self._known_names is not names:
            drivers = [self._drivers[name] for name in names]
            self._known_names = names
            self._known_numbers = np.array(
                [
                    [d.min_gap_m for d in drivers],
                    [d.tau_s for d in drivers],
                    [0.5 / sqrt(d.accel_mps2 * d.decel_mps2) for d in drivers],
                    [sqrt(d.accel_mps2 / NOTICEABLE_MPS2) for d in drivers],
                    [d.length_m for d in drivers],
                ]
            )
        return self._known_numbers

    def _agent(self, driving: Driving, row: int) -> Agent:
        name = driving.names[row]
        lane, ahead = self._corridors[name]
        limit_mps = self._network.lanes[lane].limit_mps if lane else 0.0
        position_m, speed_mps = driving.position_m(name), float(driving.speed_mps[row])
        return Agent(name, self._drivers[name], position_m, speed_mps, limit_mps, ahead)

    def _well_inside(self, ego: EgoState, anchor: Anchor) -> bool:
        """Whether the box certainly lies inside the anchor lane, a normal one, and nowhere else: the quickest way."""
        lane = self._network.lanes[anchor.lane]
        length_m, half_m = self._shape.length_m, self._shape.length_m / 2.0
        if lane.internal or not length_m + BEND_M < anchor.position_m < lane.length_m - BEND_M:
            return False
        cosine, sine = cos(ego.heading_rad), sin(ego.heading_rad)
        dx = ego.x_m + half_m * cosine - self._origin[0] - anchor.x_m
        dy = ego.y_m + half_m * sine - self._origin[1] - anchor.y_m
        lateral_m = abs(dy * cos(anchor.heading_rad) - dx * sin(anchor.heading_rad))
        askew_m = length_m * abs(sin(ego.heading_rad - anchor.heading_rad))
        return lateral_m + askew_m + self._shape.width_m / 2.0 + BEND_M < lane.width_m / 2.0

    def _locate(self, ego: EgoState, anchor: Anchor | None) -> tuple[EgoOnNetwork, dict[float, Mapping[str, Cover]]]:
        """The ego on the lanes, and what its swept box covers per anticipation time."""
        heading = ego.heading_rad
        velocity = (
            ego.vx_mps * cos(heading) - ego.vy_mps * sin(heading),
            ego.vx_mps * sin(heading) + ego.vy_mps * cos(heading),
        )
        lane = anchor.lane if anchor is not None else None
        position_m = anchor.position_m if anchor is not None else 0.0
        if anchor is not None and not self._anticipations_s and self._well_inside(ego, anchor):
            speed_mps = velocity[0] * cos(anchor.heading_rad) + velocity[1] * sin(anchor.heading_rad)
            alone = {anchor.lane: Cover(1.0, position_m - self._shape.length_m, position_m, speed_mps)}
            centre = frozenset((anchor.lane,))
            return EgoOnNetwork(alone, centre, lane, position_m, ego.speed_mps, straddles=False, alone=True), {}
        corners = ego.corners(self._shape) - self._origin
        if lane is not None and not self._anticipations_s:
            alone = reactions.cover_of_one_lane(self._network.lanes[lane], position_m, corners, velocity)
            if alone is not None:
                centre = frozenset((lane,))
                return EgoOnNetwork(alone, centre, lane, position_m, ego.speed_mps, straddles=False, alone=True), {}
        box = shapely.Polygon(corners)
        covers = reactions.cover(self._network, box, velocity)
        ahead: dict[float, Mapping[str, Cover]] = {
            time_s: reactions.cover(self._network, reactions.swept(box, velocity, time_s), velocity)
            for time_s in self._anticipations_s
        }
        own = self._network.continuations(lane) if lane is not None else frozenset[str]()
        inside = sum(part.share for name, part in covers.items() if name in own)
        centre_lanes = self._network.lanes_at(ego.x_m - self._origin[0], ego.y_m - self._origin[1])
        straddles = inside < reactions.FULLY_MERGED
        return EgoOnNetwork(covers, centre_lanes, lane, position_m, ego.speed_mps, straddles), ahead
