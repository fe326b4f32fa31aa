"""Lane changes: a junction, exit or lane drop that the ego's lane does not serve; three families, by density.

Who keeps its lane cannot go on along the route. The three families draw alike:
the same seed and number is the same place, start, goal and drivers, and only
the density of traffic differs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from math import inf
from typing import Final

import numpy as np

from interplan_sumo.families.draws import Draws
from interplan_sumo.families.family import Family
from interplan_sumo.scenario.nominal_drive import nominal_drive, reaches_goal
from interplan_sumo.scenario.route import goal_arc_m, start_arc_m
from interplan_sumo.scenario.scenario import DRIVERS, Density, LanePosition, Scenario, TrafficDemand
from interplan_sumo.scenario.sites import CENTIMETRES, IN_LANE_M, UnsuitableError
from interplan_sumo.world.lane_changes import lane_changes_needed
from interplan_sumo.world.roads import USUAL_LIMIT_MPS, Lane, Roads, Turn

DRAWS_AS: Final = "lane_change"
MOST_M: Final = 400.0
"""A goal lies at most this far from the start along the route,"""
LEAST_M: Final = 100.0
"""and at least this far;"""
DURATION_S: Final = 40.0
"""Through a junction at the speed of traffic, which is two thirds of the limit in towns, it takes longer than 30 s;"""
NOMINAL_SHARE: Final = 0.5
"""on an empty road with green lights at most this share of the time: traffic takes its part of it."""
MOST_CHANGES: Final = 3
LEAST_CHANGE_S: Final = 3.0
"""A lane change takes a car at least this long: quicker ones are beyond nuPlan's bounds of comfort."""
SPARE_M: Final = (30.0, 120.0)
"""The last place to change lies this far beyond the road that the changes take at the least, at the start speed."""
START_SHARES: Final = (0.5, 1.0)
"""Of the speed limit."""
ONCOMING: Final[Density] = "low"
"""The same for all three: they are to differ in one thing."""
GOAL_PAST_M: Final = 15.0
"""The goal lies this far inside its lane: who comes out of a turn is in one lane or another by then."""


@dataclass(frozen=True, slots=True)
class StartLane:
    """A lane from which a route leads to the goal only for those who change lanes in time."""

    route: tuple[str, ...]
    lane: str
    changes: int
    begins_m: float
    """From the beginning of the lane to the goal, along the route."""
    ends_m: float
    """From its end to the goal."""
    last_m: float
    """From the last place where one can still change to the goal."""

    def at(self, roads: Roads, to_goal_m: float) -> LanePosition | None:
        """The place on the lane this far before the goal; None if that is too near to its ends, or not on it."""
        length_m = roads[self.lane].centerline.length_m
        arc_m = (self.begins_m - to_goal_m) / (self.begins_m - self.ends_m) * length_m
        inside = IN_LANE_M <= arc_m <= length_m - IN_LANE_M
        return LanePosition(self.lane, round(arc_m, CENTIMETRES)) if inside else None


@dataclass(frozen=True, slots=True)
class GoalPlace:
    """A goal, and the lanes that one may start on."""

    goal: LanePosition
    starts: tuple[StartLane, ...]


def suitable(roads: Roads, lane_id: str, at_m: float) -> GoalPlace:
    """A goal behind a junction, exit or lane drop that not every lane before it serves; UnsuitableError otherwise."""
    length_m = roads[lane_id].centerline.length_m
    if not GOAL_PAST_M <= at_m <= length_m - IN_LANE_M:
        raise UnsuitableError(f"it lies less than {GOAL_PAST_M:.0f} m behind the beginning of the lane, or at its end")
    starts = tuple(start for way in _ways(roads, lane_id, at_m) for start in _starts(roads, lane_id, way))
    if not starts:
        raise UnsuitableError(
            f"nowhere within {MOST_M:.0f} m before it does a lane end or lead elsewhere while one beside it leads here"
        )
    return GoalPlace(LanePosition(lane_id, round(at_m, CENTIMETRES)), starts)


_Way = list[tuple[str, float, float]]
"""Roadblocks and roadblock connectors in driving order, each with how far its beginning and its end are to the goal."""


