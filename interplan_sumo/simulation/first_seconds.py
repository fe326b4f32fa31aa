"""The first seconds of agents: each one's own SUMO model is asked whether it would brake hard at its start speed.

Start speeds are worked out with the Intelligent Driver Model, for the first
moment. Other models want other gaps, and braking grows as one comes nearer. SUMO
answers for an agent as soon as it is on the road, before anybody has seen it drive.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf

from interplan_sumo.simulation.start_speed import LINE_M
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
ASKED_AT_ITS_SPEED = "Wiedemann"
"""This model answers for the speed that its car has, whatever other speed it is asked about."""
EARLY_MODELS = frozenset({"IDM", "IDMM", "EIDM", "KraussOrig1", "PWagner2009"})
LIGHT_MPS2 = 3.0
"""SUMO's `tls.yellow.min-decel`, for red lights as well."""
SHARES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.0)
"""Of a start speed; the first is taken that its model holds."""
AHEAD_M = 150.0
"""So far ahead, and behind, an agent has others to reckon with."""
_HAS_PRIORITY, _STATE = 1, 5
"""In what `getNextLinks` answers of each link."""


@dataclass(frozen=True, slots=True)
class _Leader:
    """The next one ahead of an agent."""

    name: str
    net_m: float
    """The gap to it beyond the agent's least one."""
    speeds_mps: list[float]
    """Now and in the next steps."""

    def braking(self, rate_mps2: float) -> _Leader:
        """The same one if it brakes all the while."""
        speeds = (self.speeds_mps[min(k, len(self.speeds_mps) - 1)] for k in range(STEPS + 1))
        brakes = (self.speeds_mps[0] - rate_mps2 * DT_S * k for k in range(STEPS + 1))
        return replace(self, speeds_mps=[max(0.0, min(pair)) for pair in zip(speeds, brakes, strict=True)])


@dataclass(frozen=True, slots=True)
class _Line:
    """A line ahead."""

    away_m: float
    first_step: int
    """From which on it may not be crossed."""
    light: bool
    """Whether a light holds it."""

    def stops(self, driver: VehicleType, room_m: float, speed_mps: float) -> bool:
        """Whether a car brakes for it by now; before lights SUMO's other models wait until that takes 3 m/s2."""
        early = not self.light or driver.car_following_model in EARLY_MODELS
        return early or speed_mps * speed_mps >= 2.0 * LIGHT_MPS2 * room_m


