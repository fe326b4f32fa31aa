"""Lane changes: ordinary road, the goal lies one to three lanes away; three families, by the density of traffic."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from interplan_sumo.families.family import Family
from interplan_sumo.scenario.scenario import Behaviour, Density, LanePosition, Scenario, TrafficDemand
from interplan_sumo.scenario.sites import Site, UnsuitableError, site_at
from interplan_sumo.world.lane_changes import lane_changes_needed
from interplan_sumo.world.roads import Roads

APPROACHES_M: Final = (280.0, 240.0, 200.0, 160.0, 120.0)
"""From the start to the goal line: the longest that a place has room for."""
PER_CHANGE_M: Final = 70.0
"""A lane change takes about this much road; nothing is asked for that physics forbids."""
SETTLE_M: Final = 40.0
START_SHARE: Final = 0.7
"""The ego starts at this share of the speed limit, as traffic around it does."""
GOAL_ROOM_M: Final = 8.0
LEAST_CHANGE_S: Final = 3.0
"""A lane change takes a car at least this long: quicker ones are beyond nuPlan's bounds of comfort."""


def suitable(roads: Roads, lane_id: str, at_m: float) -> Site:
    """A goal on a lane with others beside it, far from a start without lights between; UnsuitableError otherwise."""
    reason = "there is one lane only"
    for approach_m in APPROACHES_M:
        try:
            site = site_at(roads, lane_id, at_m, approach_m=approach_m, beyond_m=GOAL_ROOM_M, room_m=GOAL_ROOM_M)
        except UnsuitableError as shorter:
            reason = str(shorter)
            continue
        if len(site.beside_start) > 1:
            return replace(site, goal=LanePosition(lane_id, round(at_m, 2)))
        reason = "there is one lane only"
    raise UnsuitableError(reason)


def starts(roads: Roads, site: Site) -> dict[int, LanePosition]:
    """Where one may start, by the number of lane changes to the goal that the road leaves room for."""
    distance_m = _distance_m(roads, site)
    index = site.beside_start.index(site.start.lane)
    found: dict[int, LanePosition] = {}
    for i, lane in enumerate(site.beside_start):
        changes = abs(i - index)
        length_m = roads[lane].centerline.length_m
        if 1 <= changes <= 3 and PER_CHANGE_M * changes + SETTLE_M <= distance_m:
            found.setdefault(changes, LanePosition(lane, min(site.start.arc_m, round(length_m - 1.0, 2))))
    if not found:
        raise UnsuitableError("no lane change finds room before the goal")
    return found


def _distance_m(roads: Roads, site: Site) -> float:
    here, there = site.start.pose(roads), site.goal.pose(roads)
    return float(np.hypot(there.x_m - here.x_m, there.y_m - here.y_m))


def drawn(family: str, density: Density, id: str, roads: Roads, site: Site, rng: np.random.Generator) -> Scenario:
    """A scenario of a family and its density at a site, what varies drawn at random."""
    places = starts(roads, site)
    changes = sorted(places)[int(rng.integers(len(places)))]
    start = places[changes]
    limit_mps = roads[start.lane].speed_limit_mps or site.limit_mps
    behaviours: tuple[Behaviour, ...] = ("conservative", "assertive", "mixed")
    return Scenario(
        id=id,
        family=family,
        map=site.map,
        start=start,
        start_speed_mps=round(START_SHARE * limit_mps, 1),
        goal=site.goal,
        route=(roads[start.lane].roadblock_id, *site.route[1:]),
        traffic=TrafficDemand(density=density, behaviour=behaviours[int(rng.integers(len(behaviours)))]),
    )


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


def _family(name: str, density: Density, *, order: int, original: str) -> Family[Site]:
    short = name.rpartition("_")[2]
    return Family(
        title=f"Lane change, {density} density",
        description=f"Ordinary road, the goal lies one to three lanes away, traffic of {density} density between.",
        suitable=suitable,
        drawn=partial(drawn, name, density),
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
