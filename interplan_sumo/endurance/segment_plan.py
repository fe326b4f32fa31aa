"""What a segment drives: a start and a way through the district that passes no road twice, as a scenario.

The whole way is known before the start, so a planner is told of it once, in its
`Mission`, and no lane change is needed to follow it: where one is made, the
traffic or the planner wanted it. A way is as long as the segment and its run-out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from interplan_sumo.errors import InputError
from interplan_sumo.scenario.scenario import LanePosition, Scenario
from interplan_sumo.world.roads import Roads, Turn

SEGMENT_M: Final = 1500.0
"""At most so much of a way is driven for the rates."""
RUN_OUT_S: Final = 15.0
"""Then no more rare events begin, and what those that had begun lead to is waited for."""
RUN_OUT_M: Final = 200.0
"""The way goes on for as much, at up to 48 km/h."""
WORTH_M: Final = 700.0
"""A shorter way is driven only where no start has a longer one."""
LEAST_M: Final = 250.0
"""Maps without a way of this length are none to drive on."""
START_LANE_M: Final = 40.0
"""Trips begin on lanes at least this long, if the map has any."""
START_M: Final = (15.0, 20.0)
"""As far from the start and from the end of the lane."""
GOAL_M: Final = 3.0
"""So far before the end of the last lane is the goal."""
STARTS: Final = 20
WALKS: Final = 24
"""So many starts are tried, and so many ways from each."""
STRAIGHT_ON: Final = 2.0
"""So many times more often than a turn."""
LONGEST_S: Final = 1200.0
"""Then a segment ends, wherever the ego is."""


@dataclass(frozen=True, slots=True)
class Way:
    """Lanes and connectors one after the other, and their length from the start on."""

    lanes: tuple[str, ...]
    start_m: float
    """Along the first lane."""
    length_m: float


def drawn_scenario(id: str, roads: Roads, rng: np.random.Generator, maps_beside: Path | None = None) -> Scenario:
    """A trip on a map; its start speed is for who knows the traffic. InputError if there is no way to drive."""
    way = _drawn_way(roads, rng)
    blocks = tuple(dict.fromkeys(roads[lane].roadblock_id for lane in way.lanes))
    last = roads[way.lanes[-1]].centerline
    return Scenario(
        id=id,
        family="endure",
        map=roads.name,
        start=LanePosition(way.lanes[0], round(way.start_m, 2)),
        start_speed_mps=0.0,
        goal=LanePosition(way.lanes[-1], round(max(last.length_m - GOAL_M, last.length_m / 2.0), 2)),
        route=blocks,
        duration_s=LONGEST_S,
        maps_beside=maps_beside,
    )


def _drawn_way(roads: Roads, rng: np.random.Generator) -> Way:
    """The first that is long enough, else the longest of all that are looked at."""
    lanes, weights = _start_lanes(roads)
    best: Way | None = None
    for _ in range(STARTS):
        lane = lanes[int(rng.choice(len(lanes), p=weights))]
        length_m = roads[lane].centerline.length_m
        low_m, high_m = START_M[0], max(START_M[0] + 1.0, length_m - START_M[1])
        start_m = min(float(rng.uniform(low_m, high_m)), 0.8 * length_m)
        for _ in range(WALKS):
            way = _walk(roads, lane, start_m, rng)
            if best is None or way.length_m > best.length_m:
                best = way
            if way.length_m >= SEGMENT_M + RUN_OUT_M:
                return way
        if best is not None and best.length_m >= WORTH_M:
            return best
    if best is None or best.length_m < LEAST_M:
        raise InputError(f"map {roads.name} has no way of {LEAST_M:.0f} m that passes no road twice; give a larger map")
    return best


@lru_cache(maxsize=8)
def _start_lanes(roads: Roads) -> tuple[tuple[str, ...], np.ndarray]:
    """Lanes on which trips begin, and their shares: those of their lengths."""
    usable = [lane for lane in roads.lanes if roads.outgoing(lane)]
    long = [lane for lane in usable if roads[lane].centerline.length_m >= START_LANE_M] or usable
    if not long:
        raise InputError(f"map {roads.name} has no lane that leads on; give another one")
    lengths_m = np.array([roads[lane].centerline.length_m for lane in long])
    return tuple(long), lengths_m / lengths_m.sum()


def _walk(roads: Roads, lane: str, start_m: float, rng: np.random.Generator) -> Way:
    """On from lane to lane by chance, until the way is long enough, or every way on has been driven."""
    lanes, length_m = [lane], roads[lane].centerline.length_m - start_m
    seen = {roads[lane].roadblock_id}
    while length_m < SEGMENT_M + RUN_OUT_M:
        ways = [
            each
            for each in roads.outgoing(lanes[-1])
            if roads.connectors[each].turn is not Turn.U_TURN
            and roads[roads.connectors[each].to_lane_id].roadblock_id not in seen
        ]
        if not ways:
            break
        shares = np.array([STRAIGHT_ON if roads.connectors[each].turn is Turn.STRAIGHT else 1.0 for each in ways])
        connector = roads.connectors[ways[int(rng.choice(len(ways), p=shares / shares.sum()))]]
        there = roads[connector.to_lane_id]
        seen.add(there.roadblock_id)
        lanes += [connector.id, there.id]
        length_m += connector.centerline.length_m + there.centerline.length_m
    return Way(tuple(lanes), start_m, length_m)
