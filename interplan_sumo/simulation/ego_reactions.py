"""What each agent does about the ego, about pedestrians and about cars that overhang its lane, step after step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import cos, inf, sin, sqrt

import numpy as np
import shapely

from interplan_sumo.simulation import reactions
from interplan_sumo.simulation.agent_registry import AgentRegistry, AgentSnapshot
from interplan_sumo.simulation.anchor import Anchor
from interplan_sumo.simulation.blockage_neighbours import BlockageNeighbours
from interplan_sumo.simulation.ego_locator import EgoLocator
from interplan_sumo.simulation.lane_chains import corridor
from interplan_sumo.simulation.lane_change_overhang import LaneChangeOverhang
from interplan_sumo.simulation.lane_footprint import lanes_overlapped
from interplan_sumo.simulation.lane_polygons import ego_ring
from interplan_sumo.simulation.long_vehicles import LongVehicles
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.simulation.obstacles import LaneBlockage
from interplan_sumo.simulation.pedestrians import WayAhead
from interplan_sumo.simulation.reactions import (
    COMING,
    NOTICEABLE_MPS2,
    Agent,
    DriverModels,
    EgoOnNetwork,
    LaneCoverage,
    Mode,
    ReactionDecision,
    ReactionMemory,
)
from interplan_sumo.simulation.vehicle_types import VehicleType
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats

FREEZE_RADIUS_M = 40.0
"""Agents this near to an ego that straddles two lanes keep their lane, unless their type says `interplan.swerve`."""

NOTHING_REMEMBERED = ReactionMemory()
BACK_TO_SUMO = ReactionDecision(Mode.SUMO, 0.0, False)


@dataclass(frozen=True, slots=True)
class AgentCommands:
    """What SUMO's agents are told in one step."""

    decisions: Mapping[str, ReactionDecision]
    """By agent; those not named go on as they do."""
    keep_lane: frozenset[str]
    """Agents that must not change lane."""
    for_ego_mps: Mapping[str, float]
    """What the ego alone makes of those that are told a speed because of it."""
    for_others_mps: Mapping[str, float]
    """What all others make of those that are told a speed because of them."""


