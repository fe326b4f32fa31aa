"""View: a planner's whole view at one step as named arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.features.map_lines import MapLines, areas_near, map_lines
from interplan_sumo.features.route_ahead import RouteAhead
from interplan_sumo.features.schema import (
    AREAS,
    BY_NAME,
    LANE_POINTS,
    LANES,
    LINE_POINTS,
    ROUTE_LANES,
    SEEN,
    channel_index,
)
from interplan_sumo.features.tracks import agents, ego_history, static_objects
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.geometry import Floats, Ints
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
