"""View: a planner's whole view at one step as named arrays, and the route ahead in it."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.features.map_lines import MapLines, areas_near, map_lines
from interplan_sumo.features.schema import (
    AREAS,
    BY_NAME,
    LANE_POINTS,
    LANES,
    LINE_POINTS,
    ROUTE_LANES,
    ROUTE_POINTS,
    ROUTE_STEP_M,
    SEEN,
    channel_index,
)
from interplan_sumo.features.tracks import agents, ego_history, static_objects
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.geometry import Floats, Ints, Polyline, wrap_angle
from interplan_sumo.world.lane_changes import lane_changes_needed
from interplan_sumo.world.signals import Signals, SignalStatus

Arrays = dict[str, NDArray[Any]]
_LIGHTS = channel_index("lanes", "light_green")
_ONE_HOT = np.eye(4)
"""Green, yellow, red, none: in the order of `SignalStatus`."""


class EgoView:
    """What the planner of one mission sees, as the arrays of `schema.SEEN`.

    Make one in `start(mission)` and call `arrays(observation)` in `plan(observation)`: the
    same numbers, bit for bit, as `interplan-sumo export` writes for that step.
    """

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self.lines: MapLines = map_lines(mission.roads)
        self.route = RouteAhead(mission, self.lines)
        self._on_route = self.route.on_route[self.lines.pieces.lane]
        self._row = {lane: row for row, lane in enumerate(self.lines.lane_ids.tolist())}

    def frame(self, observation: Observation) -> EgoFrame:
        """The ego frame at this step."""
        return EgoFrame.of(observation.ego, self.mission.shape)

    def arrays(self, observation: Observation) -> Arrays:
        """Every `seen` field of the schema, with its shape and type."""
        frame = self.frame(observation)
        under = self.route.lane_under(frame)
        history, history_valid = ego_history(observation, frame, self.mission.shape)
        centerline, centerline_valid = self.route.centerline(under, frame)
        limit_mps = 0.0 if under is None else self.lines.limit_mps[self._row[int(under)]]
        found: dict[str, Any] = {
            "origin": frame.origin,
            "ego_history": history,
            "ego_history_valid": history_valid,
            "agents": agents(observation, frame, self.mission.dt_s),
            "static_objects": static_objects(observation.actors, frame),
            **self._lanes(observation.signals, frame),
            **_areas("stop_lines", areas_near(self.lines.stop_lines, frame, AREAS)),
            **_areas("crosswalks", areas_near(self.lines.crosswalks, frame, AREAS)),
            "route_centerline": centerline,
            "route_centerline_valid": centerline_valid,
            **self._route_lanes(frame),
            "speed_limit": limit_mps,
        }
        return {field.name: np.asarray(found[field.name], dtype=field.dtype) for field in SEEN}

    def _lanes(self, signals: Signals, frame: EgoFrame) -> dict[str, Any]:
        pieces = self.lines.pieces
        rows = self.lines.pieces_near(frame, LANES)
        count, lane = len(rows), pieces.lane[rows]
        table = np.zeros((LANES, LANE_POINTS, 11))
        block = table[:count]
        block[..., :3] = frame.poses(pieces.poses[rows])
        block[..., 3] = pieces.half_width_m[rows]
        block[..., 4] = self.lines.limit_mps[lane, None]
        block[..., _LIGHTS : _LIGHTS + 4] = _ONE_HOT[self._lights(signals)[lane]][:, None]
        block[..., _LIGHTS + 4] = self.route.on_route[lane, None]
        block[..., _LIGHTS + 5] = self.route.lane_changes[lane, None]
        return {
            "lanes": table,
            "lanes_valid": np.arange(LANES) < count,
            "lane_ids": _filled(self.lines.lane_ids[lane], (LANES,)),
            "lane_starts": _filled(pieces.start_m[rows], (LANES,)),
            "left_boundaries": _filled(frame.points(pieces.left[rows]), (LANES, LINE_POINTS, 2)),
            "right_boundaries": _filled(frame.points(pieces.right[rows]), (LANES, LINE_POINTS, 2)),
        }

    def _route_lanes(self, frame: EgoFrame) -> dict[str, Any]:
        rows = self.lines.pieces_near(frame, ROUTE_LANES, self._on_route)
        return {
            "route_lanes": _filled(frame.poses(self.lines.pieces.poses[rows]), BY_NAME["route_lanes"].shape),
            "route_lanes_valid": np.arange(ROUTE_LANES) < len(rows),
        }

    def _lights(self, signals: Signals) -> Ints:
        """(L,) status of the map's lanes."""
        status = np.full(len(self.lines.lane_ids), int(SignalStatus.UNKNOWN), dtype=np.int64)
        rows = [self._row.get(int(connector), -1) for connector in signals.connector_ids]
        known = np.array(rows, dtype=np.int64) >= 0
        status[np.array(rows, dtype=np.int64)[known]] = signals.status[known]
        return status


def _areas(name: str, points: Floats) -> dict[str, Any]:
    return {
        name: _filled(points, (AREAS, LINE_POINTS, 2)),
        f"{name}_valid": np.arange(AREAS) < len(points),
    }


def _filled(values: NDArray[Any], shape: tuple[int | None, ...]) -> NDArray[Any]:
    """`values` with empty rows up to `shape`."""
    table = np.zeros([size or 0 for size in shape], dtype=values.dtype)
    table[: len(values)] = values
    return table


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