class EgoReactions:
    """Knows each agent's corridor, and what it remembers of the ego."""

    def __init__(
        self,
        network: SumoNetwork,
        origin_m: tuple[float, float],
        shape: EgoShape,
        registry: AgentRegistry,
        blocked: Sequence[LaneBlockage],
        models: DriverModels,
    ) -> None:
        self._network = network
        self._origin = origin_m
        self._shape = shape
        self._drivers = registry.drivers
        self._routes = registry.routes
        self._blocked = blocked
        self._beside = BlockageNeighbours(network, blocked, registry.drivers)
        self._models = models
        self._anticipations_s: tuple[float, ...] = ()
        self._courteous = False
        self._known_drivers = 0
        self._corridors: dict[str, tuple[str, dict[str, float]]] = {}
        self._memory: dict[str, ReactionMemory] = {}
        self._commanded: set[str] = set()  # agents that are not left to SUMO
        self._overhang = LaneChangeOverhang(network, registry.drivers)
        self._long = LongVehicles(network, registry.drivers, shape, origin_m)
        self._standing: dict[str, dict[str, LaneCoverage]] = {}
        self._skipped: EgoOnNetwork | None = None
        self._at_start = True
        self._locator = EgoLocator(network, origin_m, shape)
        self._numbers_of: dict[str, tuple[float, ...]] = {}
        self._known_names: Sequence[str] = ()
        self._known_numbers = np.zeros((6, 0))

    def _corridors_of(self, agents: AgentSnapshot, names: Sequence[str]) -> list[tuple[str, dict[str, float]]]:
        """The SUMO lane and the corridor of agents."""
        found: list[tuple[str, dict[str, float]]] = []
        for name, lane in zip(names, agents.lanes(names), strict=True):
            known = self._corridors.get(name)
            if known is None or known[0] != lane:
                choice = partial(agents.choice, name)
                ahead = corridor(self._network, lane, self._routes[name], choice) if lane else {}
                known = self._corridors[name] = (lane, ahead)
            found.append(known)
        return found

    def forget(self, name: str) -> None:
        """The agent has left."""
        self._memory.pop(name, None)
        self._commanded.discard(name)
        self._overhang.forget(name)
        self._corridors.pop(name, None)
        self._numbers_of.pop(name, None)

    def decide(
        self,
        ego: EgoState,
        anchor: Anchor | None,
        walking: Sequence[WayAhead],
        standing: Mapping[str, shapely.Polygon],
        agents: AgentSnapshot,
    ) -> AgentCommands:
        """What everyone does about the ego at `ego`, which SUMO sees at `anchor`, and about pedestrians.

        `walking` is where walking pedestrians will be, `standing`
        the boxes of those that stand, by name and place; in SUMO's frame.
        """
        if len(self._drivers) != self._known_drivers:
            self._get_to_know_drivers()
        on_network, ahead = self._locator.locate(ego, anchor, self._anticipations_s, courteous=self._courteous)
        turning = self._overhang.candidates(agents)
        obstructions = self._obstructions(walking, standing, turning, agents)
        waiting = self._long.waiting(agents, ego, self._corridors_of)
        others = bool(obstructions or turning or waiting or self._commanded or self._at_start)
        keep_lane = self._beside.agents(agents)
        alone = on_network.alone and ego.speed_mps >= 0.0 and not others and not on_network.approached
        hides_on = anchor.lane if anchor is not None and self._proxy_overlaps(agents, anchor) else None
        if alone and hides_on is None:
            self._skipped = on_network  # everyone behind follows the ego, as SUMO does by itself
            return AgentCommands({}, keep_lane, {}, {})
        dx = agents.front_x - (ego.x_m - self._origin[0])
        dy = agents.front_y - (ego.y_m - self._origin[1])
        away_m2 = dx * dx + dy * dy
        near = self._within_reach(agents, ego, away_m2)
        if self._skipped is not None:
            self._decide(self._skipped, {}, (), agents, near, hides_on)  # for what the agents remember of it
            self._skipped = None
        for_ego, for_others = self._decide(on_network, ahead, obstructions, agents, near, hides_on)
        facing = agents.displaced and self._overhang.faces_somebody(
            agents, ego_ring(ego, self._shape, self._origin), self._models.dt_s
        )
        for row in facing:
            name = agents.names[row]
            slowest_mps = float(agents.speed_mps[row]) - self._drivers[name].emergency_decel_mps2 * self._models.dt_s
            for_others[name] = reactions.no_faster(for_others.get(name), max(0.0, slowest_mps))
        for row in waiting:
            name = agents.names[row]
            slower_mps = float(agents.speed_mps[row]) - self._drivers[name].decel_mps2 * self._models.dt_s
            for_others[name] = reactions.no_faster(for_others.get(name), max(0.0, slower_mps))
        decisions = dict(for_ego)
        for name, other in for_others.items():
            decisions[name] = reactions.no_faster(for_ego.get(name), other.speed_mps or 0.0)
        self._at_start = False
        decisions.update(dict.fromkeys(self._commanded - decisions.keys(), BACK_TO_SUMO))
        for name, decision in decisions.items():
            if decision.mode is not Mode.SUMO:
                self._commanded.add(name)
                continue
            self._commanded.discard(name)
            remembered = self._memory.get(name)
            if remembered is not None and not remembered.reacting and remembered == NOTHING_REMEMBERED:
                del self._memory[name]
        if on_network.straddles:
            keep_lane |= self._keeping_lane(agents, away_m2)
        if hides_on is not None:
            keep_lane |= self._beside_overlap(agents, hides_on)
        return AgentCommands(decisions, keep_lane, _speeds_mps(for_ego), _speeds_mps(for_others))

    def _get_to_know_drivers(self) -> None:
        """Anticipation and courtesy of all agents so far: what of the ego has to be worked out for them."""
        drivers = self._drivers.values()
        self._anticipations_s = tuple(sorted({driver.anticipation_s for driver in drivers} - {0.0}))
        self._courteous = any(driver.courtesy > 0.0 for driver in drivers)
        self._known_drivers = len(self._drivers)

    def _keeping_lane(self, agents: AgentSnapshot, away_m2: Floats) -> frozenset[str]:
        """Agents that keep their lane beside an ego that straddles two; `away_m2` as in `_within_reach`."""
        beside = (agents.names[row] for row in (away_m2 <= FREEZE_RADIUS_M**2).nonzero()[0].tolist())
        return frozenset([name for name in beside if not self._drivers[name].swerve])

    def _beside_overlap(self, agents: AgentSnapshot, lane: str) -> frozenset[str]:
        """Agents on the road where the ego stands in others on a lane.

        SUMO takes what it hides for room, and puts who is hidden and changes lane behind those that it is ahead of.
        """
        beside = self._network.edges.get(self._network.lanes[lane].edge, ())
        here = zip(agents.names, self._corridors_of(agents, agents.names), strict=True)
        return frozenset([name for name, (at, _) in here if at in beside])

    def _obstructions(
        self,
        walking: Sequence[WayAhead],
        standing: Mapping[str, shapely.Polygon],
        turning: Sequence[int],
        agents: AgentSnapshot,
    ) -> list[tuple[str, Mapping[str, LaneCoverage]]]:
        """What besides the ego is in agents' way, as `yield_to` takes it: people, and `turning` cars that overhang."""
        found: list[tuple[str, Mapping[str, LaneCoverage]]] = []
        for place, box in standing.items():
            if place not in self._standing:
                spans = lanes_overlapped(self._network, box).items()
                self._standing[place] = {
                    lane: LaneCoverage(0.0, start_m, end_m, 0.0) for lane, (start_m, end_m) in spans
                }
            if self._standing[place]:  # the kerb is in nobody's way
                found.append(("", self._standing[place]))
        for way in walking:
            found.append(("", self._locator.coverage_of(way.soon, (0.0, 0.0))))
            found.append((COMING, self._locator.coverage_of(way.later, (0.0, 0.0))))
        if turning:
            lanes = [lane for lane, _ in self._corridors_of(agents, [agents.names[row] for row in turning])]
            found += self._overhang.coverage(turning, lanes, agents)
        return found

    def _decide(
        self,
        on_network: EgoOnNetwork,
        ahead: Mapping[float, Mapping[str, LaneCoverage]],
        obstructions: Sequence[tuple[str, Mapping[str, LaneCoverage]]],
        agents: AgentSnapshot,
        near: Sequence[int],
        hides_on: str | None,
    ) -> tuple[dict[str, ReactionDecision], dict[str, ReactionDecision]]:
        """What each agent that the ego or one of `obstructions` may concern does about it: about the ego, about others.

        `near` are the rows of agents that the ego may concern; on the lane `hides_on` it stands in others.
        """
        coverages = (on_network.coverage, on_network.approached, *ahead.values())
        lanes = {lane for coverage in coverages for lane in coverage}
        if on_network.anchor_lane is not None:
            lanes.add(on_network.anchor_lane)
        known = self._memory.keys() | self._commanded
        if obstructions:
            met = {lane for _, coverage in obstructions for lane in coverage}
            names = [agents.names[row] for row in self._within_reach_of(agents, obstructions)]
            corridors = zip(names, self._corridors_of(agents, names), strict=True)
            known.update([name for name, (_, corridor) in corridors if not met.isdisjoint(corridor)])
        if hides_on is not None:  # whom the ego hides concerns them, however far away it is itself
            corridors = zip(agents.names, self._corridors_of(agents, agents.names), strict=True)
            known.update([name for name, (_, corridor) in corridors if hides_on in corridor])
            on_network = on_network._replace(out_of_order=True)
        rows = {*near, *(agents.rows[name] for name in known)}
        concerned = self._concerned(agents, sorted(rows), lanes, known)
        for_ego = reactions.decide(concerned, on_network, ahead, self._memory, self._models, at_start=self._at_start)
        for_others: dict[str, ReactionDecision] = {}
        if obstructions:
            on_lanes: dict[str, list[tuple[str, LaneCoverage]]] = {}
            for name, coverage in obstructions:
                for lane, part in coverage.items():
                    on_lanes.setdefault(lane, []).append((name, part))
            for_others = reactions.yield_to(concerned, on_lanes, {}, self._models)
        overlooking = [
            each for each in concerned if hides_on or (each.id in for_ego and for_ego[each.id].mode is Mode.IGNORE_EGO)
        ]
        if overlooking:
            for_others = reactions.yield_to(overlooking, self._ahead(overlooking, agents), for_others, self._models)
        return for_ego, for_others

    def _ahead(self, overlooking: Sequence[Agent], agents: AgentSnapshot) -> dict[str, list[tuple[str, LaneCoverage]]]:
        """Every agent and every obstacle in the corridors of `overlooking`.

        SUMO's cars know the nearest vehicle ahead only: one that is told to
        overlook the ego overlooks what lies beyond it, too, and one that
        follows an ego that passes others too closely would follow it through them.
        """
        lanes = {lane for agent in overlooking for lane in agent.corridor}
        here = [lane for lane, _ in self._corridors_of(agents, agents.names)]
        rows = [row for row, lane in enumerate(here) if lane in lanes]
        names = [agents.names[row] for row in rows]
        found: dict[str, list[tuple[str, LaneCoverage]]] = {}
        for row, name, front_m in zip(rows, names, agents.positions_m(names), strict=True):
            rear_m = front_m - self._drivers[name].length_m
            body = LaneCoverage(0.0, rear_m, front_m, float(agents.speed_mps[row]))
            found.setdefault(here[row], []).append((name, body))
        for each in self._blocked:
            found.setdefault(each.lane, []).append(("", LaneCoverage(0.0, each.start_m, each.end_m, 0.0)))
        return found

    def _proxy_overlaps(self, agents: AgentSnapshot, anchor: Anchor) -> bool:
        """Whether SUMO's ego, a car at the anchor, stands in an agent or in an obstacle."""
        length_m = self._shape.length_m
        rear_m = anchor.position_m - length_m
        for each in self._blocked:
            if each.lane == anchor.lane and each.start_m < anchor.position_m and rear_m < each.end_m:
                return True
        dx, dy = agents.front_x - anchor.x_m, agents.front_y - anchor.y_m
        numbers = self._numbers(agents.names)
        cosine, sine = cos(anchor.heading_rad), sin(anchor.heading_rad)
        for row in (dx * dx + dy * dy < numbers[5]).nonzero()[0].tolist():
            along_m, across_m = cosine * dx[row] + sine * dy[row], cosine * dy[row] - sine * dx[row]
            if abs(across_m) < self._shape.width_m and -length_m < along_m < numbers[4, row]:
                return True
        return False

    def _within_reach(self, agents: AgentSnapshot, ego: EgoState, away_m2: Floats) -> list[int]:
        """Rows of the agents that the ego, were it their leader, would make brake noticeably.

        `away_m2` (N,) are squared distances from their fronts to the ego's centre.
        """
        away_mps = ego.vx_mps * np.cos(agents.heading_rad - ego.heading_rad)
        return (away_m2 <= self._reach_m(agents, away_mps) ** 2).nonzero()[0].tolist()

    def _within_reach_of(
        self, agents: AgentSnapshot, obstructions: Sequence[tuple[str, Mapping[str, LaneCoverage]]]
    ) -> list[int]:
        """Rows of the agents that one of the obstructions, were it to stand, would make brake noticeably."""
        lanes = self._network.lanes
        parts = [each for _, coverage in obstructions for each in coverage.items()]
        places = [lanes[name].plain_line.pose_at(lanes[name].arc_of(part.start_m)) for name, part in parts]
        x_m, y_m = np.array([(place.x_m, place.y_m) for place in places]).reshape(-1, 2).T
        dx, dy = agents.front_x - x_m[:, None], agents.front_y - y_m[:, None]
        away_m2 = (dx * dx + dy * dy).min(axis=0, initial=inf)
        return (away_m2 <= self._reach_m(agents, 0.0) ** 2).nonzero()[0].tolist()

    def _reach_m(self, agents: AgentSnapshot, away_mps: Floats | float) -> Floats:
        """(N,) how near a leader that drives away at a speed has to be to make an agent brake noticeably."""
        numbers, speed = self._numbers(agents.names), agents.speed_mps
        wished_m = numbers[0] + speed * (numbers[1] + np.maximum(0.0, speed - away_mps) * numbers[2])
        return wished_m * numbers[3] + self._shape.length_m

    def _numbers(self, names: Sequence[str]) -> Floats:
        """(6, N) standstill gap, headway, 1 / (2 sqrt(a b)), noticeable per wished gap, length and contact.

        Contact: squared distance of two fronts from which on the agent and the ego cannot touch.
        """
        if self._known_names is not names:
            for name in names:
                if name not in self._numbers_of:
                    self._numbers_of[name] = self._numbers_of_one(self._drivers[name])
            self._known_names = names
            self._known_numbers = np.array([self._numbers_of[name] for name in names]).reshape(-1, 6).T.copy()
        return self._known_numbers

    def _numbers_of_one(self, driver: VehicleType) -> tuple[float, ...]:
        return (
            driver.min_gap_m, driver.tau_s, 0.5 / sqrt(driver.accel_mps2 * driver.decel_mps2),
            sqrt(driver.accel_mps2 / NOTICEABLE_MPS2), driver.length_m, (driver.length_m + self._shape.length_m) ** 2,
        )  # fmt: skip

    def _concerned(self, agents: AgentSnapshot, rows: Sequence[int], lanes: set[str], known: set[str]) -> list[Agent]:
        """Those of the agents in `rows` that are known, or have one of `lanes` ahead."""
        names = [agents.names[row] for row in rows]
        ahead_of = [
            (name, row, lane, ahead)
            for name, row, (lane, ahead) in zip(names, rows, self._corridors_of(agents, names), strict=True)
            if name in known or not lanes.isdisjoint(ahead)
        ]
        positions_m = agents.positions_m([name for name, *_ in ahead_of])
        found: list[Agent] = []
        for (name, row, _, ahead), position_m in zip(ahead_of, positions_m, strict=True):
            driver, speed_mps = self._drivers[name], float(agents.speed_mps[row])
            foresees = driver.anticipation_s > 0.0 or driver.courtesy > 0.0
            behind = foresees and self._is_behind(agents, row)
            found.append(Agent(name, driver, position_m, speed_mps, ahead, behind))
        return found

    def _is_behind(self, agents: AgentSnapshot, row: int) -> bool:
        """Whether the ego's whole box lies behind an agent's front bumper."""
        heading_rad = agents.heading_rad[row]
        along_x, along_y = float(np.cos(heading_rad)), float(np.sin(heading_rad))
        front_m = float(agents.front_x[row]) * along_x + float(agents.front_y[row]) * along_y
        return all(x * along_x + y * along_y <= front_m for x, y in self._locator.corners)


def _speeds_mps(decisions: Mapping[str, ReactionDecision]) -> dict[str, float]:
    return {name: each.speed_mps for name, each in decisions.items() if each.speed_mps is not None}
