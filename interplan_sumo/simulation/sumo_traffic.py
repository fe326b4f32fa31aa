"""Background traffic on libsumo: SUMO's cars, put on the road, held to our rules about the ego, and read back.

The ego is a proxy car; its true pose is kept by the closed loop and never read back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from math import inf

import numpy as np
import shapely

from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.simulation.agent_control import AgentControl
from interplan_sumo.simulation.agent_registry import AgentRegistry, AgentSnapshot
from interplan_sumo.simulation.ego_proxy import EGO, EgoProxy
from interplan_sumo.simulation.ego_reactions import FREEZE_RADIUS_M, EgoReactions
from interplan_sumo.simulation.first_seconds import FirstSeconds
from interplan_sumo.simulation.flow import Inflow, OnTheRoad
from interplan_sumo.simulation.lane_posts import LanePosts
from interplan_sumo.simulation.late_for_light import LateForLight
from interplan_sumo.simulation.light_cycles import SOON_S, LightCycles
from interplan_sumo.simulation.lights import Lights, LoggedLights
from interplan_sumo.simulation.network import NetworkLink, SumoNetwork
from interplan_sumo.simulation.obstacles import LaneBlockage, blocked_by
from interplan_sumo.simulation.pedestrians import People, WayAhead
from interplan_sumo.simulation.slow_vehicles import ELEMENTS as SLOW
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.simulation.staging import block_lanes, switch_lights
from interplan_sumo.simulation.sumo import DT_S, Commanding, close_simulation, getters, open_simulation, sumo
from interplan_sumo.simulation.traffic import EgoPresence, TrafficState
from interplan_sumo.simulation.vehicle_types import VehicleType, VehicleTypes
from interplan_sumo.simulation.without_ego import StepBefore, WithoutEgo
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA, EgoShape, EgoState
from interplan_sumo.world.signals import Signals, SignalStatus

LANE_SLACK_M = 0.5
"""The rear of a car that is turned by less than this against its lane stays in it."""
BESIDE_M = 80.0
"""This near to one that enters nobody changes lane for a while."""
NOWHERE_M = 1e7
"""An ego there meets nobody."""


def nobody_acts(_: AgentSnapshot) -> Mapping[str, float]:
    """Nothing is staged."""
    return {}


def nobody_runs_red() -> frozenset[str]:
    """Red lights hold."""
    return frozenset()


@dataclass(frozen=True, slots=True, eq=False)
class TrafficSetup:
    """Everything that background traffic starts from."""

    network: SumoNetwork
    ids: NetworkIds
    types: VehicleTypes
    ego: EgoState
    ego_route: tuple[str, ...]
    """SUMO edges."""
    shape: EgoShape = PACIFICA
    spawns: tuple[Spawn, ...] = ()
    tokens: tuple[str, ...] = ()
    """Of `spawns`: the agents' ids as others see them."""
    standing: Actors = field(default_factory=Actors.none)
    """Obstacles."""
    blocked: tuple[LaneBlockage, ...] = ()
    """The stretches of lanes that they block."""
    crowd: People | None = None
    flow: Inflow | None = None
    """Brings more agents as time goes on."""
    presence: EgoPresence = EgoPresence.DRIVES
    logged: LoggedLights | None = None
    """Lights that show what was recorded."""
    lights: LightCycles | None = None
    """How lights go on from the start, where that is not from the beginning of their programs."""
    chance_seed: int = 0
    """For what agents decide by chance."""
    heights_m: Mapping[str, float] = field(default_factory=dict[str, float])
    """Of obstacles by id."""
    acts: Callable[[AgentSnapshot], Mapping[str, float]] = nobody_acts
    """How fast some agents, by SUMO's name, are to be at most after the next step: what is staged as time goes on."""
    runs_red: Callable[[], frozenset[str]] = nobody_runs_red
    """Agents, by SUMO's name, for whom red lights do not hold in the next step; asked after `acts`."""


