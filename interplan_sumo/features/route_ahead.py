"""Route ahead: which lanes belong to the route, how many lane changes each needs, and the line to follow."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.features.map_lines import MapLines
from interplan_sumo.features.schema import ROUTE_POINTS, ROUTE_STEP_M
from interplan_sumo.planner import Mission
from interplan_sumo.world.geometry import Floats, Ints, Polyline, wrap_angle
from interplan_sumo.world.lane_changes import lane_changes_needed

_ALIKE_RAD = 0.01
"""Lanes whose headings differ from the ego's by as much are equally good."""
_NO_WAY = 1 << 16


class RouteAhead:
    """The route of one mission on its map."""

    def __init__(self, mission: Mission, lines: MapLines) -> None:
        self._roads, self._lines = mission.roads, lines
        blocks = [mission.roads.roadblocks[block] for block in dict.fromkeys(mission.route)]
        self._lanes = tuple(lane for block in blocks for lane in block.lane_ids)
        self.goal_lane = _goal_lane(mission, self._lanes)
        self._changes = {} if self.goal_lane is None else lane_changes_needed(
            mission.roads, mission.route, self.goal_lane
        )  # fmt: skip
        self._chains: dict[str, Polyline] = {}

    @cached_property
    def on_route(self) -> NDArray[np.bool_]:
        """(L,) for the lanes of the map."""
        return np.isin(self._lines.lane_ids, [int(lane) for lane in self._lanes])

    @cached_property
    def lane_changes(self) -> Ints:
        """(L,) fewest lane changes to the goal lane, -1 where no way leads there."""
        needed = {int(lane): changes for lane, changes in self._changes.items()}
        return np.array([needed.get(lane, -1) for lane in self._lines.lane_ids.tolist()])

    def lane_under(self, frame: EgoFrame) -> str | None:
        """The lane of the route that holds the rear axle and turns least from the ego's heading, else the nearest one.

        Of those alike the one with the fewest lane changes to the goal, then the lower id. None without a route.
        """
        inside = [lane for lane in self._roads.at(frame.x_m, frame.y_m) if lane in self._members]
        if inside:
            return min(inside, key=lambda lane: (self._turned(lane, frame), *self._rank(lane)))
        if not self._lanes:
            return None
        distance_mm = np.rint(1e3 * shapely.distance(self._polygons, shapely.Point(frame.x_m, frame.y_m)))
        near = [self._lanes[row] for row in np.flatnonzero(distance_mm == distance_mm.min())]
        return min(near, key=lambda lane: (self._turned(lane, frame), *self._rank(lane)))

    def centerline(self, lane: str | None, frame: EgoFrame) -> tuple[Floats, NDArray[np.bool_]]:
        """`route_centerline` in the ego frame and `route_centerline_valid`, from a lane of the route on."""
        poses, valid = np.zeros((ROUTE_POINTS, 3)), np.zeros(ROUTE_POINTS, dtype=np.bool_)
        if lane is None:
            return poses, valid
        if lane not in self._chains:
            self._chains[lane] = self._chain(lane)
        line = self._chains[lane]
        arc_m = line.project_point(frame.x_m, frame.y_m)[0] + ROUTE_STEP_M * np.arange(ROUTE_POINTS)
        valid = arc_m <= line.length_m
        poses[valid] = frame.poses(line.poses_at(arc_m[valid]))
        return poses, valid

    @cached_property
    def _members(self) -> frozenset[str]:
        return frozenset(self._lanes)

    @cached_property
    def _polygons(self) -> NDArray[np.object_]:
        return np.array([self._roads[lane].polygon for lane in self._lanes], dtype=object)

    def _turned(self, lane: str, frame: EgoFrame) -> int:
        line = self._roads[lane].centerline
        heading = line.pose_at(line.project_point(frame.x_m, frame.y_m)[0]).heading_rad
        return round(abs(float(wrap_angle(heading - frame.heading_rad))) / _ALIKE_RAD)

    def _rank(self, lane: str) -> tuple[int, int]:
        return self._changes.get(lane, _NO_WAY), int(lane)

    def _chain(self, lane: str) -> Polyline:
        """From the start of a lane on, always to the successor on the route that needs the fewest lane changes."""
        passed = [lane]
        while ahead := [
            each for each in self._roads.outgoing(passed[-1]) if each in self._members and each not in passed
        ]:
            passed.append(min(ahead, key=self._rank))
        return Polyline(np.concatenate([self._roads[each].centerline.points for each in passed]))


def _goal_lane(mission: Mission, lanes: tuple[str, ...]) -> str | None:
    """The lane of the route whose centre line the goal lies on; the last of several."""
    best: tuple[int, str] | None = None
    for lane in lanes:
        if lane in mission.roads.lanes:
            off_m = mission.roads[lane].centerline.project_point(mission.goal.x_m, mission.goal.y_m)[1]
            off_mm = abs(round(off_m * 1e3))
            best = (off_mm, lane) if best is None or off_mm <= best[0] else best
    return None if best is None else best[1]
