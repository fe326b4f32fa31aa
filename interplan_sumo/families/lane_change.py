"""Lane changes: ordinary road, the goal lies one to three lanes away; the same recipes at three densities."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from interplan_sumo.scenario.scenario import Behaviour, Density, LanePosition, Scenario, TrafficDemand
from interplan_sumo.scenario.sites import Site, UnsuitableError, site_at
from interplan_sumo.world.roads import Roads

FAMILIES: Final[dict[str, Density]] = {
    "lane_change_ltd": "low",
    "lane_change_mtd": "medium",
    "lane_change_htd": "high",
}
APPROACHES_M: Final = (280.0, 240.0, 200.0, 160.0, 120.0)
"""From the start to the goal line: the longest that a place has room for."""
PER_CHANGE_M: Final = 70.0
"""A lane change takes about this much road; nothing is asked for that physics forbids."""
SETTLE_M: Final = 40.0
START_SHARE: Final = 0.7
"""The ego starts at this share of the speed limit, as traffic around it does."""
GOAL_ROOM_M: Final = 8.0


def lane_change(
    id: str,
    *,
    map: str,
    start: LanePosition,
    start_speed_mps: float,
    goal: LanePosition,
    route: tuple[str, ...],
    density: Density,
    behaviour: Behaviour,
) -> Scenario:
    """Drive from `start` to `goal`, which lies on another lane, through traffic."""
    family = next(name for name, dense in FAMILIES.items() if dense == density)
    return Scenario(
        id=id,
        family=family,
        map=map,
        start=start,
        start_speed_mps=start_speed_mps,
        goal=goal,
        route=route,
        traffic=TrafficDemand(density=density, behaviour=behaviour),
    )


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


def drawn(id: str, roads: Roads, site: Site, density: Density, rng: np.random.Generator) -> Scenario:
    """A scenario of a density at a site, what varies drawn at random."""
    places = starts(roads, site)
    changes = sorted(places)[int(rng.integers(len(places)))]
    start = places[changes]
    route = (*((roads[start.lane].roadblock_id,)), *site.route[1:])
    limit_mps = roads[start.lane].speed_limit_mps or site.limit_mps
    return lane_change(
        id,
        map=site.map,
        start=start,
        start_speed_mps=round(START_SHARE * limit_mps, 1),
        goal=site.goal,
        route=route,
        density=density,
        behaviour=("conservative", "assertive", "mixed")[int(rng.integers(3))],
    )


# --- the ten, at three densities ---------------------------------------------------------------


def _recipes(family: str) -> tuple[Scenario, ...]:
    density = FAMILIES[family]
    return (
        lane_change(  # two to the left on a three-lane arterial
            f"{family}/0",
            map="strip",
            start=LanePosition("402032", 20.0),
            start_speed_mps=12.0,
            goal=LanePosition("402030", 260.0),
            route=("40203",),
            density=density,
            behaviour="mixed",
        ),
        lane_change(  # three to the left on a boulevard of four lanes
            f"{family}/1",
            map="strip",
            start=LanePosition("101043", 15.0),
            start_speed_mps=13.0,
            goal=LanePosition("101040", 230.0),
            route=("10104",),
            density=density,
            behaviour="conservative",
        ),
        lane_change(  # two to the right before the end of the block
            f"{family}/2",
            map="strip",
            start=LanePosition("102090", 12.0),
            start_speed_mps=12.0,
            goal=LanePosition("102092", 190.0),
            route=("10209",),
            density=density,
            behaviour="assertive",
        ),
        lane_change(  # one to the right
            f"{family}/3",
            map="strip",
            start=LanePosition("401050", 20.0),
            start_speed_mps=11.0,
            goal=LanePosition("401051", 250.0),
            route=("40105",),
            density=density,
            behaviour="mixed",
        ),
        lane_change(  # two to the right across a left-hand road, towards its middle
            f"{family}/4",
            map="one_north",
            start=LanePosition("101050", 12.0),
            start_speed_mps=12.0,
            goal=LanePosition("101052", 255.0),
            route=("10105",),
            density=density,
            behaviour="mixed",
        ),
        lane_change(  # one to the left, left-hand traffic, a fast road
            f"{family}/5",
            map="one_north",
            start=LanePosition("202052", 30.0),
            start_speed_mps=14.0,
            goal=LanePosition("202051", 200.0),
            route=("20205",),
            density=density,
            behaviour="conservative",
        ),
        lane_change(  # one to the right, left-hand traffic, short
            f"{family}/6",
            map="one_north",
            start=LanePosition("201060", 20.0),
            start_speed_mps=13.0,
            goal=LanePosition("201061", 180.0),
            route=("20106",),
            density=density,
            behaviour="assertive",
        ),
        lane_change(  # from the ramp of a highway into its right lane
            f"{family}/7",
            map="hazelwood",
            start=LanePosition("101052", 15.0),
            start_speed_mps=14.0,
            goal=LanePosition("101061", 140.0),
            route=("10105", "101050", "10106"),
            density=density,
            behaviour="conservative",
        ),
        lane_change(  # two to the left within one block
            f"{family}/8",
            map="strip",
            start=LanePosition("202052", 10.0),
            start_speed_mps=12.0,
            goal=LanePosition("202050", 178.0),
            route=("20205",),
            density=density,
            behaviour="assertive",
        ),
        lane_change(  # one to the right in a one-way street of three lanes
            f"{family}/9",
            map="back_bay",
            start=LanePosition("201050", 12.0),
            start_speed_mps=8.0,
            goal=LanePosition("201051", 195.0),
            route=("20105",),
            density=density,
            behaviour="mixed",
        ),
    )


SCENARIOS: Final[dict[str, tuple[Scenario, ...]]] = {family: _recipes(family) for family in FAMILIES}
