"""Ways along a route, lane by lane: the path from a lane on, its limits, and how far one can still change lane."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from interplan_planners.common.paths import DrivingPath, centerline
from interplan_planners.common.route_search import lane_changes_to
from interplan_sumo.planner import Mission
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.roads import Lane, Roads

COMFORTABLE_LATERAL_MPS2 = 3.0
COMFORTABLE_BRAKING_MPS2 = 1.5
_BEND_WINDOW_M = 4.0


@dataclass(frozen=True, eq=False)
class LaneRoute:
    """Where a lane leads without a lane change, as far as the route goes."""

    lanes: tuple[str, ...]
    """Lanes and connectors, one per block."""
    starts_m: Floats
    """(L,) where each begins on the path."""
    path: DrivingPath
    limit_mps: Floats
    """(S,) for each metre: the lanes' limits, what bends allow, and what it takes to brake in time for both."""
    room_m: float
    """Arc length up to which lane changes for the goal are of use: the goal's, or where the way leaves the route."""
    arrives: bool
    """Whether it comes to the last block of the route."""


class Ways:
    """The ways of a mission; each is laid out once."""

    def __init__(self, mission: Mission, route: tuple[str, ...], fallback_limit_mps: float) -> None:
        """`fallback_limit_mps` holds where the map knows no limit."""
        self._mission = mission
        self._route = route
        self._fallback_limit_mps = fallback_limit_mps
        self._ways: dict[tuple[int, str], LaneRoute] = {}
        self.changes_needed = lane_changes_to(mission.roads, route, mission.goal)

    def from_lane(self, index: int, lane_id: str) -> LaneRoute:
        """The way from a lane or connector of `route[index]` on, where it forks towards the fewest lane changes."""
        key = (index, lane_id)
        if key not in self._ways:
            self._ways[key] = self._laid_out(index, lane_id)
        return self._ways[key]

    def beside(self, lane_id: str) -> tuple[tuple[Lane, int], ...]:
        """The neighbours of a lane, left before right, with how many lane changes going there spares (or costs)."""
        roads = self._mission.roads
        here = self.changes_needed.get(lane_id)
        found: list[tuple[Lane, int]] = []
        for neighbour in (roads.left_of(lane_id), roads.right_of(lane_id)):
            there = None if neighbour is None else self.changes_needed.get(neighbour.id)
            if neighbour is not None and there is not None:
                found.append((neighbour, 1 if here is None else here - there))
        return tuple(found)

    def _laid_out(self, index: int, lane_id: str) -> LaneRoute:
        roads, route = self._mission.roads, self._route
        lanes = [lane_id]
        for block in route[index + 1 :]:
            ahead = [lane for lane in roads.outgoing(lanes[-1]) if roads[lane].roadblock_id == block]
            if not ahead:
                break
            lanes.append(min(ahead, key=lambda lane: self.changes_needed.get(lane, len(self.changes_needed) + 1)))
        line = centerline(roads, lanes)
        lines = [roads[lane].centerline for lane in lanes]
        joints_m = [0.0, *(float(np.hypot(*(there.points[0] - here.points[-1]))) for here, there in pairwise(lines))]
        starts_m = np.cumsum(joints_m) + np.cumsum([0.0, *(piece.length_m for piece in lines[:-1])])
        arrives = len(lanes) == len(route) - index
        room_m = line.project_point(self._mission.goal.x_m, self._mission.goal.y_m)[0] if arrives else line.length_m
        limits = limits_along(roads, lanes, starts_m, line, self._fallback_limit_mps)
        return LaneRoute(tuple(lanes), starts_m, DrivingPath(line), limits, room_m, arrives)


def limits_along(roads: Roads, lanes: list[str], starts_m: Floats, line: Polyline, fallback_limit_mps: float) -> Floats:
    """(S,) speed for each metre of a line through lanes: limits, bends, and braking in time for what is ahead."""
    metres = np.arange(int(line.length_m) + 1, dtype=np.float64)
    by_lane = np.array([roads[lane].speed_limit_mps or fallback_limit_mps for lane in lanes])
    limit = by_lane[np.clip(np.searchsorted(starts_m, metres, side="right") - 1, 0, len(lanes) - 1)]
    before = np.interp(metres - _BEND_WINDOW_M / 2, line.arc_m, line.vertex_heading_rad)
    after = np.interp(metres + _BEND_WINDOW_M / 2, line.arc_m, line.vertex_heading_rad)
    bend = np.maximum(np.abs(after - before) / _BEND_WINDOW_M, 1e-6)
    square = np.minimum(limit * limit, COMFORTABLE_LATERAL_MPS2 / bend)
    # from the back: one may be faster by what is braked off in a metre; subtracting the ramp makes it a running minimum
    ramp = 2.0 * COMFORTABLE_BRAKING_MPS2 * metres
    return np.sqrt(np.minimum.accumulate((square + ramp)[::-1])[::-1] - ramp)