class FirstSeconds:
    """Slows down those that have just come, where their own models would brake hard."""

    def __init__(self, drivers: Mapping[str, VehicleType], *, besides: str) -> None:
        """`drivers` by agent, as they come; the vehicle `besides` is overlooked: it is the ego."""
        self._drivers = drivers
        self._besides = besides

    def settle(self, names: Collection[str]) -> None:
        """Lower the speeds of agents that have come with this step, as far as needed."""
        foreseen: dict[str, list[float]] = {}
        for name in sorted(names):
            self._foresee(name, names, foreseen)

    def disturbs(self, name: str) -> bool:
        """Whether the next one behind one that has just come would brake hard for it."""
        behind, gap_m = sumo.vehicle.getFollower(name, AHEAD_M)
        if behind not in self._drivers:
            return False
        leader = _Leader(name, gap_m, [sumo.vehicle.getSpeed(name)])
        now_mps, line = sumo.vehicle.getSpeed(behind), _line(behind)
        return not self._is_mild(behind, self._driven(behind, now_mps, leader, line), leader, line)

    def _is_mild(self, name: str, speeds_mps: list[float], leader: _Leader | None, line: _Line | None) -> bool:
        model = self._drivers[name].car_following_model
        if model in CALM_MODELS:
            return _hardest_mps2(speeds_mps) <= HARDEST_MPS2
        if leader is None:
            return _hardest_mps2(speeds_mps) <= TWITCHY_MPS2
        if speeds_mps[0] > leader.speeds_mps[0] + MOST_CLOSING_MPS.get(model, inf):
            return False
        braking = (self._driven(name, speeds_mps[0], leader.braking(each), line) for each in LEADER_BRAKES_MPS2)
        return all(_hardest_mps2(each) <= TWITCHY_MPS2 for each in (speeds_mps, *braking))

    def _foresee(self, name: str, asked: Collection[str], foreseen: dict[str, list[float]]) -> list[float]:
        """The speeds of an agent from now on, after those of all ahead of it; one that is `asked` may start slower."""
        if name in foreseen:
            return foreseen[name]
        now_mps = max(0.0, sumo.vehicle.getSpeed(name))
        foreseen[name] = [now_mps] * (STEPS + 1)  # in a ring everybody is ahead of everybody
        leader, line = self._leader(name, asked, foreseen), _line(name)
        found = self._driven(name, now_mps, leader, line)
        if name in asked:
            for share in SHARES:
                found = found if share == 1.0 else self._driven(name, now_mps * share, leader, line)
                if self._is_mild(name, found, leader, line):
                    break
            if found[0] < now_mps:
                sumo.vehicle.setPreviousSpeed(name, finite("a start speed", found[0]), 0.0)
        foreseen[name] = found
        return found

    def _leader(self, name: str, asked: Collection[str], foreseen: dict[str, list[float]]) -> _Leader | None:
        """The next one ahead."""
        found = sumo.vehicle.getLeader(name, AHEAD_M)
        if found is None or not found[0] or found[0] == self._besides:
            return None
        leader, net_m = found
        if leader not in self._drivers:  # an obstacle
            return _Leader(leader, net_m, [0.0])
        return _Leader(leader, net_m, self._foresee(leader, asked, foreseen))

    def _driven(self, name: str, speed_mps: float, leader: _Leader | None, line: _Line | None) -> list[float]:
        """The agent's speeds from now on, if it drives at one now."""
        driver, vehicle = self._drivers[name], sumo.vehicle
        found, way_m, led_m = [speed_mps], 0.0, 0.0
        decel_mps2 = vehicle.getApparentDecel(leader.name) if leader is not None else 0.0
        has_mps = vehicle.getSpeed(name) if driver.car_following_model == ASKED_AT_ITS_SPEED else None
        for k in range(STEPS):
            now_mps = found[-1]
            if has_mps is not None:
                vehicle.setPreviousSpeed(name, finite("a speed to ask about", now_mps), 0.0)
            next_mps = now_mps + driver.accel_mps2 * DT_S
            if leader is not None and not (line is not None and line.light and line.away_m < leader.net_m):
                net_m, led_mps = leader.net_m + led_m - way_m, leader.speeds_mps[min(k, len(leader.speeds_mps) - 1)]
                next_mps = min(next_mps, vehicle.getFollowSpeed(name, now_mps, net_m, led_mps, decel_mps2, leader.name))
                led_m += led_mps * DT_S
            if line is not None and k >= line.first_step:
                room_m = max(0.0, line.away_m - way_m)
                if line.stops(driver, room_m, now_mps):
                    next_mps = min(next_mps, vehicle.getStopSpeed(name, now_mps, room_m))
            found.append(max(0.0, next_mps, now_mps - driver.emergency_decel_mps2 * DT_S))
            way_m += found[-1] * DT_S
        if has_mps is not None:
            vehicle.setPreviousSpeed(name, has_mps, 0.0)
        return found


def _line(name: str) -> _Line | None:
    """The next line that a car must stop at, or may have to."""
    vehicle = sumo.vehicle
    links = vehicle.getNextLinks(name)
    if links and not links[0][_HAS_PRIORITY]:
        away_m = sumo.lane.getLength(vehicle.getLaneID(name)) - vehicle.getLanePosition(name)
        return _Line(away_m - LINE_M, 0, light=links[0][_STATE] in "ryu")
    for light, _, away_m, state in vehicle.getNextTLS(name):
        switches_s = sumo.trafficlight.getNextSwitch(light) - sumo.simulation.getTime()
        if state != "G" or switches_s <= STEPS * DT_S:
            return _Line(away_m - LINE_M, 0 if state != "G" else round(switches_s / DT_S), light=True)
    return None


def _hardest_mps2(speeds_mps: list[float]) -> float:
    return max((before - after) / DT_S for before, after in pairwise(speeds_mps))
