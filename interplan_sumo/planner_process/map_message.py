"""Map message: a map as it is sent to a planner, once for each process, and the same map made of it again."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal

import msgspec
import numpy as np
import shapely
from msgspec import Struct

from interplan_sumo.planner import Mission
from interplan_sumo.planner_process.messages import MSGPACK, Pack
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import Polyline, Pose
from interplan_sumo.world.roads import (
    Area,
    Connector,
    Intersection,
    IntersectionKind,
    Lane,
    LaneLike,
    Roadblock,
    Roads,
    StopLine,
    StopLineKind,
    Turn,
)

AREAS = ("crosswalks", "walkways", "carparks", "road_segments", "generic_drivable_areas")


def map_request(roads: Roads, slot: int, pack: Pack) -> dict[str, Any]:
    """A map, to be kept under this number in place of what was there.

    Its polygons are lists of rings, the outer one first, and points lie as x, y, x, y.
    """
    areas = {name: [{"id": a.id, "polygon": _rings(a.polygon, pack)} for a in getattr(roads, name)] for name in AREAS}
    return {
        "type": "map",
        "map": slot,
        "name": roads.name,
        "crs": roads.crs,
        "driving_side": roads.driving_side,
        "lanes": [{**_lane(lane, pack), "index": lane.index} for lane in roads.lanes.values()],
        "connectors": [
            {
                **_lane(each, pack),
                "from_lane_id": each.from_lane_id,
                "to_lane_id": each.to_lane_id,
                "turn": int(each.turn),
                "stop_line_ids": each.stop_line_ids,
            }
            for each in roads.connectors.values()
        ],
        "roadblocks": [
            {
                "id": each.id,
                "polygon": _rings(each.polygon, pack),
                "lane_ids": each.lane_ids,
                "is_connector": each.is_connector,
                "from_id": each.from_id,
                "to_id": each.to_id,
                "intersection_id": each.intersection_id,
            }
            for each in roads.roadblocks.values()
        ],
        "intersections": [
            {"id": each.id, "polygon": _rings(each.polygon, pack), "kind": int(each.kind)}
            for each in roads.intersections
        ],
        "stop_lines": [
            {"id": each.id, "polygon": _rings(each.polygon, pack), "kind": int(each.kind)}
            for each in roads.stop_lines.values()
        ],
        **areas,
    }


def _lane(lane: LaneLike, pack: Pack) -> dict[str, Any]:
    return {
        "id": lane.id,
        "roadblock_id": lane.roadblock_id,
        "centerline": pack(lane.centerline.points.ravel()),
        "left_boundary": pack(lane.left_boundary.points.ravel()),
        "right_boundary": pack(lane.right_boundary.points.ravel()),
        "polygon": _rings(lane.polygon, pack),
        "speed_limit_mps": lane.speed_limit_mps,
    }


def _rings(polygon: shapely.Polygon, pack: Pack) -> list[Any]:
    rings = (polygon.exterior, *polygon.interiors)
    return [pack(shapely.get_coordinates(ring).ravel()) for ring in rings]


# --- as our own host reads it --------------------------------------------------------------------

Rings = tuple[bytes, ...]


class PackedLaneLike(Struct, frozen=True, kw_only=True):
    id: str
    roadblock_id: str
    centerline: bytes
    left_boundary: bytes
    right_boundary: bytes
    polygon: Rings
    speed_limit_mps: float | None


class PackedLane(PackedLaneLike, frozen=True, kw_only=True):
    index: int

    def lane(self) -> Lane:
        lines = _line(self.left_boundary), _line(self.right_boundary)
        centre, polygon = _line(self.centerline), _polygon(self.polygon)
        return Lane(self.id, self.roadblock_id, self.index, centre, polygon, *lines, self.speed_limit_mps)


class PackedConnector(PackedLaneLike, frozen=True, kw_only=True):
    from_lane_id: str
    to_lane_id: str
    turn: Turn
    stop_line_ids: tuple[str, ...]

    def connector(self) -> Connector:
        return Connector(
            self.id,
            self.roadblock_id,
            self.from_lane_id,
            self.to_lane_id,
            _line(self.centerline),
            _polygon(self.polygon),
            _line(self.left_boundary),
            _line(self.right_boundary),
            self.speed_limit_mps,
            self.turn,
            self.stop_line_ids,
        )


class PackedRoadblock(Struct, frozen=True, kw_only=True):
    id: str
    polygon: Rings
    lane_ids: tuple[str, ...]
    is_connector: bool
    from_id: str | None
    to_id: str | None
    intersection_id: str | None


class PackedArea(Struct, frozen=True):
    id: str
    polygon: Rings


class PackedIntersection(Struct, frozen=True):
    id: str
    polygon: Rings
    kind: IntersectionKind


class PackedStopLine(Struct, frozen=True):
    id: str
    polygon: Rings
    kind: StopLineKind


class MapRequest(Struct, frozen=True, kw_only=True, tag="map"):
    map: int
    name: str
    crs: str
    driving_side: Literal["left", "right"]
    lanes: tuple[PackedLane, ...]
    connectors: tuple[PackedConnector, ...]
    roadblocks: tuple[PackedRoadblock, ...]
    intersections: tuple[PackedIntersection, ...]
    stop_lines: tuple[PackedStopLine, ...]
    crosswalks: tuple[PackedArea, ...]
    walkways: tuple[PackedArea, ...]
    carparks: tuple[PackedArea, ...]
    road_segments: tuple[PackedArea, ...]
    generic_drivable_areas: tuple[PackedArea, ...]

    def roads(self) -> Roads:
        """The map again, to the last bit."""
        return Roads(
            self.name,
            self.crs,
            self.driving_side,
            {each.id: each.lane() for each in self.lanes},
            {each.id: each.connector() for each in self.connectors},
            {
                each.id: Roadblock(
                    each.id,
                    _polygon(each.polygon),
                    each.lane_ids,
                    each.is_connector,
                    each.from_id,
                    each.to_id,
                    each.intersection_id,
                )
                for each in self.roadblocks
            },
            tuple(Intersection(each.id, _polygon(each.polygon), each.kind) for each in self.intersections),
            {each.id: StopLine(each.id, _polygon(each.polygon), each.kind) for each in self.stop_lines},
            *(_areas(getattr(self, name)) for name in AREAS),
        )


class StartRequest(Struct, frozen=True, tag="start"):
    map: int
    route: tuple[str, ...]
    goal: Pose
    shape: EgoShape
    dt_s: float

    def mission(self, roads: Roads) -> Mission:
        return Mission(roads, self.route, self.goal, self.shape, self.dt_s)


def _line(packed: bytes) -> Polyline:
    return Polyline(np.frombuffer(packed, "<f8").reshape(-1, 2))


def _polygon(rings: Rings) -> shapely.Polygon:
    outer, *inner = (np.frombuffer(ring, "<f8").reshape(-1, 2) for ring in rings)
    return shapely.Polygon(outer, inner)


def _areas(packed: Iterable[PackedArea]) -> tuple[Area, ...]:
    return tuple(Area(each.id, _polygon(each.polygon)) for each in packed)


def as_sent(roads: Roads) -> Roads:
    """A map as a planner gets it: the same, in objects of its own."""
    return msgspec.msgpack.decode(MSGPACK.encode(map_request(roads, 0, MSGPACK.pack)), type=MapRequest).roads()
