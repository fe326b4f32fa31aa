"""The first seconds of agents: each one's own SUMO model is asked whether it would brake hard at its start speed.

Start speeds are worked out with the Intelligent Driver Model, for the first
moment. Other models want other gaps, and braking grows as one comes nearer. SUMO
answers for an agent as soon as it is on the road, before anybody has seen it drive.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf

import shapely

from interplan_sumo.simulation.agent_control import apparent_decel_mps2
from interplan_sumo.simulation.lane_chains import ChainedLane, limits_and_turns, way_ahead
from interplan_sumo.simulation.network import NetworkLane, SumoNetwork
from interplan_sumo.simulation.obstacles import LaneBlockage
from interplan_sumo.simulation.start_speed import ERRING_MODEL, LINE_M, hardest_mps2, safe, speeds_ahead_mps
from interplan_sumo.simulation.sumo import DT_S, finite, sumo
from interplan_sumo.simulation.vehicle_types import VehicleType

STEPS = 20
HARDEST_MPS2 = 2.6
"""Milder than the 3 m/s2 that the benchmark allows in the first two seconds: not everything ahead is foreseen."""
CALM_MODELS = frozenset({"IDM", "IDMM", "EIDM", "Krauss", "KraussPS", "KraussX"})
"""The other models answer small differences with hard braking: they hold, too, if the next one ahead brakes."""
TWITCHY_MPS2, LEADER_BRAKES_MPS2 = 1.0, (0.5, 1.0, 2.0)
MOST_CLOSING_MPS = {"ACC": 2.4, "CACC": 1.5}
"""Models that brake in proportion to the difference in speed, however far away the next one ahead is."""
MOST_ABOVE = 1.02
"""Drivers that err brake up to twice as hard as others for their own desired speed; this is times that speed."""
ASKED_AT_ITS_SPEED = "Wiedemann"
"""This model answers for the speed that its car has, whatever other speed it is asked about."""
EARLY_MODELS = frozenset({"IDM", "IDMM", "EIDM", "KraussOrig1", "PWagner2009"})
ERRS_BY = 2.0
"""So many times as hard as foreseen a driver that errs may brake: those behind it reckon with that."""
LIGHT_MPS2 = 3.0
"""SUMO's `tls.yellow.min-decel`, for red lights as well."""
CLOSINGS = (0, 7, 14, 19)
"""Steps at which somebody may come who has the right of way."""
SHARES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.0)
"""Of a start speed; the first is taken that its model holds."""
CREEPS = 0.25
"""Who has to start with less of its speed stands in others' way, or they in its."""
FOES_M = 80.0
"""So far ahead are junctions of which it has to know who is in them."""
CREEPING_MPS = 0.3
"""Who is slower before a junction waits there."""
AHEAD_M = 150.0
"""So far ahead, and behind, an agent has others to reckon with."""
SLOWS_M = 90.0
"""So far ahead it slows down for lower limits."""
SLOWS_MPS2 = 0.5
"""Before that takes as much it does not."""
MAY_QUEUE, QUEUES_MPS2 = 0.75, 0.5
"""Who is slower than this share of one's own speed, or brakes so hard, may be about to queue."""
COMING_MPS = 0.1
"""Who moves sideways faster than that changes lane."""
MEETS_M = 0.1
"""Lines as near as that meet: some of those that end in one lane do so but nearly."""
_MINE_M, _OTHERS_M = 1, 2
"""In what `getJunctionFoes` answers of each: how far both are from where their ways meet."""


@dataclass(frozen=True, slots=True)
class _Leader:
    """The next one ahead of an agent."""

    name: str
    """Empty: somebody who stands there and is no vehicle of SUMO's."""
    net_m: float
    """The gap to it beyond the agent's least one."""
    speeds_mps: list[float]
    """Now and in the next steps."""
    gap_m: float = inf
    """The gap itself to one that drives in the same lane."""
    crosses_m: float = 0.0
    """How far ahead it crosses the way, if it does: nobody minds it who stops before that."""

    def braking(self, rate_mps2: float) -> _Leader:
        """The same one if it brakes all the while."""
        speeds = (self.speeds_mps[min(k, len(self.speeds_mps) - 1)] for k in range(STEPS + 1))
        brakes = (self.speeds_mps[0] - rate_mps2 * DT_S * k for k in range(STEPS + 1))
        return replace(self, speeds_mps=[max(0.0, min(pair)) for pair in zip(speeds, brakes, strict=True)])


