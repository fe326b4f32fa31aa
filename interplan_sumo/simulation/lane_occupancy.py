"""Who is where on SUMO's lanes: leaders along any way, and those behind on all ways that lead to a place."""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from interplan_sumo.scenario.scenario import SMALLEST_GAP_M
from interplan_sumo.simulation.idm import acceleration_mps2
from interplan_sumo.simulation.lane_chains import ChainedLane, limits_and_turns
from interplan_sumo.simulation.network import NetworkLink, SumoNetwork
from interplan_sumo.simulation.obstacles import LaneBlockage
from interplan_sumo.simulation.start_speed import StartAhead, hardest_mps2, safe
from interplan_sumo.simulation.vehicle_types import VehicleType

AHEAD_M, BEHIND_M = 150.0, 80.0
"""How far starting vehicles look for others."""
HOLD_AHEAD_M = 90.0
"""So far ahead one comes within the time for which nobody may hit another: 3 s at 30 m/s."""
CAR_LENGTH_M = 5.0
"""Gaps are meant for cars up to this length; longer vehicles add the rest."""


@dataclass(frozen=True, slots=True)
class Occupant:
    """A vehicle, or what blocks the lane, by SUMO's lane positions."""

    front_m: float
    rear_m: float
    """Negative where it reaches back into the lanes before."""
    speed_mps: float
    driver: VehicleType | None = None
    """None: an obstacle, or the ego."""

    @property
    def centre_m(self) -> float:
        return (self.front_m + self.rear_m) / 2.0


class LaneOccupancy:
    """All vehicles by lane, from upstream on."""

    def __init__(self, network: SumoNetwork, blocked: Sequence[LaneBlockage] = ()) -> None:
        self._network = network
        self._on: dict[str, list[Occupant]] = {}
        for each in blocked:
            self.add(each.lane, Occupant(each.end_m, each.start_m, 0.0))

    def add(self, lane: str, each: Occupant) -> None:
        """Somebody whose front is on a lane; where its rear lies on one of the lanes before, it is on all of those."""
        insort(self._on.setdefault(lane, []), each, key=_front_m)
        if each.rear_m < 0.0:
            for before in self._network.before.get(lane, ()):
                length_m = self._network.lanes[before].length_m
                self.add(before, Occupant(length_m, length_m + each.rear_m, each.speed_mps, each.driver))

    def copy(self) -> LaneOccupancy:
        """Another one with the same vehicles."""
        other = LaneOccupancy(self._network)
        other._on = {lane: list(those) for lane, those in self._on.items()}
        return other

    def on(self, lane: str) -> Sequence[Occupant]:
        """Those on a lane, from upstream on."""
        return self._on.get(lane, ())

    def leader(self, way: Sequence[ChainedLane], front_m: float) -> tuple[float, float] | None:
        """Gap to, and speed of, the next one ahead of a front bumper on the first lane of a way."""
        for number, part in enumerate(way):
            if part.start_m - front_m > AHEAD_M:
                break
            ahead = [
                (part.start_m + each.rear_m - front_m, each.speed_mps)
                for each in self._on.get(part.lane.id, ())
                if number or each.front_m > front_m + 1e-6
            ]
            if ahead:
                return min(ahead)
        return None

    def leaders(self, lane: str, front_m: float, reach_m: float) -> list[tuple[float, float]]:
        """Gap to, and speed of, the next one ahead of a front bumper on each way on from there, wherever it goes."""
        found: list[tuple[float, float]] = []
        seen, waiting = {lane}, [(lane, 0.0)]
        while waiting:
            here, start_m = waiting.pop()
            ahead = [
                (start_m + each.rear_m - front_m, each.speed_mps)
                for each in self._on.get(here, ())
                if here != lane or each.front_m > front_m + 1e-6
            ]
            end_m = start_m + self._network.lanes[here].length_m
            if ahead:
                found.append(min(ahead))
            elif end_m - front_m < reach_m:
                following = [after for after in self._network.after.get(here, ()) if after not in seen]
                seen.update(following)
                waiting.extend((after, end_m) for after in following)
        return found

    def followers(self, lane: str, front_m: float, rear_m: float) -> list[tuple[float, Occupant]]:
        """The next ones behind a vehicle on all ways that lead to it, each with its gap."""
        found: list[tuple[float, Occupant]] = []
        seen, waiting = {lane}, [(lane, rear_m, front_m)]
        while waiting:
            here, at_m, upto_m = waiting.pop()
            behind = [each for each in self._on.get(here, ()) if each.front_m <= upto_m - 1e-6]
            if behind:
                found.append((at_m - behind[-1].front_m, behind[-1]))
            elif at_m < BEHIND_M:
                for before in self._network.before.get(here, ()):
                    if before not in seen:
                        seen.add(before)
                        length_m = self._network.lanes[before].length_m
                        waiting.append((before, at_m + length_m, length_m + 1.0))
        return found

    def ahead_of(self, way: Sequence[ChainedLane], front_m: float, opens: Callable[[NetworkLink], bool]) -> StartAhead:
        """What a vehicle has before it that starts on the first lane of a way; `opens` tells which links are open."""
        line_m = next((part.end_m - front_m for part in way if part.link is not None and not opens(part.link)), None)
        slower, turns = limits_and_turns(way, front_m)
        leaders = self.leaders(way[0].lane.id, front_m, HOLD_AHEAD_M)
        return StartAhead(way[0].lane.limit_mps, line_m, slower, turns, self.leader(way, front_m), leaders)

    def leaves_room(self, lane: str, front_m: float, length_m: float, speed_mps: float) -> bool:
        """Whether those behind a vehicle that starts there keep a gap, are not endangered nor made to brake hard."""
        limit_mps = self._network.lanes[lane].limit_mps
        return all(
            may_follow(each.driver, each.speed_mps, limit_mps, gap_m, speed_mps)
            for gap_m, each in self.followers(lane, front_m, front_m - length_m)
        )


def _front_m(each: Occupant) -> float:
    return each.front_m


def may_follow(driver: VehicleType | None, speed_mps: float, limit_mps: float, gap_m: float, leader_mps: float) -> bool:
    """Whether a vehicle behind keeps a gap, is not endangered nor made to brake hard; the ego has no type of ours."""
    if gap_m < SMALLEST_GAP_M - CAR_LENGTH_M or not safe(speed_mps, gap_m, leader_mps):
        return False
    return driver is None or (
        gap_m > driver.min_gap_m
        and acceleration_mps2(driver, speed_mps, limit_mps, gap_m, leader_mps) >= -hardest_mps2(driver)
    )
