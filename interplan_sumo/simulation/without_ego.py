"""Without the ego: what those that brake because of it would have done in the same step had it not been there.

Each one's own SUMO model is asked after the step, about the state before it:
the next one ahead but the ego, lights, lines where it must yield, lower limits,
the end of its lane, and whatever else it was told for others' sake. Only those
that braked, and whose braking the ego explains, are asked.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from math import hypot, inf

import numpy as np

from interplan_sumo.simulation.agent_control import LEADER_DECEL_MPS2, apparent_decel_mps2
from interplan_sumo.simulation.agent_registry import AgentRegistry
from interplan_sumo.simulation.ego_proxy import EGO
from interplan_sumo.simulation.lane_chains import corridor
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.simulation.obstacles import LaneBlockage
from interplan_sumo.simulation.start_speed import LINE_M
from interplan_sumo.simulation.sumo import DT_S, Commanding, sumo
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats

LEAST_MPS2 = 1.0
"""Who brakes less is not asked."""
REACH_M = 120.0
"""Nobody farther away brakes because of the ego."""
EXPLAINED_MPS = 0.05
"""The ego explains a speed if it asks for one that is no higher than that by more than this."""
AHEAD_M = 150.0
FOES_M = 30.0
"""So near a junction the ego may be in an agent's way there."""
HARD_MPS2 = 0.05
"""Whoever brakes harder than its `decel` by this does so for somebody in its way, not to change lane or for a limit."""
_HAS_PRIORITY = 1
"""In what `getNextLinks` answers of each link."""


@dataclass(frozen=True, eq=False)
class StepBefore:
    """Where agents and ego were before the step, and what the agents were told for it."""

    ego: EgoState
    names: Sequence[str]
    speed_mps: Floats
    """Of the agents in `names`."""
    for_ego_mps: Mapping[str, float]
    """Those that were told a speed because of the ego, and which."""
    for_others_mps: Mapping[str, float]
    """Those that were told a speed for others' sake, and which."""
    overlook: Callable[[str], bool]
    """Whether an agent was told to overlook the ego."""

    @cached_property
    def speeds_mps(self) -> Mapping[str, float]:
        """By agent."""
        return dict(zip(self.names, self.speed_mps.tolist(), strict=True))

    def speeds_of(self, names: Sequence[str]) -> Floats:
        """Those of some agents, 0 of who was not there."""
        if names is self.names:
            return self.speed_mps
        return np.array([self.speeds_mps.get(name, 0.0) for name in names])