@dataclass(frozen=True, slots=True)
class _Foreseen:
    """What is known of an agent's first seconds."""

    speeds_mps: list[float]
    """Now and in the next steps."""
    mild: bool = True
    """Whether it comes through them without hard braking."""


_Slower = Sequence[tuple[float, float]]
"""Where lower limits begin ahead, in metres, and how fast an agent drives there."""


@dataclass(frozen=True, slots=True)
class _Line:
    """A line ahead."""

    away_m: float
    closings: tuple[int, ...]
    """Steps from which on it may not be crossed: one of them, nobody knows which."""
    light: bool
    """Whether a light holds it."""

    def stops(self, driver: VehicleType, room_m: float, speed_mps: float) -> bool:
        """Whether a car brakes for it by now; before lights SUMO's other models wait until that takes 3 m/s2."""
        early = not self.light or driver.car_following_model in EARLY_MODELS
        return early or speed_mps * speed_mps >= 2.0 * LIGHT_MPS2 * room_m


class FirstSeconds:
    """Slows down those that have just come, where their own models would brake hard."""

    def __init__(
        self, drivers: Mapping[str, VehicleType], network: SumoNetwork, waiting: Callable[[], Iterable[LaneBlockage]],
        *, besides: str,
    ) -> None:  # fmt: skip
        """`drivers` by agent, as they come; the vehicle `besides` is overlooked: it is the ego.

        `waiting` tells where people, whom SUMO does not know, stand in lanes.
        """
        self._drivers = drivers
        self._network = network
        self._waiting = waiting
        self._besides = besides

    def settle(self, names: Collection[str]) -> set[str]:
        """Lower the speeds of agents that have come with this step, as far as needed.

        Those are returned that would have to creep, or even then brake hard: before a light about to switch, say.
        """
        foreseen: dict[str, _Foreseen] = {}
        waiting = tuple(self._waiting())
        for name in sorted(names):
            self._foresee(name, names, foreseen, waiting)
        return {name for name in names if not foreseen[name].mild}

    def disturbing(self, names: Collection[str], there: Iterable[str]) -> set[str]:
        """Those of `names`, which have just come, that somebody who is there would brake hard for, on whatever way."""
        vehicle, found = sumo.vehicle, set[str]()
        for behind in there:
            first = vehicle.getLeader(behind, AHEAD_M)
            if first is None or first[0] not in names or first[0] in found:
                continue
            leader = _Leader(first[0], first[1], [vehicle.getSpeed(first[0])])
            if not self._comes_through(behind, vehicle.getSpeed(behind), (leader,), _line(behind)):
                found.add(first[0])
        return found

    def _comes_through(self, name: str, now_mps: float, leaders: Sequence[_Leader], line: _Line | None) -> bool:
        """Whether an agent that drives at a speed now does not brake hard, whenever its line closes."""
        closings = line.closings if line is not None else (0,)
        if now_mps > 0.0 and not all(safe(now_mps, each.gap_m, each.speeds_mps[0]) for each in leaders):
            return False
        return all(
            self._is_mild(name, self._driven(name, now_mps, leaders, line, each), leaders, line, each)
            for each in closings
        )

    def _is_mild(
        self, name: str, speeds_mps: list[float], leaders: Sequence[_Leader], line: _Line | None, closes: int
    ) -> bool:
        model = self._drivers[name].car_following_model
        if model == ERRING_MODEL and speeds_mps[0] > MOST_ABOVE * sumo.vehicle.getAllowedSpeed(name):
            return False
        if model in CALM_MODELS:
            return _hardest_braking_mps2(speeds_mps) <= hardest_mps2(self._drivers[name], HARDEST_MPS2)
        if any(speeds_mps[0] > each.speeds_mps[0] + MOST_CLOSING_MPS.get(model, inf) for each in leaders):
            return False
        found = [speeds_mps]
        for rate_mps2 in LEADER_BRAKES_MPS2 if leaders else ():
            brake = [each.braking(rate_mps2) for each in leaders]
            found.append(self._driven(name, speeds_mps[0], brake, line, closes))
        return all(_hardest_braking_mps2(each) <= TWITCHY_MPS2 for each in found)

    def _foresee(
        self, name: str, asked: Collection[str], foreseen: dict[str, _Foreseen], waiting: Sequence[LaneBlockage]
    ) -> list[float]:
        """The speeds of an agent from now on, after those of all ahead of it; one that is `asked` may start slower."""
        if name in foreseen:
            return foreseen[name].speeds_mps
        now_mps = max(0.0, sumo.vehicle.getSpeed(name))
        foreseen[name] = _Foreseen([now_mps] * (STEPS + 1))  # in a ring everybody is ahead of everybody
        leaders, line = self._leaders(name, asked, foreseen, waiting), _line(name)
        start_mps, mild = self._start_mps(name, now_mps, leaders, line) if name in asked else (now_mps, True)
        closes = line.closings[0] if line is not None else 0
        found = self._driven(name, start_mps, leaders, line, closes, self._slower(name))
        if start_mps < now_mps:
            sumo.vehicle.setPreviousSpeed(name, finite("a start speed", start_mps), 0.0)
        if self._drivers[name].car_following_model == ERRING_MODEL:
            found = [max(0.0, min(each, found[0] - ERRS_BY * (found[0] - each))) for each in found]
        if name not in asked:
            found = _braking_on(found, sumo.vehicle.getAcceleration(name))
        foreseen[name] = _Foreseen(found, mild)
        return found

    def _start_mps(
        self, name: str, now_mps: float, leaders: Sequence[_Leader], line: _Line | None
    ) -> tuple[float, bool]:
        """The highest share of its speed with which it comes through, and whether that is no creeping.

        Who errs comes through, too, if the next junction has to be kept clear, where any share allows that.
        """
        errs = self._drivers[name].car_following_model == ERRING_MODEL
        besides = (_may_be_kept_clear(name),) if errs else ()
        chosen: float | None = None
        for speed_mps in (now_mps * share for share in SHARES):
            if self._comes_through(name, speed_mps, leaders, line):
                chosen = speed_mps if chosen is None else chosen
                if all(self._comes_through(name, speed_mps, leaders, each) for each in besides):
                    chosen = speed_mps
                    break
        return (0.0, False) if chosen is None else (chosen, chosen >= CREEPS * now_mps)

    def _slower(self, name: str) -> _Slower:
        """Where lanes with lower limits begin ahead, or turns, and how fast the agent drives there."""
        way, here_m = self._way(name, SLOWS_M)
        ahead = speeds_ahead_mps(self._drivers[name], *limits_and_turns(way, here_m)) if way else ()
        return tuple(each for each in ahead if each[0] <= SLOWS_M)

    def _way(self, name: str, reach_m: float) -> tuple[list[ChainedLane], float]:
        """The lanes up to so far ahead, and how far along the first one an agent is; none for who is in a junction."""
        vehicle, lane = sumo.vehicle, sumo.vehicle.getLaneID(name)
        if lane.startswith(":"):
            return [], 0.0
        here_m, route = vehicle.getLanePosition(name), vehicle.getRoute(name)[vehicle.getRouteIndex(name) :]
        return way_ahead(self._network, lane, tuple(route), here_m + reach_m), here_m

    def _leaders(
        self, name: str, asked: Collection[str], foreseen: dict[str, _Foreseen], waiting: Sequence[LaneBlockage]
    ) -> list[_Leader]:
        """The next one ahead, and whoever crosses its way in the next junction: SUMO's cars keep behind those, too."""
        found: dict[str, tuple[float, float, float]] = {}
        least_m = self._drivers[name].min_gap_m
        near = [(foe[0], foe[_MINE_M], foe[_OTHERS_M]) for foe in sumo.vehicle.getJunctionFoes(name, FOES_M)]
        for other, mine_m, others_m in self._in_junctions_ahead(name) + near:
            if other != self._besides and other in self._drivers and _in_junction_soon(other):
                found[other] = mine_m - others_m - self._drivers[other].length_m - least_m, inf, mine_m
        first = sumo.vehicle.getLeader(name, AHEAD_M)
        in_lane = [(first[0], first[1])] if first is not None and first[0] else []
        for other, net_m in in_lane + self._coming_in(name):
            if other != self._besides:
                found[other] = net_m, net_m + least_m, 0.0
        lane, here_m = sumo.vehicle.getLaneID(name), sumo.vehicle.getLanePosition(name)
        people_m = [each.start_m - here_m for each in waiting if each.lane == lane and each.start_m > here_m]
        people = [_Leader("", min(people_m) - least_m, [0.0], min(people_m))] if people_m else []
        return people + [
            _Leader(
                other, net_m, self._foresee(other, asked, foreseen, waiting) if other in self._drivers else [0.0],
                gap_m, crosses_m,
            )  # an obstacle has no driver
            for other, (net_m, gap_m, crosses_m) in found.items()
        ]  # fmt: skip

    def _in_junctions_ahead(self, name: str) -> list[tuple[str, float, float]]:
        """Who is on a way that crosses the agent's, and how far both are from there.

        Where roads have several lanes `getJunctionFoes` leaves out some of them.
        """
        vehicle, (way, here_m) = sumo.vehicle, self._way(name, FOES_M)
        found: list[tuple[str, float, float]] = []
        for part in way:
            if not part.lane.internal or part.start_m - here_m > FOES_M:
                continue
            for foe in sumo.lane.getInternalFoes(part.lane.id):
                if (meeting := _meeting(part.lane, self._network.lanes[foe])) is None:
                    continue
                for other in sumo.lane.getLastStepVehicleIDs(foe):
                    others_m = meeting[1] - vehicle.getLanePosition(other)
                    if others_m + vehicle.getLength(other) > 0.0:
                        found.append((other, part.start_m + meeting[0] - here_m, others_m))
        return found

    def _coming_in(self, name: str) -> list[tuple[str, float]]:
        """Who is ahead in the lanes beside an agent and moves towards its own, with net gaps."""
        vehicle, lane = sumo.vehicle, self._network.lanes[sumo.vehicle.getLaneID(name)]
        front_m, least_m = vehicle.getLanePosition(name), self._drivers[name].min_gap_m
        found: list[tuple[str, float]] = []
        for beside, towards in ((lane.index + 1, -1.0), (lane.index - 1, 1.0)):
            if (side := f"{lane.edge}_{beside}") not in self._network.lanes:
                continue
            for other in sumo.lane.getLastStepVehicleIDs(side):
                ahead_m = vehicle.getLanePosition(other) - front_m
                if ahead_m > 0.0 and vehicle.getLateralSpeed(other) * towards > COMING_MPS:
                    found.append((other, ahead_m - vehicle.getLength(other) - least_m))
        return found

    def _driven(
        self, name: str, speed_mps: float, leaders: Sequence[_Leader], line: _Line | None, closes: int,
        slower: _Slower = (),
    ) -> list[float]:  # fmt: skip
        """The agent's speeds from now on, if it drives at one now, and its line closes at a step.

        When it brakes for what is `slower` ahead is the model's secret: evenly is a guess, good enough for a leader.
        """
        driver, vehicle = self._drivers[name], sumo.vehicle
        found, way_m = [speed_mps], 0.0
        light_m = line.away_m if line is not None and line.light else inf
        met = [each for each in leaders if max(each.net_m, each.crosses_m) <= light_m]
        ahead = [(each, apparent_decel_mps2(each.name)) for each in met]
        led_m = [0.0] * len(ahead)
        has_mps = vehicle.getSpeed(name) if driver.car_following_model == ASKED_AT_ITS_SPEED else None
        for k in range(STEPS):
            now_mps = found[-1]
            if has_mps is not None:
                vehicle.setPreviousSpeed(name, finite("a speed to ask about", now_mps), 0.0)
            next_mps = now_mps + driver.accel_mps2 * DT_S
            for i, (leader, decel_mps2) in enumerate(ahead):
                net_m, led_mps = leader.net_m + led_m[i] - way_m, leader.speeds_mps[min(k, len(leader.speeds_mps) - 1)]
                next_mps = min(next_mps, vehicle.getFollowSpeed(name, now_mps, net_m, led_mps, decel_mps2, leader.name))
                led_m[i] += led_mps * DT_S
            next_mps = min(next_mps, _slowing_down(now_mps, way_m, slower, driver.decel_mps2))
            if line is not None and k >= closes:
                room_m = max(0.0, line.away_m - way_m)
                if line.stops(driver, room_m, now_mps):
                    next_mps = min(next_mps, vehicle.getStopSpeed(name, now_mps, room_m))
            found.append(max(0.0, next_mps, now_mps - driver.emergency_decel_mps2 * DT_S))
            way_m += found[-1] * DT_S
        if has_mps is not None:
            vehicle.setPreviousSpeed(name, has_mps, 0.0)
        return found


