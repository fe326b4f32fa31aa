"""The first seconds of agents: each one's own SUMO model is asked whether it would brake hard at its start speed.

Start speeds are worked out with the Intelligent Driver Model, for the first
moment. Other models want other gaps, and braking grows as one comes nearer. SUMO
answers for an agent as soon as it is on the road, before anybody has seen it drive.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import inf

from interplan_sumo.simulation.start_speed import LINE_M
from interplan_sumo.simulation.sumo import DT_S, finite, sumo
from interplan_sumo.simulation.vehicle_types import VehicleType

STEPS = 20
HARDEST_MPS2 = 2.6
"""Milder than the 3 m/s2 that the benchmark allows in the first two seconds: not everything ahead is foreseen."""
CALM_MODELS = frozenset({"IDM", "IDMM", "EIDM", "Krauss", "KraussPS", "KraussX"})
"""The other models answer small differences with hard braking: for them the next one ahead is taken to brake, too."""
TWITCHY_MPS2, LEADER_BRAKES_MPS2 = 1.7, 2.0
MOST_CLOSING_MPS = {"ACC": 2.4, "CACC": 1.5}
"""Models that brake in proportion to the difference in speed, however far away the next one ahead is."""
SHARES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.0)
"""Of a start speed; the first is taken that its model holds."""
AHEAD_M, BEHIND_M = 150.0, 80.0
_HAS_PRIORITY = 1
"""In what `getNextLinks` answers of each link."""
ROUNDS = 20
"""Who starts slower makes the next one behind start slower, and so on."""


@dataclass(frozen=True, slots=True)
class _Leader:
    """The next one ahead of an agent."""

    name: str
    net_m: float
    """The gap to it beyond the agent's least one."""
    speeds_mps: list[float]
    """Now and in the next steps."""


@dataclass(frozen=True, slots=True)
class _Line:
    """A line ahead."""

    away_m: float
    first_step: int
    """From which on it may not be crossed."""


class FirstSeconds:
    """Slows down those that have just come, where their own models would brake hard."""

    def __init__(self, drivers: Mapping[str, VehicleType], *, besides: str) -> None:
        """`drivers` by agent, as they come; the vehicle `besides` is overlooked: it is the ego."""
        self._drivers = drivers
        self._besides = besides

    def settle(self, names: Collection[str]) -> None:
        """Lower the speeds of agents that have come with this step, as far as needed."""
        asked = sorted(names)
        speeds: dict[str, list[float]] = {}
        for _ in range(ROUNDS):
            before = {name: sumo.vehicle.getSpeed(name) for name in asked}
            for name in asked:
                self._slow_down(name, before[name], speeds)
            if all(sumo.vehicle.getSpeed(name) == before[name] for name in asked):
                break

    def disturbs(self, name: str) -> bool:
        """Whether the next one behind one that has just come would brake hard for it."""
        behind, gap_m = sumo.vehicle.getFollower(name, BEHIND_M)
        if behind not in self._drivers:
            return False
        there = [sumo.vehicle.getSpeed(name)] * STEPS
        driven = self._driven(behind, sumo.vehicle.getSpeed(behind), _Leader(name, gap_m, there), None)
        return _hardest_mps2(driven) > HARDEST_MPS2

    def _is_mild(self, name: str, speeds_mps: list[float], leader: _Leader | None) -> bool:
        model = self._drivers[name].car_following_model
        if leader is not None and speeds_mps[0] > leader.speeds_mps[0] + MOST_CLOSING_MPS.get(model, inf):
            return False
        return _hardest_mps2(speeds_mps) <= (HARDEST_MPS2 if model in CALM_MODELS else TWITCHY_MPS2)

    def _slow_down(self, name: str, speed_mps: float, speeds: dict[str, list[float]]) -> None:
        leader, line = self._leader(name, speeds), _line(name)
        for share in SHARES:
            speeds[name] = self._driven(name, speed_mps * share, leader, line)
            if self._is_mild(name, speeds[name], leader):
                break
        if speeds[name][0] < speed_mps:
            sumo.vehicle.setPreviousSpeed(name, finite("a start speed", speeds[name][0]), 0.0)

    def _leader(self, name: str, speeds: Mapping[str, list[float]]) -> _Leader | None:
        """The next one ahead."""
        found = sumo.vehicle.getLeader(name, AHEAD_M)
        if found is None or not found[0] or found[0] == self._besides:
            return None
        leader = found[0]
        now_mps = max(0.0, sumo.vehicle.getSpeed(leader))
        slows_mps2 = min(0.0, max(-HARDEST_MPS2, sumo.vehicle.getAcceleration(leader)))
        if self._drivers[name].car_following_model not in CALM_MODELS:
            slows_mps2 = min(slows_mps2, -LEADER_BRAKES_MPS2)
        slowing = [max(0.0, now_mps + slows_mps2 * DT_S * k) for k in range(STEPS + 1)]
        foreseen = speeds.get(leader)
        if foreseen is not None:
            slowing = [min(pair) for pair in zip(slowing, foreseen, strict=False)]
        return _Leader(leader, found[1], slowing)

    def _driven(self, name: str, speed_mps: float, leader: _Leader | None, line: _Line | None) -> list[float]:
        """The agent's speeds from now on, if it starts at one; they end where it brakes too hard."""
        driver, vehicle = self._drivers[name], sumo.vehicle
        found, way_m, led_m = [speed_mps], 0.0, 0.0
        for k in range(STEPS):
            now_mps = found[-1]
            next_mps = now_mps + driver.accel_mps2 * DT_S
            if leader is not None:
                net_m, decel_mps2 = leader.net_m + led_m - way_m, vehicle.getApparentDecel(leader.name)
                led_mps = leader.speeds_mps[min(k, len(leader.speeds_mps) - 1)]
                next_mps = min(next_mps, vehicle.getFollowSpeed(name, now_mps, net_m, led_mps, decel_mps2, leader.name))
                led_m += led_mps * DT_S
            if line is not None and k >= line.first_step:
                next_mps = min(next_mps, vehicle.getStopSpeed(name, now_mps, max(0.0, line.away_m - way_m)))
            found.append(max(0.0, next_mps, now_mps - driver.emergency_decel_mps2 * DT_S))
            way_m += found[-1] * DT_S
            if now_mps - found[-1] > HARDEST_MPS2 * DT_S:
                break
        return found


def _line(name: str) -> _Line | None:
    """The next line that a car must stop at, or may have to."""
    vehicle = sumo.vehicle
    links = vehicle.getNextLinks(name)
    if links and not links[0][_HAS_PRIORITY]:
        away_m = sumo.lane.getLength(vehicle.getLaneID(name)) - vehicle.getLanePosition(name)
        return _Line(away_m - LINE_M, 0)
    for light, _, away_m, state in vehicle.getNextTLS(name):
        switches_s = sumo.trafficlight.getNextSwitch(light) - sumo.simulation.getTime()
        if state != "G" or switches_s <= STEPS * DT_S:
            return _Line(away_m - LINE_M, 0 if state != "G" else round(switches_s / DT_S))
    return None


def _hardest_mps2(speeds_mps: list[float]) -> float:
    return max((before - after) / DT_S for before, after in pairwise(speeds_mps))