def _ways(roads: Roads, lane_id: str, at_m: float) -> Iterator[_Way]:
    """The ways that lead to a goal, as far back as a route may begin; a longer one for each shorter one."""
    last = roads[lane_id].roadblock_id
    waiting: list[_Way] = [[(last, at_m, at_m - roads[lane_id].centerline.length_m)]]
    while waiting:
        way = waiting.pop()
        reach_m = way[0][1]
        if len(way) > 1:
            yield way
        if reach_m > MOST_M:
            continue
        for link in sorted(roads.incoming_roadblocks(way[0][0])):
            before = roads.roadblocks[link].from_id
            connectors = [roads.connectors[each] for each in roads.roadblocks[link].lane_ids]
            turns_back = all(each.turn == Turn.U_TURN for each in connectors)
            if before is None or turns_back or before in {block for block, _, _ in way}:
                continue
            link_m = float(np.mean([each.centerline.length_m for each in connectors]))
            block_m = float(np.mean([roads[each].centerline.length_m for each in roads.roadblocks[before].lane_ids]))
            begins_m = reach_m + link_m
            waiting.append([(before, begins_m + block_m, begins_m), (link, begins_m, reach_m), *way])


def _starts(roads: Roads, goal: str, way: _Way) -> Iterator[StartLane]:
    """The lanes in the first block of a way where one must change in time, and all that is to change lies before."""
    _, begins_m, ends_m = way[0]
    route = tuple(each for each, _, _ in way)
    left_m = {each: end_m for each, _, end_m in way}
    for lane, changes, last in _changing(roads, route, goal):
        yield StartLane(route, lane, changes, begins_m, ends_m, left_m[roads[last].roadblock_id])


@lru_cache(maxsize=10_000)
def _changing(roads: Roads, route: tuple[str, ...], goal: str) -> tuple[tuple[str, int, str], ...]:
    """Lanes in a route's first block from where one must change, how often, and the last lane for who does not.

    Places on one lane share it: the same for all goals along that lane.
    """
    need = lane_changes_needed(roads, route, goal)
    found: list[tuple[str, int, str]] = []
    for lane in roads.roadblocks[route[0]].lane_ids:
        changes = need.get(lane, 0)
        if not 1 <= changes <= MOST_CHANGES:
            continue
        last = dead_end(roads, need, lane, roads[goal].roadblock_id)
        if last is not None and need[last] == _steps(roads, need, last):
            found.append((lane, changes, last))
    return tuple(found)


def dead_end(roads: Roads, need: Mapping[str, int], lane: str, goal_block: str) -> str | None:
    """The last lane on the route for who does not change lanes; None if it comes into the goal's block.

    `need` as from `lane_changes_needed`.
    """
    kept, frontier, last = {lane}, [lane], lane
    while frontier:
        here = frontier.pop(0)
        if roads[here].roadblock_id == goal_block:
            return None
        last = here if isinstance(roads[here], Lane) else last
        fresh = [way for way in roads.outgoing(here) if way in need and way not in kept]
        kept.update(fresh)
        frontier += fresh
    return last


def _steps(roads: Roads, need: Mapping[str, int], lane: str) -> int:
    """From a lane to the nearest one beside it from which the route goes on; -1 if changes are left behind it."""
    beside = roads.roadblocks[roads[lane].roadblock_id].lane_ids
    here = beside.index(lane)
    serving = [(abs(here - i), each) for i, each in enumerate(beside) if any(w in need for w in roads.outgoing(each))]
    nearest = min((steps for steps, _ in serving), default=-1)
    return nearest if any(need[each] == 0 for steps, each in serving if steps == nearest) else -1


def drawn(family: str, density: Density, id: str, roads: Roads, place: GoalPlace, draws: Draws) -> Scenario:
    """A scenario of a family and its density at a place, what varies drawn at random."""
    behaviour = draws.one_of("drivers", DRIVERS)
    starts = [place.starts[row] for row in draws.order(len(place.starts))]
    starts = sorted(starts, key=lambda start: -start.changes)  # few places have room for many
    for start, _ in zip(starts, draws.tries(len(starts)), strict=True):
        limit_mps = roads[start.lane].speed_limit_mps or USUAL_LIMIT_MPS
        speed_mps = round(draws.uniform("start_speed_share", START_SHARES, None) * limit_mps, 1)
        room_m = start.changes * LEAST_CHANGE_S * speed_mps + draws.uniform("room_to_spare_m", SPARE_M, None)
        to_goal_m = start.last_m + room_m
        here = start.at(roads, to_goal_m)
        if here is None or to_goal_m > NOMINAL_SHARE * DURATION_S * _fastest_mps(roads, start.route):
            continue
        scenario = Scenario(
            id=id,
            family=family,
            map=roads.name,
            start=here,
            start_speed_mps=speed_mps,
            goal=place.goal,
            route=start.route,
            traffic=TrafficDemand(density=density, behaviour=behaviour, oncoming=ONCOMING),
            duration_s=DURATION_S,
            perception="occluded",
        )
        route_m = goal_arc_m(roads, scenario) - start_arc_m(roads, scenario)
        if LEAST_M <= route_m <= MOST_M and nominal_s(roads, scenario) <= NOMINAL_SHARE * scenario.duration_s:
            return scenario
    raise UnsuitableError("no start with room for the lane changes is near enough to be there in time")


