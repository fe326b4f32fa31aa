"""Background traffic on libsumo: the only module that knows SUMO's calls and conventions.

One simulation per process. The ego is a proxy car on the centre line of one
lane; its true pose is kept by the closed loop and never read back.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import cos, hypot, inf, isfinite, sin
from typing import Any

import numpy as np
import shapely

from interplan_sumo.errors import TrafficError
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.simulation.anchor import Anchor, find_anchor
from interplan_sumo.simulation.bodies import Bodies, navigation_deg
from interplan_sumo.simulation.driving import Driving
from interplan_sumo.simulation.lights import Lights
from interplan_sumo.simulation.network import Network
from interplan_sumo.simulation.obstacles import Blockage
from interplan_sumo.simulation.pedestrians import Crowd
from interplan_sumo.simulation.reactions import Decision, Treatment
from interplan_sumo.simulation.spawning import Spawn
from interplan_sumo.simulation.traffic import Scene
from interplan_sumo.simulation.vehicle_types import ENTRY, VehicleType, VehicleTypes
from interplan_sumo.simulation.watch import Watch
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.signals import Signals, SignalStatus

# libsumo points PROJ at its own data when it is imported, which would break pyproj and GDAL in the same process.
_proj = {name: os.environ.get(name) for name in ("PROJ_LIB", "PROJ_DATA")}
import libsumo  # noqa: E402

for _name, _value in _proj.items():
    if _value is None:
        os.environ.pop(_name, None)
    else:
        os.environ[_name] = _value

sumo: Any = libsumo
"""libsumo, whose extension module carries no types."""

EGO = "ego"
EGO_TYPE = "interplan_ego"
DT_S = 0.1
SPEED_MODE_DEFAULT = 31
SPEED_MODE_IMPOSED = 25
"""Safe speed, right of way and red lights are kept; the bounds of acceleration and braking are ours."""
LANE_CHANGE_DEFAULT = 1621
LANE_CHANGE_NONE = 0
FREEZE_RADIUS_M = 40.0
"""Agents this near to an ego that straddles two lanes keep their lane, unless their type says `interplan.swerve`."""
KEEP_ROUTE = 1
ANYWHERE = 2
_KINDS = {"pedestrian": ActorKind.PEDESTRIAN, "bicycle": ActorKind.BICYCLE}

_is_open = False


class _Commanding:
    """Turns whatever libsumo raises inside into a TrafficError that names the command."""

    __slots__ = ("_what",)

    def __init__(self, what: str) -> None:
        self._what = what

    def __enter__(self) -> None:
        """Nothing to prepare."""

    def __exit__(self, _kind: object, error: BaseException | None, _where: object) -> None:
        if isinstance(error, sumo.TraCIException | sumo.FatalTraCIError | TypeError):
            raise TrafficError(f"SUMO failed at {self._what}: {error}") from error


class SumoTraffic:
    """Traffic on one SUMO network. Use as a context manager, or call `close`."""

    def __init__(
        self,
        network: Network,
        ids: NetworkIds,
        types: VehicleTypes,
        spawns: tuple[Spawn, ...],
        tokens: tuple[str, ...],
        ego: EgoState,
        ego_route: tuple[str, ...],
        shape: EgoShape,
        *,
        standing: Actors | None = None,
        blocked: tuple[Blockage, ...] = (),
        crowd: Crowd | None = None,
        with_ego: bool = True,
    ) -> None:
        """Start SUMO, put everyone where they begin.

        `tokens` are the agents' ids as others see them. `ego_route` are SUMO
        edges. `standing` are obstacles, `blocked` the stretches of lanes that
        they block. `with_ego` False leaves the ego out of SUMO altogether:
        the twin run against which reactions are measured.
        """
        global _is_open
        if _is_open:
            raise TrafficError("SUMO is already running in this process; close the other SumoTraffic first")
        self._network = network
        self._ids = ids
        self._shape = shape
        self._standing = standing if standing is not None else Actors.none()
        self._crowd = crowd
        self._origin = ids.origin_m
        self._with_ego = with_ego
        self._treated: dict[str, tuple[bool, bool]] = {}  # told to overlook the ego, given a speed
        self._frozen: set[str] = set()
        self._anchor: Anchor | None = None
        self._ego_route = ego_route
        self._strayed = False
        self._started = False
        self._bodies = Bodies(DT_S)
        self._signals: Signals | None = None
        self._next_switch_s = 0.0
        self._lights = Lights(ids.links)
        command = [
            "sumo", "--net-file", str(network.path), "--additional-files", str(types.path), "--step-length", str(DT_S),
            "--collision.action", "none", "--time-to-teleport", "-1", "--insertion-checks", "none",
            "--lanechange.duration", "3", "--default.speeddev", "0", "--no-step-log", "true",
            "--no-warnings", "true", "--xml-validation", "never", "--xml-validation.net", "never",
        ]  # fmt: skip
        with _Commanding(f"start with {network.path.name} and {types.path.name}"):
            sumo.start(command)
        self._open = _is_open = True
        try:
            self._spawn(types, spawns, tokens, blocked)
            self._block(blocked)
            if with_ego:
                self._add_ego(ego)
            self.advance()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> SumoTraffic:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        global _is_open
        if self._open:
            self._open = _is_open = False
            sumo.close()

    # --- set-up --------------------------------------------------------------------------------

    def _spawn(
        self, types: VehicleTypes, spawns: tuple[Spawn, ...], tokens: tuple[str, ...], blocked: tuple[Blockage, ...]
    ) -> None:
        drivers = {driver.id: self._as_loaded(driver) for driver in (*types.members, *types.others)}
        self._names = [f"a{i}" for i in range(len(spawns))]
        self._tokens = dict(zip(self._names, tokens, strict=True))
        self._drivers = {name: drivers[s.driver.id] for name, s in zip(self._names, spawns, strict=True)}
        self._behaviours = {
            self._tokens[name]: types.path.stem if driver.id == ENTRY else driver.id
            for name, driver in self._drivers.items()
        }
        routes = {name: s.route for name, s in zip(self._names, spawns, strict=True)}
        self._watch = Watch(self._network, self._origin, self._shape, self._drivers, routes, blocked, DT_S)
        for name, each in zip(self._names, spawns, strict=True):
            lane = self._network.lanes[each.lane]
            with _Commanding(f"vehicle.add of an agent of type {each.driver.id!r} on lane {each.lane}"):
                sumo.route.add(name, each.route)
                sumo.vehicle.add(
                    name, name, each.driver.id, departLane=str(lane.index), departPos=f"{each.position_m:.6f}",
                    departSpeed=f"{each.speed_mps:.6f}",
                )  # fmt: skip
        self._present = sorted(self._names, key=self._tokens.__getitem__)
        self._index_present()

    def _block(self, blocked: tuple[Blockage, ...]) -> None:
        """Stopped proxies where obstacles block a lane; nobody but SUMO's own drivers sees them."""
        for i, each in enumerate(blocked):
            name, lane = f"obstacle{i}", self._network.lanes[each.lane]
            length_m = max(0.5, each.end_m - each.start_m)
            front_m = round(min(max(each.end_m, length_m), lane.length_m) - 0.005, 2)
            with _Commanding(f"blocking lane {each.lane} at {each.start_m:.1f} m"):
                sumo.vehicletype.copy("DEFAULT_VEHTYPE", name)
                sumo.vehicletype.setLength(name, length_m)
                sumo.route.add(name, (lane.edge,))
                sumo.vehicle.add(
                    name, name, name, departLane=str(lane.index), departPos=f"{front_m:.2f}", departSpeed="0"
                )
                sumo.vehicle.setStop(name, lane.edge, front_m, lane.index, 1e6)
                sumo.vehicle.setLaneChangeMode(name, LANE_CHANGE_NONE)

    def _as_loaded(self, driver: VehicleType) -> VehicleType:
        """The type with the numbers that SUMO uses, its class defaults included."""
        with _Commanding(f"reading vType {driver.id!r}"):
            get = sumo.vehicletype
            return replace(
                driver,
                length_m=get.getLength(driver.id),
                width_m=get.getWidth(driver.id),
                tau_s=get.getTau(driver.id),
                min_gap_m=get.getMinGap(driver.id),
                accel_mps2=get.getAccel(driver.id),
                decel_mps2=get.getDecel(driver.id),
                emergency_decel_mps2=get.getEmergencyDecel(driver.id),
                max_speed_mps=get.getMaxSpeed(driver.id),
                speed_factor=get.getSpeedFactor(driver.id),
            )

    def _index_present(self) -> None:
        """Columns that do not change from step to step, for the agents still there."""
        drivers = [self._drivers[name] for name in self._present]
        self._half_m = np.array([d.length_m for d in drivers]) / 2.0
        walkers = self._crowd.observe() if self._crowd is not None else Actors.none()
        others = (self._standing, walkers)
        tokens = [*(self._tokens[name] for name in self._present), *self._standing.ids, *walkers.ids]
        self._order = np.argsort(np.array(tokens, dtype=object), kind="stable")
        self._ids_in_order = tuple(tokens[i] for i in self._order)
        kinds = [_KINDS.get(sumo.vehicletype.getVehicleClass(d.id), ActorKind.VEHICLE) for d in drivers]
        self._kinds = np.concatenate((np.array(kinds, dtype=np.int8), *(a.kind for a in others)))[self._order]
        self._lengths_m = np.concatenate(([d.length_m for d in drivers], *(a.length_m for a in others)))[self._order]
        self._widths_m = np.concatenate(([d.width_m for d in drivers], *(a.width_m for a in others)))[self._order]

    def _add_ego(self, ego: EgoState) -> None:
        with _Commanding("adding the ego"):
            kind = sumo.vehicletype
            kind.copy("DEFAULT_VEHTYPE", EGO_TYPE)
            kind.setLength(EGO_TYPE, self._shape.length_m)
            kind.setWidth(EGO_TYPE, self._shape.width_m)
            kind.setSpeedDeviation(EGO_TYPE, 0.0)
            kind.setSpeedFactor(EGO_TYPE, 5.0)
            kind.setMaxSpeed(EGO_TYPE, 60.0)
            sumo.route.add(EGO, self._ego_route)
            speed_mps = max(0.0, ego.speed_mps)
            sumo.vehicle.add(EGO, EGO, EGO_TYPE, departLane="0", departPos="0", departSpeed=f"{speed_mps:.6f}")
            sumo.vehicle.setSpeedMode(EGO, 32)
            sumo.vehicle.setLaneChangeMode(EGO, LANE_CHANGE_NONE)
        self.place_ego(ego)

    # --- one step ------------------------------------------------------------------------------

    @property
    def behaviours(self) -> Mapping[str, str]:
        return self._behaviours

    def observe(self) -> Scene:
        cosine, sine = np.cos(self._heading_rad), np.sin(self._heading_rad)
        columns = [
            self._front_x + self._origin[0] - self._half_m * cosine,
            self._front_y + self._origin[1] - self._half_m * sine,
            self._heading_rad,
            self._speed_mps * cosine,
            self._speed_mps * sine,
        ]
        others = [self._standing] if len(self._standing) else []
        if self._crowd is not None:
            others.append(self._crowd.observe())
        if others:
            names = ("x_m", "y_m", "heading_rad", "vx_mps", "vy_mps")
            rest = ([getattr(actors, name) for actors in others] for name in names)
            columns = [np.concatenate((column, *more)) for column, more in zip(columns, rest, strict=True)]
        x_m, y_m, heading_rad, vx_mps, vy_mps = (column[self._order] for column in columns)
        actors = Actors.trusted(
            self._ids_in_order, self._kinds, x_m, y_m, heading_rad, self._lengths_m, self._widths_m, vx_mps, vy_mps
        )
        return Scene(actors, self._read_signals())

    def react(self, ego: EgoState) -> None:
        if not self._with_ego:
            return
        walked: Sequence[shapely.Polygon] = ()
        standing: Mapping[str, shapely.Polygon] = {}
        if self._crowd is not None:
            self._crowd.notice(ego, self._shape)
            walked, standing = self._crowd.foreseen(self._origin), self._crowd.standing(self._origin)
        driving = Driving(
            self._present,
            self._front_x,
            self._front_y,
            self._heading_rad,
            self._speed_mps,
            self._bodies.turned_rad,
            self._bodies.most_turned_rad,
            self._lanes_now,
            self._position_m,
        )
        verdict = self._watch.judge(ego, self._anchor, walked, standing, driving)
        for name, decision in verdict.decisions.items():
            self._treat(name, decision)
        self._freeze(ego, verdict.straddles)

    def place_ego(self, ego: EgoState) -> None:
        if not self._with_ego:
            return
        x_m, y_m, heading_rad, speed_mps = _finite(
            "the ego's pose", ego.x_m - self._origin[0], ego.y_m - self._origin[1], ego.heading_rad, ego.speed_mps
        )
        reach_m = self._shape.length_m / 2.0
        front = (x_m + reach_m * cos(heading_rad), y_m + reach_m * sin(heading_rad))
        anchor = find_anchor(self._network, front, heading_rad, self._anchor, self._ego_route)
        if anchor is not None and not self._touches_road(ego, front, anchor):
            anchor = None
        self._anchor = anchor
        with _Commanding(f"moveToXY of the ego to ({ego.x_m:.2f}, {ego.y_m:.2f})"):
            sumo.vehicle.setSpeed(EGO, max(0.0, speed_mps))
            if anchor is None:
                sumo.vehicle.moveToXY(EGO, "", -1, *self._network.nowhere, 0.0, ANYWHERE)
                self._strayed = True
                return
            lane = self._network.lanes[anchor.lane]
            angle_deg = navigation_deg(anchor.heading_rad)
            keep = KEEP_ROUTE if anchor.on_route and self._is_on_route() else ANYWHERE
            self._strayed = keep is ANYWHERE
            sumo.vehicle.moveToXY(EGO, lane.edge, lane.index, anchor.x_m, anchor.y_m, angle_deg, keep)

    def _is_on_route(self) -> bool:
        """Whether SUMO's ego has its route; wherever it is put beside it, SUMO gives it another."""
        if not self._strayed:
            return True
        lane = sumo.vehicle.getLaneID(EGO)  # getRoadID would crash while the ego is nowhere
        if not lane or lane.startswith(":"):
            return False  # SUMO takes no new route inside a junction
        edge = sumo.vehicle.getRoute(EGO)[sumo.vehicle.getRouteIndex(EGO)]
        if edge not in self._ego_route:
            return False
        sumo.vehicle.setRoute(EGO, self._ego_route[self._ego_route.index(edge) :])
        return True

    def _touches_road(self, ego: EgoState, front: tuple[float, float], anchor: Anchor) -> bool:
        """Off the road nobody minds the ego, so SUMO must not see it either."""
        if hypot(anchor.x_m - front[0], anchor.y_m - front[1]) < self._shape.width_m / 2.0:
            return True
        return self._network.touches_lane(shapely.Polygon(ego.corners(self._shape) - self._origin))

    def impose_signals(self, wanted: Mapping[str, SignalStatus]) -> None:
        """Show connectors a status from now on until another is imposed; a light that is touched stops its program."""
        lights = sumo.trafficlight
        with _Commanding("imposing signals"):
            concerned = {self._ids.links[each][0] for each in wanted if each in self._ids.links}
            states = {light: lights.getRedYellowGreenState(light) for light in concerned}
            for light, state in self._lights.imposed(wanted, states, self._network.programs).items():
                lights.setRedYellowGreenState(light, state)
        self._signals = None

    def advance(self) -> None:
        with _Commanding("simulationStep"):
            sumo.simulationStep()
            arrived = sumo.simulation.getArrivedIDList()
        if self._crowd is not None and self._started:
            self._crowd.advance()
        self._started = True
        if arrived:
            gone = set(arrived)
            self._bodies.keep([name not in gone for name in self._present])
            self._present = [name for name in self._present if name not in gone]
            self._index_present()
            for name in gone:
                self._watch.forget(name)
                self._treated.pop(name, None)
                self._frozen.discard(name)
        self._read()

    # --- reading -------------------------------------------------------------------------------

    def _read(self) -> None:
        """Read all agents in one pass over plain getters, which are faster than subscriptions."""
        vehicle = sumo.vehicle
        with _Commanding("reading the agents"):
            position = vehicle.getPosition
            fronts = [position(name) for name in self._present]
            angles = [vehicle.getAngle(name) for name in self._present]
            speeds = [vehicle.getSpeed(name) for name in self._present]
        self._bodies.move(fronts, angles, speeds)
        self._front_x, self._front_y = self._bodies.front_m.T
        self._heading_rad, self._speed_mps = self._bodies.heading_rad, self._bodies.speed_mps

    def _read_signals(self) -> Signals:
        """The lights; asked for only when one of them may have switched."""
        with _Commanding("reading the lights"):
            lights = sumo.trafficlight
            if self._signals is None or sumo.simulation.getTime() >= self._next_switch_s - 1e-6:
                states = [lights.getRedYellowGreenState(light) for light in self._lights.ids]
                self._next_switch_s = min((lights.getNextSwitch(light) for light in self._lights.ids), default=inf)
                self._signals = self._lights.signals(states)
        return self._signals

    # --- reacting ------------------------------------------------------------------------------

    def _lanes_now(self) -> list[str]:
        with _Commanding("reading the agents' lanes"):
            return [sumo.vehicle.getLaneID(name) for name in self._present]

    def _position_m(self, name: str) -> float:
        with _Commanding("reading an agent"):
            return sumo.vehicle.getLanePosition(name)

    def _treat(self, name: str, decision: Decision) -> None:
        ignored, imposed = self._treated.get(name, (False, False))
        ignore, impose = decision.treatment is Treatment.IGNORE, decision.speed_mps is not None
        vehicle = sumo.vehicle
        with _Commanding(f"treating agent {name}: {decision.treatment.value}"):
            if ignore != ignored:
                vehicle.setParameter(name, "carFollowModel.ignoreIDs", EGO if ignore else "")
                vehicle.setParameter(name, "junctionModel.ignoreIDs", EGO if ignore else "")
            if impose and not imposed:
                vehicle.setSpeedMode(name, SPEED_MODE_IMPOSED)
            if decision.speed_mps is not None:
                vehicle.setSpeed(name, *_finite("an imposed speed", decision.speed_mps))
            elif imposed:
                vehicle.setSpeed(name, -1.0)
                vehicle.setSpeedMode(name, SPEED_MODE_DEFAULT)
        self._treated[name] = (ignore, impose)

    def _freeze(self, ego: EgoState, straddles: bool) -> None:
        """Agents near an ego that straddles two lanes keep theirs; released as soon as it no longer does."""
        wanted: set[str] = set()
        if straddles:
            dx = self._front_x + self._origin[0] - ego.x_m
            dy = self._front_y + self._origin[1] - ego.y_m
            near = np.flatnonzero(dx * dx + dy * dy <= FREEZE_RADIUS_M**2)
            wanted = {self._present[i] for i in near if not self._drivers[self._present[i]].swerve}
        if wanted == self._frozen:
            return
        with _Commanding("setLaneChangeMode"):
            for name in sorted(wanted - self._frozen):
                sumo.vehicle.setLaneChangeMode(name, LANE_CHANGE_NONE)
            for name in sorted(self._frozen - wanted):
                sumo.vehicle.setLaneChangeMode(name, LANE_CHANGE_DEFAULT)
        self._frozen = wanted


def _finite(what: str, *numbers: float) -> tuple[float, ...]:
    """Plain floats, rounded to 1e-6; libsumo would accept nan and keep it for good."""
    values = tuple(round(float(number), 6) for number in numbers)
    if not all(map(isfinite, values)):
        raise TrafficError(f"{what} holds a number that is not finite: {values}")
    return values
