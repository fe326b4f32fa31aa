"""What the rare events of a segment do once they have begun: agents that brake, stop, cut in or run red lights, people
who cross, doors that open.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass
from math import inf
from typing import Final, Protocol

import numpy as np

from interplan_sumo.endurance.kerbside import Thing
from interplan_sumo.endurance.opportunities import Opportunities, RareOpportunity
from interplan_sumo.endurance.records import RareKind
from interplan_sumo.endurance.street_people import StreetPeople, Walker
from interplan_sumo.endurance.trip_way import TripWay
from interplan_sumo.maps.network import NetworkIds
from interplan_sumo.scenario.jaywalking import trigger_distance_m, walk
from interplan_sumo.scenario.scenario import Jaywalker, LanePosition
from interplan_sumo.simulation.agent_control import LANE_CHANGE_DEFAULT
from interplan_sumo.simulation.agent_registry import AgentRegistry, AgentSnapshot
from interplan_sumo.simulation.ego_proxy import EGO
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.simulation.sumo import DT_S, Commanding, sumo
from interplan_sumo.simulation.vehicle_types import VehicleType
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Polyline

HARD_MPS2: Final = 6.0
"""How hard one brakes all of a sudden, within its own brakes."""
HARD_S: Final = 2.5
"""For so long, and then it drives on."""
STOPS_MPS2: Final = 2.5
"""How one brakes that breaks down."""
STOPS_S: Final = 30.0
"""It stands for so long, with a lane to itself, and then moves on."""
CUTS_IN_S: Final = 5.0
"""So long it means to be in the ego's lane."""
HARD_TO_SEE_S: Final = 6.0
"""What braking or cutting in leads to comes within this time."""
WALKS_MPS: Final = 1.4
KERB_M: Final = 0.5
"""People wait so far behind the edge of the road, and walk a metre beyond the other one."""
BEYOND_KERB_M: Final = 1.0
PASSED_M: Final = 10.0
"""What is so far behind the ego concerns it no more."""
LEFT_BEHIND_M: Final = 60.0
"""One that has broken down does not move on right behind an ego that has just got past it."""
GIVES_UP_S: Final = 60.0
"""Who has found no moment to cross by then stays."""
BRAKES_MPS2: Final = 3.0
"""Nobody sets off before one that would have to brake harder: it is the ego that is to be surprised."""
EGO_BRAKES_MPS2: Final = 4.0
EGO_REACTS_S: Final = 0.5
"""Nor before an ego that could not stop like that: what nobody can avoid says nothing of who drives."""
LANE_HALF_M: Final = 3.5
DOOR_S: Final = 3.0
"""A door opens so long before the ego is there, at its speed."""
NEAREST_DOOR_M: Final = 8.0
OPEN_S: Final = 8.0
"""It is open for so long."""
RUNS_RED_S: Final = 12.0
"""So long one means to drive over red; then it yields as others do."""
AVOIDS_COLLISIONS: Final = 256
"""SUMO's lane-change mode: told lanes only, and no care for others but that none is hit."""


class StagedAct(Protocol):
    """One event under way."""

    def step(self, agents: AgentSnapshot, ego: EgoState, /) -> Mapping[str, float]:
        """How fast some agents are to be at most after the next step; once per step."""
        ...

    @property
    def is_over(self) -> bool:
        """Whether it concerns the ego no more."""
        ...


class _Braking:
    """The one ahead brakes hard for `HARD_S`."""

    def __init__(self, name: str, driver: VehicleType) -> None:
        self._name = name
        self._mps2 = min(HARD_MPS2, driver.emergency_decel_mps2)
        self._left_s = HARD_TO_SEE_S

    def step(self, agents: AgentSnapshot, _ego: EgoState) -> Mapping[str, float]:
        self._left_s -= DT_S
        row = agents.rows.get(self._name)
        if row is None or self._left_s < HARD_TO_SEE_S - HARD_S:
            return {}
        return {self._name: max(0.0, float(agents.speed_mps[row]) - self._mps2 * DT_S)}

    @property
    def is_over(self) -> bool:
        return self._left_s <= 0.0


class Breakdown:
    """One ahead on the ego's way stops in its lane and stands for `STOPS_S`."""

    def __init__(self, name: str, origin_m: tuple[float, float]) -> None:
        self._name = name
        self._origin_m = origin_m
        self._left_s = STOPS_S
        self._passed = False

    def step(self, agents: AgentSnapshot, ego: EgoState) -> Mapping[str, float]:
        row = agents.rows.get(self._name)
        if row is None:
            self._passed = True
            return {}
        dx = float(agents.front_x[row]) + self._origin_m[0] - ego.x_m
        dy = float(agents.front_y[row]) + self._origin_m[1] - ego.y_m
        self._passed = bool(dx * np.cos(ego.heading_rad) + dy * np.sin(ego.heading_rad) < -LEFT_BEHIND_M)
        now_mps = float(agents.speed_mps[row])
        if now_mps <= 0.0:
            self._left_s -= DT_S
        return {self._name: max(0.0, now_mps - STOPS_MPS2 * DT_S)}

    @property
    def is_over(self) -> bool:
        return self._passed or self._left_s <= 0.0


