"""Corridor: the road of a scenario unrolled along its route, with every lane the ego may use on the way.

All of `verification` that searches for a drive thinks in two coordinates: *arc*,
the arc length on the route's centre line, and *left*, the signed distance from
it. A `LanePath` is a lane with its continuations, as an offset over arc.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.errors import ScenarioError
from interplan_sumo.metrics.speed_limit import place_limit_mps
from interplan_sumo.scenario.route import goal_arc_m, route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.geometry import Floats, Polyline, wrap_angle
from interplan_sumo.world.lane_changes import lane_changes_needed
from interplan_sumo.world.roads import Roads

GRID_M = 0.5
"""Spacing of the grid on which offsets are given."""
BEFORE_M, BEYOND_M = 10.0, 60.0
"""The grid reaches this far before the start and beyond the goal."""
EXTENSION_M = 150.0
"""The route's line goes on straight for this length at both ends, so that what lies there has coordinates."""
NEIGHBOURS_M = (2.2, 5.5)
"""Centre lines of neighbour lanes are this far apart."""
ASIDE_M = 8.0
"""Lanes farther from start and goal lane than this are no way around an obstacle."""
FAIRING = 6
"""Half the window, in grid points, over which the kinks of a polyline are faired: 3 m."""
WITHOUT_LIMIT_MPS = 13.9
"""Where the map knows no limit."""


@dataclass(frozen=True, slots=True, eq=False)
class LanePath:
    """A lane and its continuations along the route."""

    lanes: tuple[str, ...]
    """Lanes and connectors in driving order."""
    left_m: Floats
    """(G,) offset of its centre line from the route's line; not a number where it does not exist."""
    limit_mps: Floats
    """(G,)"""
    at_goal: bool
    """Whether it is the goal lane where the goal is."""


@dataclass(frozen=True, eq=False)
class FrenetCorridor:
    """The route's line with its grid of G arcs, and the lane paths along it."""

    scenario: Scenario
    roads: Roads
    line: Polyline
    """The route's centre line, extended."""
    start_m: float
    """Arc of the ego's centre at the start."""
    goal_m: float
    arc_m: Floats
    """(G,) the grid."""
    lane_paths: tuple[LanePath, ...]
    start_path: int

    @cached_property
    def frame(self) -> Floats:
        """(G, 3) x, y and heading of the line on the grid; headings are smooth and not wrapped."""
        x, y, _ = self.line.poses_at(self.arc_m).T
        heading = np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))
        return np.stack((x, y, smoothed(heading, 4)), axis=1)

    def points(self, left_m: Floats) -> Floats:
        """(G, 2) the points at offsets (G,), faired: a lane may be a polyline with kinks that no car can drive."""
        x, y, heading = self.frame.T
        return np.stack((faired(x - left_m * np.sin(heading)), faired(y + left_m * np.cos(heading))), axis=1)

    def unrolled(self, xy: Floats) -> tuple[Floats, Floats, Floats]:
        """Arc, left and heading of the line there, each (K,), of points (K, 2)."""
        if not len(xy):
            return np.zeros(0), np.zeros(0), np.zeros(0)
        arc = np.asarray(shapely.line_locate_point(self.line.linestring, shapely.points(xy)), dtype=np.float64)
        x, y, heading = self.line.poses_at(arc).T
        left = -(xy[:, 0] - x) * np.sin(heading) + (xy[:, 1] - y) * np.cos(heading)
        return arc, left, heading

    def on_grid(self, arc_m: float) -> int:
        """Index of the grid point nearest to an arc."""
        return int(np.clip(round((arc_m - float(self.arc_m[0])) / GRID_M), 0, len(self.arc_m) - 1))

    def neighbours(self, one: int, other: int) -> NDArray[np.bool_]:
        """(G,) where two lane paths are side by side."""
        apart = np.abs(self.lane_paths[one].left_m - self.lane_paths[other].left_m)
        return (apart > NEIGHBOURS_M[0]) & (apart < NEIGHBOURS_M[1])  # comparisons with nan are False


def frenet_corridor(scenario: Scenario, roads: Roads) -> FrenetCorridor:
    """The corridor of a scenario; ScenarioError if its goal cannot be reached along its route."""
    route = route_centerline(roads, scenario)
    line, goal_m = _extended(route), goal_arc_m(roads, scenario) + EXTENSION_M
    start = scenario.start.pose(roads)
    start_m = route.project_point(start.x_m, start.y_m)[0] + EXTENSION_M
    if goal_m <= start_m:
        raise ScenarioError(f"{scenario.id}: the goal lies {start_m - goal_m:.1f} m behind the start")
    count = int(np.ceil((goal_m - start_m + BEFORE_M + BEYOND_M) / GRID_M)) + 1
    arc_m = (start_m - BEFORE_M + GRID_M * np.arange(count)).astype(np.float64)
    chains = _chains(roads, scenario)
    lane_paths = tuple(_lane_path(roads, scenario, line, arc_m, chain) for chain in chains)
    kept = _of_use(scenario, lane_paths)
    start_path = next(i for i, lane_path in enumerate(kept) if scenario.start.lane in lane_path.lanes)
    return FrenetCorridor(scenario, roads, line, start_m, goal_m, arc_m, kept, start_path)