def _may_be_kept_clear(name: str) -> _Line | None:
    """The next junction, where a queue before a light may soon leave no room: SUMO's cars keep junctions clear."""
    vehicle = sumo.vehicle
    lane, leader, speed_mps = vehicle.getLaneID(name), vehicle.getLeader(name, AHEAD_M), vehicle.getSpeed(name)
    if lane.startswith(":") or leader is None or not leader[0]:
        return None
    if vehicle.getSpeed(leader[0]) > MAY_QUEUE * speed_mps and vehicle.getAcceleration(leader[0]) > -QUEUES_MPS2:
        return None
    if not any(away_m <= AHEAD_M and state != "G" for _, _, away_m, state in vehicle.getNextTLS(name)[:1]):
        return None
    return _Line(sumo.lane.getLength(lane) - vehicle.getLanePosition(name) - LINE_M, CLOSINGS, light=False)


def _slowing_down(speed_mps: float, way_m: float, slower: _Slower, brakes_mps2: float) -> float:
    """How fast an agent is after the next step that slows down evenly for lower limits, `way_m` along its way."""
    least_mps = speed_mps - brakes_mps2 * DT_S
    found = inf
    for at_m, lower_mps in slower:
        if speed_mps > lower_mps:
            takes_mps2 = (speed_mps**2 - lower_mps**2) / (2.0 * max(at_m - way_m, 0.1))
            if takes_mps2 >= SLOWS_MPS2:
                found = min(found, max(speed_mps - takes_mps2 * DT_S, least_mps, lower_mps))
    return found


