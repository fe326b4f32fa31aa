"""What SUMO's agents are told: how fast to drive at most, whom to overlook, which lanes and headways to keep.

No command, and no end of one, makes an agent brake or accelerate beyond its type.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from math import inf
from typing import NamedTuple

import numpy as np

from interplan_sumo.simulation.agent_registry import AgentSnapshot
from interplan_sumo.simulation.braking_cut_ins import LEAST_GAP_M, BrakingCutIns
from interplan_sumo.simulation.ego_proxy import EGO, NO_LANE_CHANGE
from interplan_sumo.simulation.ego_reactions import BACK_TO_SUMO, AgentCommands
from interplan_sumo.simulation.headway_relaxation import HeadwayRelaxation, Leader
from interplan_sumo.simulation.reactions import DriverModels, Mode, ReactionDecision
from interplan_sumo.simulation.start_speed import ERRING_MODEL
from interplan_sumo.simulation.sumo import DT_S, Commanding, finite, sumo
from interplan_sumo.simulation.vehicle_types import VehicleType

SPEED_MODE_DEFAULT = 31
"""All of SUMO's rules; told a speed, an agent brakes for that, and for what SUMO sees, no harder than `decel`."""
SPEED_MODE_HARD_BRAKING = 24
"""Without the bounds of acceleration and braking, and without SUMO's safe speed, which knows no brakes: ours hold."""
RED_LIGHTS = 16
"""In a speed mode: red lights hold."""
LEADER_DECEL_MPS2 = 4.5
"""How hard the ego, or what stands, may brake for all that an agent's own model knows: SUMO's default for cars."""
LANE_CHANGE_DEFAULT = 1621
LANE_CHANGE_LOG_S = (1.415, 0.472)
"""Lane changes take 4.6 s on average with a deviation of 2.3 s, lognormal (Toledo and Zohar, 2007)."""
SHORTEST_LANE_CHANGE_S, LONGEST_LANE_CHANGE_S = 3.0, 8.0
LANE_WIDTH_M = 3.5
"""Of a usual lane: what a lane change crosses."""
PLAIN_LATERAL_MPS = 1.0
"""SUMO's `maxSpeedLat` where a type has none of its own."""
COLLISION_FREE_MODELS = frozenset({"IDM", "IDMM", "EIDM", "Krauss", "KraussOrig1", "KraussPS", "KraussX"})
"""The other car-following models of SUMO may drive into their leaders at low speed (W99 by 0.24 m, without any ego).

They brake as hard as they can when they could else not stop `LEAST_GAP_M` behind their leader.
"""
WANTED_LESS_MPS = 1e-3
"""SUMO wanted less than it was told if by more than this: below that it is rounding."""
NEW_STEPS = 25
"""Who has just come, and who is beside it, keeps its lane for so long: neither expects the other to change."""
BRAKING_FOR_LANES = {"laneChangeModel.lcStrategic": "-1", "laneChangeModel.lcCooperativeSpeed": "0"}
"""With these SUMO's cars brake neither for lane changes of their own, also while they may not, nor for others'."""
CUT_IN_WITHIN_M = 60.0
"""Farther ahead nobody cuts in."""


class _Told(NamedTuple):
    """What an agent has been told."""

    ignores_ego: bool
    speed_mode: int
    speed_mps: float | None = None
    """For the step; None: it drives as SUMO wants."""
    from_mps: float = 0.0
    """How fast it drove before."""
    left: bool = False
    """Whether a speed was decided, but SUMO braked harder anyway."""


UNTOLD = _Told(False, SPEED_MODE_DEFAULT)


class AgentChance:
    """What falls to agents by chance, from the scenario's seed: each agent has a sequence of its own."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._generators: dict[str, np.random.Generator] = {}

    def _generator(self, name: str) -> np.random.Generator:
        if name not in self._generators:
            self._generators[name] = np.random.default_rng((self._seed, *name.encode()))
        return self._generators[name]

    def of(self, name: str) -> float:
        """The agent's next number from 0 to 1."""
        return float(self._generator(name).random())

    def lane_change_s(self, name: str) -> float:
        """How long the agent takes to change lane."""
        drawn_s = float(self._generator(name).lognormal(*LANE_CHANGE_LOG_S))
        return min(max(drawn_s, SHORTEST_LANE_CHANGE_S), LONGEST_LANE_CHANGE_S)