class WithoutEgo:
    """Asks the agents of one episode."""

    def __init__(
        self,
        network: SumoNetwork,
        origin_m: tuple[float, float],
        agents: AgentRegistry,
        blocked: Sequence[LaneBlockage],
        choice: Callable[[str], Sequence[str]],
    ) -> None:
        """`choice` gives the SUMO lanes that an agent means to take."""
        self._network = network
        self._origin = origin_m
        self._agents = agents
        self._choice = choice
        self._blocked = blocked

    def accelerations(self, before: StepBefore) -> dict[str, float]:
        """What each agent that braked because of the ego would have chosen without it, in m/s2, by name."""
        names = self._agents.names
        now = self._agents.kinematics.speed_mps
        was = before.speeds_of(names)
        braked = (was - now >= LEAST_MPS2 * DT_S - 1e-9).nonzero()[0].tolist()
        x_m, y_m = before.ego.x_m - self._origin[0], before.ego.y_m - self._origin[1]
        front_m, found = self._agents.kinematics.front_m, dict[str, float]()
        with Commanding("asking what the agents would do without the ego"):
            bodies: dict[str, list[tuple[str, float, float]]] | None = None
            for row in braked:
                if hypot(front_m[row, 0] - x_m, front_m[row, 1] - y_m) > REACH_M:
                    continue
                name, old_mps, new_mps = names[row], float(was[row]), float(now[row])
                if not self._explained(name, old_mps, new_mps, before):
                    continue
                bodies = self._bodies() if bodies is None else bodies
                speed_mps = self._own_mps(name, old_mps, new_mps, before, bodies)
                found[name] = (speed_mps - old_mps) / DT_S
        return found

    def _explained(self, name: str, old_mps: float, new_mps: float, before: StepBefore) -> bool:
        """Whether the ego asked for as much braking as there was."""
        told_mps = before.for_ego_mps.get(name)
        if told_mps is not None and told_mps <= new_mps + EXPLAINED_MPS:
            return True
        if before.overlook(name):
            return False
        leader = sumo.vehicle.getLeader(name, AHEAD_M)
        if leader is None or leader[0] != EGO:
            hard = old_mps - new_mps > (self._agents.drivers[name].decel_mps2 + HARD_MPS2) * DT_S
            return hard and any(foe[0] == EGO for foe in sumo.vehicle.getJunctionFoes(name, FOES_M))
        ego_mps = max(0.0, before.ego.speed_mps)
        gap_m = leader[1] + (new_mps - ego_mps) * DT_S
        wanted_mps = sumo.vehicle.getFollowSpeed(name, old_mps, gap_m, ego_mps, LEADER_DECEL_MPS2, EGO)
        return wanted_mps <= new_mps + EXPLAINED_MPS

    def _bodies(self) -> dict[str, list[tuple[str, float, float]]]:
        """Who is where: on each lane names, and lane positions of rears and fronts."""
        found: dict[str, list[tuple[str, float, float]]] = {}
        vehicle, drivers = sumo.vehicle, self._agents.drivers
        for name in self._agents.names:
            front_m = vehicle.getLanePosition(name)
            found.setdefault(vehicle.getLaneID(name), []).append((name, front_m - drivers[name].length_m, front_m))
        for each in self._blocked:
            found.setdefault(each.lane, []).append(("", each.start_m, each.end_m))
        return found

    def _own_mps(
        self,
        name: str,
        old_mps: float,
        new_mps: float,
        before: StepBefore,
        bodies: Mapping[str, Sequence[tuple[str, float, float]]],
    ) -> float:
        """The speed that the agent's model wants for the step without the ego, within its brakes."""
        vehicle, driver = sumo.vehicle, self._agents.drivers[name]
        moved_m = new_mps * DT_S
        wanted = [before.for_others_mps.get(name, inf), vehicle.getFollowSpeed(name, old_mps, 1e4, old_mps, 1.0, "")]
        lane, position_m = vehicle.getLaneID(name), vehicle.getLanePosition(name)
        ahead = corridor(self._network, lane, self._agents.routes[name], partial(self._choice, name)) if lane else {}
        leader = self._next_ahead(name, position_m, ahead, bodies)
        if leader is not None:
            other, gap_m = leader
            other_mps = max(0.0, before.speeds_mps.get(other, 0.0))
            gap_m += moved_m - (max(0.0, vehicle.getSpeed(other)) if other else 0.0) * DT_S - driver.min_gap_m
            brakes_mps2 = apparent_decel_mps2(other)
            wanted.append(vehicle.getFollowSpeed(name, old_mps, gap_m, other_mps, brakes_mps2, other))
        stops_m = [away_m for _, _, away_m, state in vehicle.getNextTLS(name) if state not in "Gg"]
        links = vehicle.getNextLinks(name)
        if links and not links[0][_HAS_PRIORITY] and lane in self._network.lanes:
            here = self._network.lanes[lane]
            stops_m += [] if here.internal else [here.length_m - position_m]
        wanted += [vehicle.getStopSpeed(name, old_mps, max(0.0, away_m - LINE_M) + moved_m) for away_m in stops_m]
        for other_lane, start_m in ahead.items():
            limit_mps = self._network.lanes[other_lane].limit_mps * vehicle.getSpeedFactor(name)
            if start_m - position_m > 0.0 and limit_mps < old_mps:
                further_m = limit_mps * limit_mps / (2.0 * driver.decel_mps2)
                wanted.append(vehicle.getStopSpeed(name, old_mps, start_m - position_m + moved_m + further_m))
        least_mps = old_mps - driver.emergency_decel_mps2 * DT_S
        return max(0.0, least_mps, min(wanted))

    def _next_ahead(
        self, name: str, position_m: float, ahead: Mapping[str, float],
        bodies: Mapping[str, Sequence[tuple[str, float, float]]],
    ) -> tuple[str, float] | None:  # fmt: skip
        """The next one in an agent's corridor, '' for an obstacle, and the gap between bumpers."""
        gaps = [
            (start_m + rear_m - position_m, other)
            for lane, start_m in ahead.items()
            for other, rear_m, front_m in bodies.get(lane, ())
            if other != name and start_m + front_m > position_m
        ]
        if not gaps:
            return None
        gap_m, other = min(gaps)
        return other, gap_m