class SumoTraffic:
    """Traffic on one SUMO network. Use as a context manager, or call `close`."""

    def __init__(self, setup: TrafficSetup) -> None:
        """Start SUMO, put everyone where they begin."""
        network, ids, types = setup.network, setup.ids, setup.types
        self._network = network
        self._ids = ids
        self._shape = setup.shape
        self._crowd = setup.crowd
        self._flow = setup.flow
        self._ego = setup.ego
        self._proxy: EgoProxy | None = None
        self._started = False
        self._logged = setup.logged
        self._acts = setup.acts
        self._runs_red = setup.runs_red
        self._step = 0
        self._added = 0
        self._entering: dict[str, Spawn] = {}
        self._speeding: dict[str, float] = {}  # agents that start above the limit -> their speeds
        self._lights = Lights(ids.links)
        self._signals: Signals | None = None
        self._states: dict[str, str] = {}
        self._switches_s: dict[str, float] = {}  # when the state of each light may be another one
        self._next_switch_s = 0.0
        self._before: StepBefore | None = None
        self._ax_without_ego: Mapping[str, float] = {}
        self._agents = AgentRegistry(types.path, setup.standing, setup.crowd, ids.origin_m, DT_S)
        self._agents.heights_m.update(setup.heights_m)
        drawn = [*(spawn.driver for spawn in setup.spawns), *(setup.flow.drivers if setup.flow is not None else ())]
        open_simulation(network.path, types.sumo_document(drawn, others=SLOW.values()))
        self._open = True
        try:
            known = {each.id: each for each in (*types.members, *types.others, *drawn)}
            self._drivers = {name: self._as_loaded(each) for name, each in known.items()}
            self._plain = setup.presence is EgoPresence.ABSENT
            self._control = AgentControl(self._agents.drivers, setup.chance_seed, plain=self._plain)
            self._first_seconds = FirstSeconds(self._agents.drivers, network, self._waiting_people, besides=EGO)
            self._reactions = EgoReactions(
                network, ids.origin_m, setup.shape, self._agents, setup.blocked, self._control.models
            )
            self._late_for_light = LateForLight(self._agents.drivers)
            self._posts = LanePosts(network, setup.standing, setup.blocked, ids.origin_m, self._agents.drivers)
            self._without_ego = WithoutEgo(network, ids.origin_m, self._agents, setup.blocked, self._choice_of)
            for token, each in zip(setup.tokens, setup.spawns, strict=True):
                self._add(token, each)
            block_lanes(network, setup.blocked)
            if setup.lights is not None:
                switch_lights(network.lights, setup.lights)
            if setup.presence is EgoPresence.DRIVES:
                self._proxy = EgoProxy(network, ids.origin_m, setup.shape, setup.ego_route, setup.ego)
            self.advance()
            if self._proxy is not None:
                self._proxy.enter(setup.ego)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> SumoTraffic:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        if self._open:
            self._open = False
            close_simulation()

    # --- set-up --------------------------------------------------------------------------------

    def _add(self, token: str, each: Spawn) -> None:
        """Have SUMO insert an agent with the next step."""
        name, lane = f"a{self._added}", self._network.lanes[each.lane]
        self._added += 1
        driver = self._drivers[each.driver.id]
        speeds = each.speed_mps > lane.limit_mps * driver.speed_factor + 1e-6  # only if the scenario places it so
        with Commanding("vehicle.add of an agent of type {!r} on lane {}", driver.name, each.lane):
            sumo.route.add(name, each.route)
            sumo.vehicle.add(
                name, name, driver.id, departLane=str(lane.index), departPos=f"{each.position_m:.6f}",
                departSpeed="max" if speeds else f"{each.speed_mps:.6f}",
            )  # fmt: skip
            if speeds:  # SUMO refuses a start above the limit
                self._speeding[name] = each.speed_mps
        self._agents.add(name, token, driver, each.route)
        self._entering[name] = each

    def _as_loaded(self, driver: VehicleType) -> VehicleType:
        """The type with the numbers that SUMO uses, its class defaults included."""
        with Commanding(f"reading vType {driver.id!r}"):
            get = sumo.vehicletype
            return replace(
                driver,
                length_m=get.getLength(driver.id),
                width_m=get.getWidth(driver.id),
                height_m=get.getHeight(driver.id),
                tau_s=get.getTau(driver.id),
                min_gap_m=get.getMinGap(driver.id),
                accel_mps2=get.getAccel(driver.id),
                decel_mps2=get.getDecel(driver.id),
                emergency_decel_mps2=get.getEmergencyDecel(driver.id),
                max_speed_mps=min(driver.max_speed_mps, get.getMaxSpeed(driver.id)),
            )

    # --- one step ------------------------------------------------------------------------------

    @property
    def drivers(self) -> Mapping[str, VehicleType]:
        """All types that SUMO knows, by id."""
        return self._drivers

    @property
    def agents(self) -> AgentRegistry:
        """Those that are there."""
        return self._agents

    @property
    def behaviours(self) -> Mapping[str, str]:
        return self._agents.behaviours

    @property
    def heights_m(self) -> Mapping[str, float]:
        return self._agents.heights_m

    def observe(self) -> TrafficState:
        return TrafficState(self._agents.actors(), self._read_signals(), self._ax_without_ego)

    def react(self, ego: EgoState) -> None:
        self._ego = ego
        if self._plain:
            self._control.keep_lanes(frozenset())
            return
        walking: Sequence[WayAhead] = ()
        standing: Mapping[str, shapely.Polygon] = {}
        if self._crowd is not None:
            self._crowd.notice(ego, self._shape)
            walking, standing = self._crowd.foreseen(self._ids.origin_m), self._crowd.standing(self._ids.origin_m)
        agents = self._agents.snapshot(self._lanes_of, self._positions_m, self._choice_of)
        self._control.relax(agents)
        met, anchor = (ego, self._proxy.anchor) if self._proxy is not None else (replace(ego, x_m=NOWHERE_M), None)
        commands = self._reactions.decide(met, anchor, walking, standing, agents)
        self._control.tell(agents, commands, self._posts.agents(agents), self._acts(agents))
        self._control.let_drive_on(self._late_for_light.agents(agents, self._next_switch_s), self._runs_red())
        if self._proxy is not None:
            told = (commands.for_ego_mps, commands.for_others_mps)
            self._before = StepBefore(ego, agents.names, agents.speed_mps, *told, self._control.overlooks_ego)

    def place_ego(self, ego: EgoState) -> None:
        if self._proxy is not None:
            self._proxy.place(ego)

    def impose_signals(self, wanted: Mapping[str, SignalStatus]) -> None:
        """Show connectors a status from now on until another is imposed; a light that is touched stops its program."""
        lights = sumo.trafficlight
        with Commanding("imposing signals"):
            concerned = {self._ids.links[each][0] for each in wanted if each in self._ids.links}
            states = {light: lights.getRedYellowGreenState(light) for light in concerned}
            for light, state in self._lights.imposed(wanted, states, self._network.lights).items():
                lights.setRedYellowGreenState(light, state)
        self._signals = None
        self._late_for_light.notice_switch()

    def advance(self) -> None:
        if self._flow is not None and self._started and self._flow.is_due():
            self._let_in_and_out(self._flow)
        with Commanding("simulationStep"):
            sumo.simulationStep()
            gone = frozenset(sumo.simulation.getArrivedIDList())
            departed = self._entering.keys() & sumo.simulation.getDepartedIDList() if self._entering else None
        if self._crowd is not None and self._started and self._crowd.advance():
            self._agents.notice_people()
        if self._logged is not None:
            self._step += self._started
            if changes := self._logged.changes(self._step):
                self.impose_signals(changes)
        self._started = True
        if gone:
            self._remove(gone & set(self._agents.names))
        self._control.grow_old()
        if departed:
            self._enter(departed)
        self._read()
        self._ask_without_ego()

    def _ask_without_ego(self) -> None:
        """What those that braked in this step because of the ego would have done without it."""
        found = {} if self._before is None else self._without_ego.accelerations(self._before)
        self._before = None
        self._ax_without_ego = {self._agents.token_of(name): value for name, value in found.items()}

    def _let_in_and_out(self, flow: Inflow) -> None:
        """Who comes and goes far from the ego."""
        agents = self._agents
        names, aside_of = agents.names, sumo.vehicle.getLateralLanePosition
        with Commanding("reading how far the agents are from the middle of their lanes"):
            asides_m = np.abs([aside_of(name) for name in names])
        moving, lanes, positions_m = agents.kinematics, self._lanes_of(names), self._positions_m(names)
        on = [self._network.lanes.get(lane) for lane in lanes]
        along_rad = [
            lane.plain_line.heading_at(lane.arc_of(position_m)) if lane is not None else 0.0
            for lane, position_m in zip(on, positions_m, strict=True)
        ]
        trailing_m = agents.length_m * np.abs(np.sin(moving.heading_rad - along_rad))
        asides_m += np.where(trailing_m > LANE_SLACK_M, trailing_m, 0.0)
        asides_m[sorted(moving.displaced)] += FREEZE_RADIUS_M
        there = OnTheRoad(
            names, lanes, positions_m, asides_m, moving.speed_mps,
            [agents.drivers[name] for name in names], agents.front_x, agents.front_y,
        )  # fmt: skip
        changes = flow.changes(there, self._ego, self._ids.origin_m, self._is_open)
        for entry in changes.entering:
            self._add(*entry)
            self._control.keep_lanes_a_while(self._beside(entry[1]))
        if changes.leaving:
            with Commanding("removing agents that are far away"):
                for name in changes.leaving:
                    sumo.vehicle.remove(name)
            self._remove(frozenset(changes.leaving))

    def _beside(self, each: Spawn) -> frozenset[str]:
        """Agents near one that is about to enter: none of them changes into its way before it has settled."""
        lane, agents = self._network.lanes[each.lane], self._agents
        place = lane.plain_line.pose_at(lane.arc_of(each.position_m))
        away_m = np.hypot(agents.front_x - place.x_m, agents.front_y - place.y_m)
        return frozenset([agents.names[row] for row in np.flatnonzero(away_m <= BESIDE_M)])

    def _remove(self, gone: frozenset[str]) -> None:
        """Agents at the end of their routes."""
        self._agents.remove(gone)
        for name in gone:
            self._reactions.forget(name)
            self._control.forget(name)

    def _enter(self, names: set[str]) -> None:
        """Agents that have entered with this step."""
        with Commanding("setting up agents that have entered"):
            for name in sorted(names & self._speeding.keys()):  # above the limit
                sumo.vehicle.setPreviousSpeed(name, self._speeding.pop(name), 0.0)
            names = self._settled({name: self._entering.pop(name) for name in names})
            self._agents.enter(names)
            self._control.enter(names)

    def _settled(self, spawns: Mapping[str, Spawn]) -> set[str]:
        """Those of them that can stay: who has not to brake hard, and, after the start, whom nobody brakes hard for."""
        leaving = {name for name in self._first_seconds.settle(spawns) if spawns[name].drawn}
        leaving |= self._first_seconds.disturbing(spawns.keys(), self._agents.names)
        for name in sorted(leaving):
            sumo.vehicle.remove(name)
        return spawns.keys() - leaving

    def _waiting_people(self) -> tuple[LaneBlockage, ...]:
        """The stretches of lanes in which people stand."""
        if self._crowd is None:
            return ()
        return blocked_by(self._network, self._crowd.standing(self._ids.origin_m).values(), 0.0)

    def _is_open(self, link: NetworkLink) -> bool:
        """Whether a car may drive through now without yielding."""
        if link.light is None:
            return link.major
        light, index = link.light
        with Commanding("reading light {}", light):
            shows = sumo.trafficlight.getRedYellowGreenState(light)[index]
            return shows == "G" and sumo.trafficlight.getNextSwitch(light) - sumo.simulation.getTime() > SOON_S

    # --- reading -------------------------------------------------------------------------------

    def _read(self) -> None:
        """Read all agents in one pass over plain getters, which are faster than subscriptions."""
        names = self._agents.names
        position, angle, speed = getters.vehicle_getPosition, getters.vehicle_getAngle, getters.vehicle_getSpeed
        with Commanding("reading the agents"):
            fronts = np.fromiter(chain.from_iterable(map(position, names)), np.float64, 2 * len(names))
            angles = np.fromiter(map(angle, names), np.float64, len(names))
            speeds = np.fromiter(map(speed, names), np.float64, len(names))
        self._agents.move(fronts, angles, speeds)

    def _read_signals(self) -> Signals:
        """The lights; asked for only when one of them may have switched."""
        with Commanding("reading the lights"):
            lights, now_s = sumo.trafficlight, sumo.simulation.getTime() + 1e-6
            if self._signals is None:
                self._switches_s = dict.fromkeys(self._lights.ids, 0.0)
                self._next_switch_s = 0.0
            if now_s >= self._next_switch_s or self._signals is None:
                for light in [light for light, at_s in self._switches_s.items() if now_s >= at_s]:
                    self._states[light] = lights.getRedYellowGreenState(light)
                    self._switches_s[light] = lights.getNextSwitch(light)
                self._next_switch_s = min(self._switches_s.values(), default=inf)
                self._signals = self._lights.signals([self._states[light] for light in self._lights.ids])
        return self._signals

    def _lanes_of(self, names: Sequence[str]) -> list[str]:
        with Commanding("reading the agents' lanes"):
            return list(map(getters.vehicle_getLaneID, names))

    def _positions_m(self, names: Sequence[str]) -> list[float]:
        with Commanding("reading the agents' positions"):
            return list(map(getters.vehicle_getLanePosition, names))

    def _choice_of(self, name: str) -> Sequence[str]:
        with Commanding("reading which lanes {!r} means to take", name):
            lane = sumo.vehicle.getLaneID(name)
            return next((each[5] for each in sumo.vehicle.getBestLanes(name) if each[0] == lane), ())