class AgentControl:
    """Tells agents what is decided, and knows what they have been told."""

    def __init__(self, drivers: Mapping[str, VehicleType], chance_seed: int, *, plain: bool) -> None:
        """`drivers` by agent, as they come; `chance_seed` is for what they decide by chance.

        Where they are `plain`, they are SUMO's own to the bit, once they have been there for a while.
        """
        self._drivers = drivers
        self._plain = plain
        self._chance = AgentChance(chance_seed)
        self._told: dict[str, _Told] = {}
        self._overseen: set[str] = set()
        self._parting: set[str] = set()  # hold their speed for a step after a command: SUMO's EIDM flinches in it
        self._late: frozenset[str] = frozenset()
        self._running: frozenset[str] = frozenset()
        self._cut_ins = BrakingCutIns(drivers)
        self._relaxing: set[str] = set()
        self._relaxation = HeadwayRelaxation(drivers, _set_tau, DT_S)
        self._keeping_steps: dict[str, int] = {}
        self._later: dict[str, dict[str, str]] = {}  # of those that have just come: what they have once they may change
        self.keeping_lane: frozenset[str] = frozenset()
        """Agents that must not change lane."""
        self.models = DriverModels(self._follow_speed_mps, self._chance.of, self._relaxation.cut_in, DT_S)

    def enter(self, names: Collection[str]) -> None:
        """These have entered."""
        for name in sorted(names) if not self._plain else ():
            if sumo.vehicletype.getMaxSpeedLat(self._drivers[name].id) == PLAIN_LATERAL_MPS:
                sumo.vehicle.setMaxSpeedLat(
                    name, finite("a lateral speed", LANE_WIDTH_M / self._chance.lane_change_s(name))
                )
        for name in names:
            if self._drivers[name].relaxation_s > 0.0:
                self._relaxing.add(name)
            model = self._drivers[name].car_following_model
            if model not in COLLISION_FREE_MODELS:
                self._overseen.add(name)
            self._later[name] = {key: sumo.vehicle.getParameter(name, key) for key in BRAKING_FOR_LANES}
            for key, value in BRAKING_FOR_LANES.items():
                sumo.vehicle.setParameter(name, key, value)
        self.keep_lanes_a_while(names)

    def keep_lanes_a_while(self, names: Collection[str]) -> None:
        """Those that have just come keep their lanes for a while, and so do those beside them."""
        self._keeping_steps.update(dict.fromkeys(names, NEW_STEPS))
        self.keep_lanes(self.keeping_lane)

    def forget(self, name: str) -> None:
        """The agent has left."""
        self._keeping_steps.pop(name, None)
        self._later.pop(name, None)
        self._told.pop(name, None)
        self._late -= {name}
        self._running -= {name}
        self._overseen.discard(name)
        self._parting.discard(name)
        self._relaxing.discard(name)
        self._relaxation.forget(name)
        self.keeping_lane -= {name}

    def grow_old(self) -> None:
        """A step has passed: those that came some time ago may change lane from now on."""
        if self._keeping_steps:
            old = {name for name, steps in self._keeping_steps.items() if steps <= 1}
            self._keeping_steps = {name: steps - 1 for name, steps in self._keeping_steps.items() if steps > 1}
            with Commanding("letting agents change lane"):
                for name in sorted(old & self._later.keys()):
                    for key, value in self._later.pop(name).items():
                        sumo.vehicle.setParameter(name, key, value)
            self.keep_lanes(self.keeping_lane - old)

    def relax(self, agents: AgentSnapshot) -> None:
        """Headways of those that somebody has cut in on."""
        if self._relaxing:
            relaxed = [name for name in agents.names if name in self._relaxing]
            speeds = dict(zip(agents.names, agents.speed_mps.tolist(), strict=True))
            with Commanding("relaxing headways"):
                self._relaxation.step(relaxed, speeds.__getitem__, _leader)

    def tell(
        self,
        agents: AgentSnapshot,
        commands: AgentCommands,
        beside_posts: frozenset[str] = frozenset(),
        staged: Mapping[str, float] | None = None,
    ) -> None:
        """Pass on what is decided for the next step; those `beside_posts` keep their lanes as well.

        `staged` is how fast some are to be at most, whatever they think of it.
        """
        if self._parting:
            with Commanding("releasing agents"):
                for name in sorted(self._parting):
                    sumo.vehicle.setSpeed(name, -1.0)
            self._parting.clear()
        with Commanding("looking for cars that brake as they cut in"):
            surprised = self._cut_ins.most_mps(agents)
        for name, most_mps in (staged or {}).items():
            surprised = {**surprised, name: min(most_mps, surprised.get(name, inf))}
        if commands.decisions or self._overseen or surprised:
            with Commanding("commanding the agents"):
                for name, decision in self._held_back(agents, commands.decisions, surprised).items():
                    if name in self._told or decision.mode is not Mode.SUMO or decision.speed_mps is not None:
                        self._apply(name, decision, float(agents.speed_mps[agents.rows[name]]))
        self.keep_lanes(commands.keep_lane | beside_posts)

    def _follow_speed_mps(self, name: str, speed_mps: float, gap_m: float, leader_mps: float, leader: str) -> float:
        """What SUMO's model of an agent wants behind a leader that it does not see; SUMO counts gaps beyond minGap."""
        net_m = gap_m - self._drivers[name].min_gap_m
        decel_mps2 = apparent_decel_mps2(leader)
        return float(sumo.vehicle.getFollowSpeed(name, speed_mps, net_m, leader_mps, decel_mps2, leader))

    def _held_back(
        self, agents: AgentSnapshot, decisions: Mapping[str, ReactionDecision], surprised: Mapping[str, float]
    ) -> Mapping[str, ReactionDecision]:
        """`decisions`, and that agents whose model drives into its leader do not, nor those `surprised`."""
        if not self._overseen and not surprised:
            return decisions
        held: dict[str, ReactionDecision] = {}
        for name in sorted(self._overseen | surprised.keys()):
            held[name] = decision = decisions.get(name, BACK_TO_SUMO)
            overseen = name in self._overseen
            most_mps = self._most_mps(name, float(agents.speed_mps[agents.rows[name]])) if overseen else inf
            most_mps = min(most_mps, surprised.get(name, inf))
            if decision.speed_mps is None or most_mps < decision.speed_mps:
                held[name] = decision if most_mps == inf else decision._replace(speed_mps=most_mps)
        return {**decisions, **held}

    def _most_mps(self, name: str, speed_mps: float) -> float:
        """How fast an agent may be after the next step; inf where its model needs no word."""
        driver = self._drivers[name]
        leader = _leader(name)
        if leader is None:
            return inf
        brakes_mps2, leader_mps = driver.emergency_decel_mps2, max(0.0, sumo.vehicle.getSpeed(leader[0]))
        room_m = leader[1] + driver.min_gap_m - LEAST_GAP_M + leader_mps * leader_mps / (2.0 * brakes_mps2)
        stops = speed_mps * speed_mps / (2.0 * brakes_mps2) + speed_mps * DT_S <= room_m
        return inf if stops or _crosses(name, leader[0]) else max(0.0, speed_mps - brakes_mps2 * DT_S)

    def _apply(self, name: str, decision: ReactionDecision, speed_mps: float) -> None:
        """Tell an agent that drives at `speed_mps` what is decided.

        Whatever SUMO itself would have it do, for another car or a light, holds
        as well: up to `decel` SUMO sees to it, and while SUMO wants more than
        that, and more than is decided, the agent is left to it. No command, and
        no release, so ever breaks the agent's brakes.
        """
        before = self._told.get(name, UNTOLD)
        ignore, wanted_mps = decision.mode is Mode.IGNORE_EGO, decision.speed_mps
        vehicle = sumo.vehicle
        if ignore != before.ignores_ego:
            vehicle.setParameter(name, "carFollowModel.ignoreIDs", EGO if ignore else "")
            vehicle.setParameter(name, "junctionModel.ignoreIDs", EGO if ignore or name in self._running else "")
        mode = SPEED_MODE_DEFAULT
        left = wanted_mps is not None and self._brakes_harder(name, before, speed_mps, wanted_mps)
        if wanted_mps is not None and not left:
            driver = self._drivers[name]
            if wanted_mps < speed_mps - driver.decel_mps2 * DT_S:
                mode = SPEED_MODE_HARD_BRAKING
                wanted_mps = max(wanted_mps, speed_mps - driver.emergency_decel_mps2 * DT_S, 0.0)
            vehicle.setSpeed(name, finite("an overriding speed", wanted_mps))
        elif before.speed_mps is not None:
            steady = not left and self._drivers[name].car_following_model == ERRING_MODEL
            vehicle.setSpeed(name, speed_mps if steady else -1.0)
            if steady:
                self._parting.add(name)
        if mode != before.speed_mode:
            vehicle.setSpeedMode(name, mode & ~RED_LIGHTS if name in self._late else mode)
        self._told[name] = _Told(ignore, mode, None if left else wanted_mps, speed_mps, left)

    def _brakes_harder(self, name: str, before: _Told, speed_mps: float, wanted_mps: float) -> bool:
        """Whether SUMO, as it was about to in the last step, brakes harder than `decel`, and than for `wanted_mps`."""
        if before.left:
            own_mps = speed_mps
        elif before.speed_mps is None:
            return False
        else:
            own_mps = sumo.vehicle.getSpeedWithoutTraCI(name)  # SUMO wanted this, or whatever more than it was told
            if own_mps >= before.speed_mps - WANTED_LESS_MPS:
                return False
        braked_mps = before.from_mps - own_mps
        return braked_mps > self._drivers[name].decel_mps2 * DT_S and wanted_mps > speed_mps - braked_mps

    def let_drive_on(self, late: frozenset[str], running: frozenset[str] = frozenset()) -> None:
        """Have these agents, which cannot stop any more, drive on over red, and those before no longer.

        Those `running` red could stop, and do not yield to the ego either; to others they do.
        """
        if running != self._running:
            with Commanding("letting agents run red lights"):
                for name in sorted(running ^ self._running):
                    ignored = name in running or self._told.get(name, UNTOLD).ignores_ego
                    sumo.vehicle.setParameter(name, "junctionModel.ignoreIDs", EGO if ignored else "")
            self._running = running
        late |= running
        if late == self._late:
            return
        with Commanding("letting agents drive on over red"):
            for name in sorted(late ^ self._late):
                mode = self._told.get(name, UNTOLD).speed_mode
                sumo.vehicle.setSpeedMode(name, mode & ~RED_LIGHTS if name in late else mode)
        self._late = late

    def overlooks_ego(self, name: str) -> bool:
        """Whether an agent has been told to overlook the ego."""
        return self._told.get(name, UNTOLD).ignores_ego

    def keep_lanes(self, wanted: frozenset[str]) -> None:
        """Have these agents keep their lanes, as those do that have just come, and those before no longer."""
        wanted |= self._keeping_steps.keys()
        if wanted == self.keeping_lane:
            return
        with Commanding("setLaneChangeMode"):
            for name in sorted(wanted - self.keeping_lane):
                sumo.vehicle.setLaneChangeMode(name, NO_LANE_CHANGE)
            for name in sorted(self.keeping_lane - wanted):
                sumo.vehicle.setLaneChangeMode(name, LANE_CHANGE_DEFAULT)
        self.keeping_lane = wanted


def apparent_decel_mps2(name: str) -> float:
    """How hard a driver takes the one ahead to brake; without a name that is the ego, or what stands."""
    return float(sumo.vehicle.getApparentDecel(name)) if name else LEADER_DECEL_MPS2


def _leader(name: str) -> Leader:
    found = sumo.vehicle.getLeader(name, CUT_IN_WITHIN_M)
    return None if found is None or not found[0] else found


def _crosses(name: str, leader: str) -> bool:
    """Whether what SUMO calls an agent's leader is on another way over a junction that the agent is not in yet.

    The gap to it is as if it were on the agent's own way; if the agent lets it pass, it never comes so near.
    """
    lane = sumo.vehicle.getLaneID(leader)
    if not lane.startswith(":") or sumo.vehicle.getLaneID(name).startswith(":"):
        return False
    return all(lane not in link for link in sumo.vehicle.getNextLinks(name))


def _set_tau(name: str, tau_s: float) -> None:
    sumo.vehicle.setTau(name, finite("a headway", tau_s))