def restaged(family: str, density: Density, scenario: Scenario) -> Scenario:
    """The same scene at another density."""
    return replace(scenario, family=family, traffic=replace(scenario.traffic, density=density))


def _fastest_mps(roads: Roads, route: Sequence[str]) -> float:
    """The highest limit on a route."""
    limits = [roads[lane].speed_limit_mps for block in route for lane in roads.roadblocks[block].lane_ids]
    return max(limit or USUAL_LIMIT_MPS for limit in limits)


def nominal_s(roads: Roads, scenario: Scenario) -> float:
    """How long the drive takes on an empty road with green lights; infinite if longer than the scenario lasts."""
    track = nominal_drive(roads, scenario)
    return float(track.time_us[-1]) * 1e-6 if reaches_goal(roads, scenario, track) else inf


# --- start checks --------------------------------------------------------------------------------


def change_problems(scenario: Scenario, roads: Roads) -> list[str]:
    """The goal takes a lane change, and a lane nearer to it lies beside the start lane for long enough."""
    need = lane_changes_needed(roads, scenario.route, scenario.goal.lane)
    changes = need.get(scenario.start.lane)
    if changes is None:
        return []  # no way leads there: the check of every scenario says so
    if changes == 0:
        return ["goal.lane: it can be reached without a lane change, expected one or more; choose a lane beside it"]
    least_m = LEAST_CHANGE_S * scenario.start_speed_mps
    room_m = _beside_m(scenario, roads, need)
    if room_m >= least_m:
        return []
    return [
        f"start: no lane lies beside lane {scenario.start.lane} from {room_m:.1f} m ahead on, expected one for "
        f"{least_m:.1f} m or more, {LEAST_CHANGE_S:.0f} s at the start speed; start it farther back or slower"
    ]


def _beside_m(scenario: Scenario, roads: Roads, need: Mapping[str, int]) -> float:
    """How far ahead of the start the last lane ends that lies beside the ego's and nearer to the goal."""
    here, driven_m, beside_m = scenario.start.lane, -scenario.start.arc_m, 0.0
    passed: set[str] = set()
    while True:
        passed.add(here)
        driven_m += roads[here].centerline.length_m
        beside = [lane for lane in (roads.left_of(here), roads.right_of(here)) if lane is not None]
        if any(need.get(lane.id, need[here]) < need[here] for lane in beside):
            beside_m = driven_m
        ways = [way for way in roads.outgoing(here) if way in need and way not in passed]
        if not ways:
            return beside_m
        here = min(ways, key=lambda way: (need[way], way))


def asks(scenario: Scenario, roads: Roads) -> bool:
    """Whether the goal takes a lane change."""
    need = lane_changes_needed(roads, scenario.route, scenario.goal.lane)
    return need.get(scenario.start.lane, 0) > 0


def _family(name: str, density: Density, *, order: int, original: str) -> Family[GoalPlace]:
    short = name.rpartition("_")[2]
    return Family(
        title=f"Lane change, {density} density",
        description=f"Only lanes beside the ego's lead on along the route, traffic of {density} density between.",
        suitable=suitable,
        drawn=partial(drawn, name, density),
        telling=("room_to_spare_m", "start_speed_share"),
        draws_as=DRAWS_AS,
        restaged=partial(restaged, name, density),
        order=order,
        column=short.upper(),
        column_key=short,
        changes_lanes=True,
        checks=(change_problems,),
        asks=asks,
        audit_class="lane changes",
        original=original,
    )


LOW: Final = _family("lane_change_ltd", "low", order=60, original="dl")
MEDIUM: Final = _family("lane_change_mtd", "medium", order=70, original="dm")
HIGH: Final = _family("lane_change_htd", "high", order=80, original="dh")