def smoothed(values: Floats, half_width: int) -> Floats:
    """(K,) moving average over `half_width` samples to either side, fewer at the ends."""
    sums = np.concatenate(([0.0], np.cumsum(values)))
    at = np.arange(len(values))
    reach = np.minimum(half_width, np.minimum(at, len(values) - 1 - at))
    return (sums[at + reach + 1] - sums[at - reach]) / (2 * reach + 1)


def faired(values: Floats) -> Floats:
    """(K,) smoothed over `FAIRING`, then what that took off in bends put back: it is smooth itself."""
    first = smoothed(values, FAIRING)
    return first + smoothed(values - first, FAIRING)


def _extended(route: Polyline) -> Polyline:
    first, last = route.segment_heading_rad[0], route.segment_heading_rad[-1]
    before = route.points[0] - EXTENSION_M * np.array((np.cos(first), np.sin(first)))
    beyond = route.points[-1] + EXTENSION_M * np.array((np.cos(last), np.sin(last)))
    return Polyline(np.concatenate((before[None], route.points, beyond[None])))


def _chains(roads: Roads, scenario: Scenario) -> list[tuple[str, ...]]:
    """Every lane of the route's blocks from the start on, each followed as far as the route leads; start lane first."""
    need = lane_changes_needed(roads, scenario.route, scenario.goal.lane)
    first = scenario.route.index(roads[scenario.start.lane].roadblock_id)
    chains = [_followed(roads, scenario.route, first, scenario.start.lane, need)]
    covered = set(chains[0])
    for at in range(first, len(scenario.route)):
        block = roads.roadblocks[scenario.route[at]]
        if block.is_connector:
            continue
        for lane in block.lane_ids:
            if lane not in covered:
                chains.append(_followed(roads, scenario.route, at, lane, need))
                covered.update(chains[-1])
    return chains


def _followed(roads: Roads, route: tuple[str, ...], at: int, lane: str, need: Mapping[str, int]) -> tuple[str, ...]:
    """A lane and what follows it along the route; of several connectors the one with the fewest lane changes left."""
    chain = [lane]
    if lane in roads.connectors:  # a drive may begin inside a junction
        chain += roads.outgoing(lane)
        at += 1
    while at + 2 < len(route):
        connectors = [
            each
            for each in roads.outgoing(chain[-1])
            if roads[each].roadblock_id == route[at + 1]
            and roads[roads.outgoing(each)[0]].roadblock_id == route[at + 2]
        ]
        if not connectors:
            break
        best = min(connectors, key=lambda each: (need.get(each, len(roads.lanes)), _bend_rad(roads, each), each))
        chain += [best, roads.outgoing(best)[0]]
        at += 2
    return tuple(chain)


def _bend_rad(roads: Roads, lane_id: str) -> float:
    headings = roads[lane_id].centerline.segment_heading_rad
    return abs(float(wrap_angle(headings[-1] - headings[0])))


def _lane_path(roads: Roads, scenario: Scenario, line: Polyline, arc_m: Floats, chain: tuple[str, ...]) -> LanePath:
    left = np.full(len(arc_m), np.nan)
    limit = np.full(len(arc_m), WITHOUT_LIMIT_MPS)
    at_goal = False
    for lane_id in chain:
        points = roads[lane_id].centerline.points
        arc, off = line.project(points)
        ahead = np.concatenate(([True], np.diff(arc) > 1e-6))
        arc, off = np.maximum.accumulate(arc[ahead]), off[ahead]
        here = (arc_m >= arc[0] - GRID_M) & (arc_m <= arc[-1] + GRID_M)
        left[here] = np.interp(arc_m[here], arc, off)
        known = [place_limit_mps(roads, (lane_id,)), roads[lane_id].speed_limit_mps or np.inf]
        if np.isfinite(min(known)):
            limit[here] = min(*known, 60.0)
        if lane_id == scenario.goal.lane:
            at_goal = True
    exists = np.flatnonzero(np.isfinite(left))
    if len(exists):
        if chain[0] == scenario.start.lane:  # the car's rear may reach behind the first lane
            left[: exists[0]], limit[: exists[0]] = left[exists[0]], limit[exists[0]]
        if at_goal:  # and its path goes on behind the goal, where the map may end
            left[exists[-1] + 1 :], limit[exists[-1] + 1 :] = left[exists[-1]], limit[exists[-1]]
    return LanePath(chain, left, limit, at_goal)


def _of_use(scenario: Scenario, lane_paths: tuple[LanePath, ...]) -> tuple[LanePath, ...]:
    """The lane paths between start and goal lane, and where something stands in the way those beside them."""
    ends = [lane_path for lane_path in lane_paths if lane_path.at_goal or scenario.start.lane in lane_path.lanes]
    lowest = min(float(np.nanmin(lane_path.left_m)) for lane_path in ends)
    highest = max(float(np.nanmax(lane_path.left_m)) for lane_path in ends)
    aside_m = ASIDE_M if scenario.obstacles else 0.5
    kept: list[LanePath] = []
    for lane_path in lane_paths:
        if lane_path in ends:
            kept.append(lane_path)
            continue
        if not np.isfinite(lane_path.left_m).any():
            continue
        middle = float(np.nanmedian(lane_path.left_m))
        if lowest - aside_m < middle < highest + aside_m:
            kept.append(lane_path)
    return tuple(kept)
