"""The route of a scenario as a chain of lanes and as one line, against which progress and the goal are measured."""

from __future__ import annotations

import heapq
from functools import lru_cache
from math import hypot, inf

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Roads

JOIN_M = 5.0
"""Where the chain must change lane the line is slanted over this length on either side."""
_LEAST_M = 1e-6


def route_lanes(roads: Roads, scenario: Scenario) -> tuple[str, ...]:
    """Lanes and connectors from the first roadblock of the route to the goal lane.

    Traced backwards from the goal lane: connectors cost nothing, a step to a
    neighbour lane costs 1, so the chain changes lane only where the goal lane
    cannot be reached otherwise. Among equal chains the one whose first lane is
    nearest to the start lane wins, then the lower ids. ScenarioError if the
    goal lane is not reachable inside the route.
    """
    rank = {block: i for i, block in enumerate(scenario.route)}
    first = scenario.route[0]
    start_index = _index_in_block(roads, scenario.start.lane)
    goal = scenario.goal.lane
    if roads[goal].roadblock_id not in rank:
        raise ScenarioError(f"{scenario.id}: goal lane {goal} does not lie on the route")
    queue: list[tuple[int, int, tuple[str, ...]]] = [(0, -rank[roads[goal].roadblock_id], (goal,))]
    seen: set[str] = set()
    found: list[tuple[int, int, tuple[str, ...]]] = []
    while queue:
        cost, _, chain = heapq.heappop(queue)
        if found and cost > found[0][0]:
            break
        here = chain[0]
        if here in seen and roads[here].roadblock_id != first:
            continue
        seen.add(here)
        at = rank[roads[here].roadblock_id]
        if at == 0:
            found.append((cost, abs(_index_in_block(roads, here) - start_index), chain))
            continue
        before = [lane for lane in roads.incoming(here) if rank.get(roads[lane].roadblock_id) == at - 1]
        for lane in before:
            heapq.heappush(queue, (cost, -(at - 1), (lane, *chain)))
        if not before:
            for neighbour in (roads.left_of(here), roads.right_of(here)):
                if neighbour is not None and neighbour.id not in seen:
                    heapq.heappush(queue, (cost + 1, -at, (neighbour.id, *chain)))
    if not found:
        raise ScenarioError(f"{scenario.id}: goal lane {goal} cannot be reached along the route")
    return min(found)[2]


def _index_in_block(roads: Roads, lane_id: str) -> int:
    return roads.roadblocks[roads[lane_id].roadblock_id].lane_ids.index(lane_id)


@lru_cache(maxsize=256)
def route_centerline(roads: Roads, scenario: Scenario) -> Polyline:
    """The route as one line, from the start of the first roadblock to the end of the goal lane, map frame."""
    line: np.ndarray | None = None
    chain = route_lanes(roads, scenario)
    for before, here in zip((None, *chain), chain, strict=False):
        piece = roads[here].centerline
        if before is None or line is None:
            line = piece.points
        elif here in roads.outgoing(before):
            line = np.concatenate((line, piece.points))
        else:  # a neighbour: `before` was only stepped through
            line = _slanted(line, roads[before].centerline, piece)
    if line is None:
        raise ScenarioError(f"{scenario.id}: the route is empty")
    return Polyline(line)


def _slanted(line: np.ndarray, left_behind: Polyline, piece: Polyline) -> np.ndarray:
    """`line` without the lane that was left, up to `JOIN_M` before its start, then `piece` from `JOIN_M` on."""
    start = left_behind.points[0]
    before = line[: int(np.argmin(np.hypot(*(line - start).T))) + 1]
    kept = Polyline(before) if len(before) > 1 else None
    head = kept.between(0.0, kept.length_m - JOIN_M).points if kept and kept.length_m > 2 * JOIN_M else before[:1]
    tail = piece.between(JOIN_M, piece.length_m).points if piece.length_m > 2 * JOIN_M else piece.points[-1:]
    return np.concatenate((head, tail))


def start_arc_m(roads: Roads, scenario: Scenario) -> float:
    """Arc length of the ego's start on `route_centerline`."""
    pose = scenario.start.pose(roads)
    return route_centerline(roads, scenario).project_point(pose.x_m, pose.y_m)[0]


def way_ahead(roads: Roads, scenario: Scenario) -> Polyline:
    """The route's line from the start to the goal, a metre at least."""
    first_m, last_m = sorted((start_arc_m(roads, scenario), goal_arc_m(roads, scenario)))
    return route_centerline(roads, scenario).between(first_m, max(last_m, first_m + 1.0))


@lru_cache(maxsize=256)
def goal_arc_m(roads: Roads, scenario: Scenario) -> float:
    """Arc length of the goal line on `route_centerline`."""
    pose = scenario.goal.pose(roads)
    return route_centerline(roads, scenario).project_point(pose.x_m, pose.y_m)[0]


def forget_lines() -> None:
    """Give back the memory of all lines worked out so far: long ones, of trips that nobody drives twice."""
    route_centerline.cache_clear()
    goal_arc_m.cache_clear()


class GoalLine:
    """Whether the goal line is passed: whether the nearest point of the route lies beyond it."""

    def __init__(self, line: Polyline, goal_m: float) -> None:
        """`goal_m` is where on the route's line it lies."""
        self._line = line
        self._goal_m = goal_m
        self._beyond = line.between(goal_m, line.length_m) if line.length_m - goal_m > _LEAST_M else None
        self._seen_at = (inf, inf)
        self._free_m = 0.0

    def is_passed(self, x_m: float, y_m: float) -> bool:
        """Whether the route's point nearest to this one lies beyond the line.

        Each distance changes by no more than one moves, so that for half of how much nearer
        the part before the line is than the part beyond it nothing has to be looked up.
        """
        if hypot(x_m - self._seen_at[0], y_m - self._seen_at[1]) < self._free_m:
            return False
        arc_m, aside_m = self._line.project_point(x_m, y_m)
        if arc_m > self._goal_m:
            return True
        beyond_m = inf if self._beyond is None else abs(self._beyond.project_point(x_m, y_m)[1])
        self._seen_at, self._free_m = (x_m, y_m), (beyond_m - abs(aside_m)) / 2.0 - _LEAST_M
        return False