class _CutIn:
    """One beside the ego comes into its lane, close before it."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._left_s = HARD_TO_SEE_S
        lane = sumo.vehicle.getLaneIndex(EGO)
        sumo.vehicle.setLaneChangeMode(name, AVOIDS_COLLISIONS)
        sumo.vehicle.changeLane(name, lane, CUTS_IN_S)

    def step(self, agents: AgentSnapshot, _ego: EgoState) -> Mapping[str, float]:
        self._left_s -= DT_S
        if self.is_over and self._name in agents.rows:
            with Commanding("letting {!r} change lane as it likes", self._name):
                sumo.vehicle.setLaneChangeMode(self._name, LANE_CHANGE_DEFAULT)
        return {}

    @property
    def is_over(self) -> bool:
        return self._left_s <= 0.0


class _Crossing:
    """Somebody waits at the kerb and sets off before the ego; never before anybody who could not stop."""

    def __init__(self, walker: Walker, line: Polyline, shape: EgoShape, origin_m: tuple[float, float]) -> None:
        self._walker = walker
        self._line = line
        self._half_m = shape.length_m / 2.0
        self._left_s = GIVES_UP_S
        self._passed = False
        x_m, y_m, _ = line.poses_at(walker.walk.conflict_m)[0].tolist()
        self._at = (x_m - origin_m[0], y_m - origin_m[1])

    def step(self, agents: AgentSnapshot, ego: EgoState) -> Mapping[str, float]:
        self._left_s -= DT_S
        arc_m, _ = self._line.project_point(ego.x_m, ego.y_m)
        ahead_m = self._walker.walk.conflict_m - arc_m - self._half_m
        self._passed = ahead_m < -PASSED_M
        from_m = trigger_distance_m(ego.speed_mps)
        if self._walker.walked_s is None and surprises(ahead_m, ego.speed_mps, from_m, agents, self._at):
            self._walker.walked_s = 0.0
        if self.is_over:
            self._walker.expected = False
        return {}

    @property
    def is_over(self) -> bool:
        walked = self._walker.walked_s is not None and not self._walker.walks
        return walked or self._passed or self._left_s <= 0.0


class OpeningDoor:
    """A car is parked at the kerb, and its door opens before the ego; never before anybody who could not stop."""

    def __init__(
        self, people: StreetPeople, things: tuple[Thing, Thing], conflict_m: float, line: Polyline, shape: EgoShape,
        origin_m: tuple[float, float],
    ) -> None:  # fmt: skip
        self._people = people
        self._car, self._door = things
        self._conflict_m = conflict_m
        self._line = line
        self._half_m = shape.length_m / 2.0
        self._at = (self._door.pose.x_m - origin_m[0], self._door.pose.y_m - origin_m[1])
        self._left_s = GIVES_UP_S
        self._open_s: float | None = None
        self._passed = False
        people.put(self._car)

    def step(self, agents: AgentSnapshot, ego: EgoState) -> Mapping[str, float]:
        self._left_s -= DT_S
        arc_m, _ = self._line.project_point(ego.x_m, ego.y_m)
        ahead_m = self._conflict_m - arc_m - self._half_m
        self._passed = ahead_m < -PASSED_M
        from_m = max(NEAREST_DOOR_M, DOOR_S * ego.speed_mps)
        if self._open_s is not None:
            self._open_s += DT_S
        elif surprises(ahead_m, ego.speed_mps, from_m, agents, self._at):
            self._open_s = 0.0
            self._people.put(self._door)
        if self.is_over:
            self._people.take(self._door)
            self._people.expect_no_more(self._car)
        return {}

    @property
    def is_over(self) -> bool:
        shut = self._open_s is not None and self._open_s >= OPEN_S
        return shut or self._passed or self._left_s <= 0.0


class _RedRun:
    """One drives on over red as if the ego were not there; it yields to all others."""

    def __init__(self, name: str, network: SumoNetwork) -> None:
        self._name = name
        self._network = network
        self._left_s = RUNS_RED_S
        self._inside = False
        self._gone = False

    def step(self, agents: AgentSnapshot, _ego: EgoState) -> Mapping[str, float]:
        self._left_s -= DT_S
        if self._name not in agents.rows:
            self._gone = True
            return {}
        lane = self._network.lanes.get(agents.lanes([self._name])[0])
        inside = lane is not None and lane.internal
        self._gone = self._inside and not inside
        self._inside = self._inside or inside
        return {}

    @property
    def runs(self) -> str:
        """SUMO's name of it, while red does not hold for it."""
        return "" if self._gone or self._left_s <= 0.0 else self._name

    @property
    def is_over(self) -> bool:
        return self._gone or self._left_s <= 0.0


def surprises(ahead_m: float, ego_mps: float, from_m: float, agents: AgentSnapshot, at: tuple[float, float]) -> bool:
    """Whether something begins at a place, in SUMO's frame, now that the ego's front is so far before it.

    It does from a distance on, while the ego and all others can stop.
    """
    stops_m = ego_mps**2 / (2.0 * EGO_BRAKES_MPS2) + EGO_REACTS_S * ego_mps
    return stops_m <= ahead_m <= from_m and others_can_stop(agents, at)