def _braking_on(speeds_mps: list[float], ax_mps2: float) -> list[float]:
    """What is foreseen of one that brakes already: it is reckoned to go on at least so hard."""
    brakes = (speeds_mps[0] + min(0.0, ax_mps2) * DT_S * k for k in range(len(speeds_mps)))
    return [max(0.0, min(pair)) for pair in zip(speeds_mps, brakes, strict=True)]


def _line(name: str) -> _Line | None:
    """The next line that a car must stop at, or may have to."""
    vehicle, found = sumo.vehicle, list[_Line]()
    away_m = sumo.lane.getLength(vehicle.getLaneID(name)) - vehicle.getLanePosition(name)
    for lane, has_priority, _, _, _, state, _, way_m in vehicle.getNextLinks(name):
        if away_m > AHEAD_M:
            break
        if not has_priority:
            light = state in "ryu"
            found.append(_Line(away_m - LINE_M, (0,) if light else CLOSINGS, light=light))
            break
        away_m += way_m + sumo.lane.getLength(lane)
    for light, _, light_m, state in vehicle.getNextTLS(name):
        switches_s = sumo.trafficlight.getNextSwitch(light) - sumo.simulation.getTime()
        if light_m <= AHEAD_M and state == "G" and switches_s <= STEPS * DT_S:
            found.append(_Line(light_m - LINE_M, (round(switches_s / DT_S),), light=True))
            break
    return min(found, key=lambda line: line.away_m, default=None)


def _meeting(one: NetworkLane, other: NetworkLane) -> tuple[float, float] | None:
    """Where the centre lines of two lanes meet: positions along both. None if they do not."""
    lines = one.line.linestring, other.line.linestring
    nearest = shapely.shortest_line(*lines)
    if nearest.length > MEETS_M:
        return None
    first_m, second_m = (line.project(shapely.get_point(nearest, k)) for k, line in enumerate(lines))
    return one.position_of(first_m), other.position_of(second_m)


def _in_junction_soon(name: str) -> bool:
    """Whether a car is in a junction, or moves into one."""
    lane, speed_mps = sumo.vehicle.getLaneID(name), sumo.vehicle.getSpeed(name)
    if lane.startswith(":"):
        return True
    left_m = sumo.lane.getLength(lane) - sumo.vehicle.getLanePosition(name)
    return speed_mps > CREEPING_MPS and left_m <= speed_mps * STEPS * DT_S


def _hardest_braking_mps2(speeds_mps: list[float]) -> float:
    return max((before - after) / DT_S for before, after in pairwise(speeds_mps))