def others_can_stop(agents: AgentSnapshot, at: tuple[float, float]) -> bool:
    """Whether all who drive towards a place, in SUMO's frame, can stop before it with `BRAKES_MPS2`."""
    dx, dy = at[0] - agents.front_x, at[1] - agents.front_y
    cosine, sine = np.cos(agents.heading_rad), np.sin(agents.heading_rad)
    ahead_m, aside_m = dx * cosine + dy * sine, np.abs(dy * cosine - dx * sine)
    stops_m = agents.speed_mps**2 / (2.0 * BRAKES_MPS2) + agents.speed_mps + 2.0
    return not bool(((ahead_m > -PASSED_M) & (ahead_m < stops_m) & (aside_m < 3.0 * LANE_HALF_M)).any())


@dataclass(slots=True)
class StagedSpan:
    """When an event was under way."""

    kind: RareKind
    began_s: float
    ended_s: float | None = None


class Staging:
    """Looks for opportunities, and carries out what has been drawn."""

    def __init__(
        self, way: TripWay, network: SumoNetwork, ids: NetworkIds, tokens: Iterator[str], shape: EgoShape
    ) -> None:
        """`tokens` are ids for people, none of which anybody else has."""
        self.people = StreetPeople(DT_S)
        self.spans: list[StagedSpan] = []
        """All that has begun, in order."""
        self._way = way
        self._network = network
        self._tokens = tokens
        self._shape = shape
        self._opportunities = Opportunities(way, network, ids)
        self._origin_m = ids.origin_m
        self._act: StagedAct | None = None
        self._ego: EgoState | None = None
        self._told: frozenset[str] = frozenset()

    @property
    def is_active(self) -> bool:
        """Whether an event is under way: no other begins."""
        return self._act is not None

    def look(self, ego: EgoState, agents: AgentRegistry) -> list[RareOpportunity]:
        """What could begin now; nothing while an event is under way."""
        return [] if self.is_active else self._opportunities.now(ego, agents)

    def begin(self, what: RareOpportunity, ego: EgoState, agents: AgentRegistry) -> None:
        """Have it begin."""
        with Commanding("staging a {}", what.kind):
            self._act = self._started(what, agents)
        self.spans.append(StagedSpan(what.kind, ego.time_s))

    def notice(self, ego: EgoState) -> None:
        """Where the ego is, before anybody moves; ends what is over."""
        self._ego = ego
        if self._act is not None and self._act.is_over:
            self._act = None
            self.spans[-1].ended_s = ego.time_s

    def most_mps(self, agents: AgentSnapshot) -> Mapping[str, float]:
        """How fast some agents are to be at most after the next step: the traffic asks once per step."""
        told = self._act.step(agents, self._ego) if self._act is not None and self._ego is not None else {}
        told = {name: most_mps for name, most_mps in told.items() if name in agents.rows}
        found = with_released(told, self._told & agents.rows.keys())
        self._told = frozenset(told)
        return found

    def runs_red(self) -> frozenset[str]:
        """For whom red does not hold in the next step."""
        runs = self._act.runs if isinstance(self._act, _RedRun) else ""
        return frozenset([runs] if runs else [])

    def _started(self, what: RareOpportunity, agents: AgentRegistry) -> StagedAct:
        origin_m = self._origin_m
        if what.kind == "hard_braking_ahead":
            return _Braking(what.agent, agents.drivers[what.agent])
        if what.kind == "blocked_lane":
            return Breakdown(what.agent, origin_m)
        if what.kind == "cut_in":
            return _CutIn(what.agent)
        if what.kind == "red_light_runner":
            return _RedRun(what.agent, self._network)
        if what.parked is not None:
            things = what.parked.things(next(self._tokens), next(self._tokens))
            return OpeningDoor(self.people, things, what.parked.conflict_m, self._way.line, self._shape, origin_m)
        walker = self._walker(what)
        self.people.come(walker)
        return _Crossing(walker, self._way.line, self._shape, origin_m)

    def _walker(self, what: RareOpportunity) -> Walker:
        """One who comes from the kerb that is nearer to the ego's lane, or on a crosswalk, and goes straight across."""
        if what.crosswalk is not None:
            return Walker(next(self._tokens), what.crosswalk.walk)
        assert what.place is not None
        left_m, right_m = what.edges_m
        sign = 1.0 if left_m < right_m else -1.0
        here_m, there_m = min(left_m, right_m) + KERB_M, max(left_m, right_m) + BEYOND_KERB_M
        start = LanePosition(what.place.lane, what.place.arc_m, sign * here_m)
        end = LanePosition(what.place.lane, what.place.arc_m, -sign * there_m)
        way = walk(Jaywalker(start, end, WALKS_MPS), self._way.roads, self._way.line)
        return Walker(next(self._tokens), way)


def with_released(told: Mapping[str, float], before: Set[str]) -> Mapping[str, float]:
    """What agents are told, and that those who were told something before may drive as they like again."""
    return {**dict.fromkeys(sorted(before - told.keys()), inf), **told}
