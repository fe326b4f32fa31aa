"""Roads: what planners and metrics know of a map, in nuPlan's terms.

A *lane* is a piece of road between two cuts; lanes are joined by *connectors*
and never directly. Parallel lanes form a *roadblock*, parallel connectors a
*roadblock connector*; both are `Roadblock` here, told apart by `is_connector`.
Ids are strings of positive integers, unique across lanes and connectors, and
unique across roadblocks and roadblock connectors.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from types import MappingProxyType
from typing import Literal

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from interplan_sumo.world.geometry import Polyline

DrivingSide = Literal["left", "right"]

USUAL_LIMIT_MPS = 13.89
"""Stands in where a map knows no limit: 50 km/h, the usual one in towns."""


class Turn(IntEnum):
    """Turn of a connector, with nuPlan's codes."""

    STRAIGHT = 0
    LEFT = 1
    RIGHT = 2
    U_TURN = 3
    UNKNOWN = 4


class StopLineKind(IntEnum):
    """Why one stops, with nuPlan's codes."""

    PEDESTRIAN_CROSSING = 0
    STOP_SIGN = 1
    TRAFFIC_LIGHT = 2
    TURN_STOP = 3
    YIELD = 4
    UNKNOWN = 5


class IntersectionKind(IntEnum):
    """How an intersection is controlled, with nuPlan's codes."""

    DEFAULT = 0
    TRAFFIC_LIGHT = 1
    STOP_SIGN = 2
    LANE_BRANCH = 3
    LANE_MERGE = 4
    PASS_THROUGH = 5


@dataclass(frozen=True, slots=True, eq=False)
class Lane:
    """A lane between two cuts of the road."""

    id: str
    roadblock_id: str
    index: int
    """Place in the roadblock, 0 is geometrically leftmost."""
    centerline: Polyline
    """Directed with the traffic; vertices at most 1 m apart."""
    polygon: shapely.Polygon
    left_boundary: Polyline
    right_boundary: Polyline
    speed_limit_mps: float | None
    """None where the map knows none."""


@dataclass(frozen=True, slots=True, eq=False)
class Connector:
    """A way from the end of one lane to the start of another."""

    id: str
    roadblock_id: str
    from_lane_id: str
    to_lane_id: str
    centerline: Polyline
    polygon: shapely.Polygon
    left_boundary: Polyline
    right_boundary: Polyline
    speed_limit_mps: float | None
    turn: Turn = Turn.UNKNOWN
    stop_line_ids: tuple[str, ...] = ()
    """Stop lines of the traffic light that controls it; empty without a light."""

    @property
    def has_traffic_light(self) -> bool:
        """Whether a light holds whoever takes it."""
        return bool(self.stop_line_ids)


LaneLike = Lane | Connector


@dataclass(frozen=True, slots=True, eq=False)
class Roadblock:
    """Parallel lanes (or parallel connectors) that share a start and an end cut."""

    id: str
    polygon: shapely.Polygon
    lane_ids: tuple[str, ...]
    """Lanes from left to right, or the connectors."""
    is_connector: bool = False
    from_id: str | None = None
    """Upstream roadblock, of a roadblock connector."""
    to_id: str | None = None
    """Downstream roadblock, of a roadblock connector."""
    intersection_id: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class StopLine:
    """Where one stops: a polygon across the lanes it holds for."""

    id: str
    polygon: shapely.Polygon
    kind: StopLineKind


@dataclass(frozen=True, slots=True, eq=False)
class Area:
    """A marked area: crosswalk, walkway, car park, road segment or other drivable surface."""

    id: str
    polygon: shapely.Polygon


@dataclass(frozen=True, slots=True, eq=False)
class Intersection:
    """The area where roads cross, merge or branch."""

    id: str
    polygon: shapely.Polygon
    kind: IntersectionKind = IntersectionKind.DEFAULT


@dataclass(frozen=True, eq=False)
class Roads:
    """One map, checked for broken links on construction (ValueError names the id)."""

    name: str
    crs: str
    """Projected coordinate system of all coordinates, such as "EPSG:32611"."""
    driving_side: DrivingSide
    lanes: Mapping[str, Lane]
    connectors: Mapping[str, Connector]
    roadblocks: Mapping[str, Roadblock]
    """Roadblocks and roadblock connectors."""
    intersections: tuple[Intersection, ...] = ()
    stop_lines: Mapping[str, StopLine] = field(default_factory=dict[str, StopLine])
    crosswalks: tuple[Area, ...] = ()
    walkways: tuple[Area, ...] = ()
    carparks: tuple[Area, ...] = ()
    road_segments: tuple[Area, ...] = ()
    generic_drivable_areas: tuple[Area, ...] = ()

    def __post_init__(self) -> None:
        for name in ("lanes", "connectors", "roadblocks", "stop_lines"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        for lane in self.lanes.values():
            if lane.roadblock_id not in self.roadblocks:
                raise ValueError(f"lane {lane.id} belongs to roadblock {lane.roadblock_id}, which does not exist")
            if lane.id in self.connectors:
                raise ValueError(f"id {lane.id} names both a lane and a connector")
        for connector in self.connectors.values():
            if connector.roadblock_id not in self.roadblocks:
                raise ValueError(
                    f"connector {connector.id} belongs to roadblock {connector.roadblock_id}, which does not exist"
                )
            for end in (connector.from_lane_id, connector.to_lane_id):
                if end not in self.lanes:
                    raise ValueError(f"connector {connector.id} joins lane {end}, which does not exist")
            for stop_line in connector.stop_line_ids:
                if stop_line not in self.stop_lines:
                    raise ValueError(f"connector {connector.id} names stop line {stop_line}, which does not exist")
        for block in self.roadblocks.values():
            members = self.connectors if block.is_connector else self.lanes
            for member in block.lane_ids:
                if member not in members:
                    raise ValueError(f"roadblock {block.id} holds {member}, which does not exist")

    # --- the lane graph ------------------------------------------------------------------------

    def __getitem__(self, lane_id: str) -> LaneLike:
        """The lane or connector with this id; KeyError if there is none."""
        lane = self.lanes.get(lane_id)
        return lane if lane is not None else self.connectors[lane_id]

    def __contains__(self, lane_id: object) -> bool:
        return lane_id in self.lanes or lane_id in self.connectors

    @cached_property
    def _links(self) -> tuple[dict[str, tuple[str, ...]], dict[str, tuple[str, ...]]]:
        outgoing: dict[str, list[str]] = {lane: [] for lane in self.lanes}
        incoming: dict[str, list[str]] = {lane: [] for lane in self.lanes}
        for connector in self.connectors.values():
            outgoing[connector.from_lane_id].append(connector.id)
            incoming[connector.to_lane_id].append(connector.id)
        return {k: tuple(v) for k, v in outgoing.items()}, {k: tuple(v) for k, v in incoming.items()}

    def outgoing(self, lane_id: str) -> tuple[str, ...]:
        """Connectors that leave a lane, or the one lane that a connector enters."""
        connector = self.connectors.get(lane_id)
        return (connector.to_lane_id,) if connector is not None else self._links[0][lane_id]

    def incoming(self, lane_id: str) -> tuple[str, ...]:
        """Connectors that enter a lane, or the one lane that a connector leaves."""
        connector = self.connectors.get(lane_id)
        return (connector.from_lane_id,) if connector is not None else self._links[1][lane_id]

    def _neighbour(self, lane_id: str, step: int) -> Lane | None:
        lane = self.lanes.get(lane_id)
        if lane is None:
            return None
        siblings = self.roadblocks[lane.roadblock_id].lane_ids
        at = siblings.index(lane_id) + step
        return self.lanes[siblings[at]] if 0 <= at < len(siblings) else None

    def left_of(self, lane_id: str) -> Lane | None:
        """The neighbour lane of the same direction, geometrically on the left; None for a connector."""
        return self._neighbour(lane_id, -1)

    def right_of(self, lane_id: str) -> Lane | None:
        """The neighbour lane of the same direction, geometrically on the right; None for a connector."""
        return self._neighbour(lane_id, +1)

    @cached_property
    def _block_links(self) -> tuple[dict[str, tuple[str, ...]], dict[str, tuple[str, ...]]]:
        outgoing: dict[str, list[str]] = {block: [] for block in self.roadblocks}
        incoming: dict[str, list[str]] = {block: [] for block in self.roadblocks}
        for block in self.roadblocks.values():
            if block.is_connector and block.from_id is not None and block.to_id is not None:
                outgoing[block.from_id].append(block.id)
                incoming[block.id].append(block.from_id)
                outgoing[block.id].append(block.to_id)
                incoming[block.to_id].append(block.id)
        return {k: tuple(v) for k, v in outgoing.items()}, {k: tuple(v) for k, v in incoming.items()}

    def outgoing_roadblocks(self, block_id: str) -> tuple[str, ...]:
        """Roadblock connectors that leave a roadblock, or the roadblock that a roadblock connector enters."""
        return self._block_links[0][block_id]

    def incoming_roadblocks(self, block_id: str) -> tuple[str, ...]:
        """Roadblock connectors that enter a roadblock, or the roadblock that a roadblock connector leaves."""
        return self._block_links[1][block_id]

    # --- where things are ----------------------------------------------------------------------

    @cached_property
    def _lane_index(self) -> tuple[tuple[str, ...], shapely.STRtree]:
        return tuple(self.lanes), shapely.STRtree([lane.polygon for lane in self.lanes.values()])

    @cached_property
    def _connector_index(self) -> tuple[tuple[str, ...], shapely.STRtree]:
        return tuple(self.connectors), shapely.STRtree([c.polygon for c in self.connectors.values()])

    @cached_property
    def _intersection_index(self) -> shapely.STRtree:
        return shapely.STRtree([area.polygon for area in self.intersections])

    @cached_property
    def _drivable_index(self) -> shapely.STRtree:
        areas = (*self.road_segments, *self.intersections, *self.generic_drivable_areas, *self.carparks)
        return shapely.STRtree([area.polygon for area in areas])

    @staticmethod
    def _containing(ids: tuple[str, ...], tree: shapely.STRtree, x_m: float, y_m: float) -> tuple[str, ...]:
        hits = tree.query(shapely.Point(x_m, y_m), predicate="within")
        return tuple(ids[i] for i in np.sort(hits))

    def lanes_at(self, x_m: float, y_m: float) -> tuple[str, ...]:
        """Lanes whose polygon contains the point; a point on an edge is outside (nuPlan's strict rule)."""
        return self._containing(*self._lane_index, x_m, y_m)

    def connectors_at(self, x_m: float, y_m: float) -> tuple[str, ...]:
        """Connectors whose polygon contains the point, in map order; they may overlap."""
        return self._containing(*self._connector_index, x_m, y_m)

    def at(self, x_m: float, y_m: float) -> tuple[str, ...]:
        """The lane that contains the point, else all connectors that do (nuPlan's order), else nothing."""
        return self.lanes_at(x_m, y_m) or self.connectors_at(x_m, y_m)

    def nearest_lane(self, x_m: float, y_m: float) -> str:
        """The lane or connector whose polygon is nearest to the point; ties go to lanes, then to map order."""
        point = shapely.Point(x_m, y_m)
        best: tuple[float, int, int, str] | None = None
        for rank, (ids, tree) in enumerate((self._lane_index, self._connector_index)):
            if ids:
                i = int(tree.nearest(point))
                distance = float(shapely.distance(self[ids[i]].polygon, point))
                candidate = (distance, rank, i, ids[i])
                best = candidate if best is None or candidate < best else best
        if best is None:
            raise ValueError(f"map {self.name} has no lanes")
        return best[3]

    def lanes_near(self, x_m: float, y_m: float, radius_m: float) -> tuple[str, ...]:
        """Lanes and connectors with a polygon within `radius_m` of the point, lanes first, in map order."""
        point = shapely.Point(x_m, y_m)
        found: list[str] = []
        for ids, tree in (self._lane_index, self._connector_index):
            found += [ids[i] for i in np.sort(tree.query(point, predicate="dwithin", distance=radius_m))]
        return tuple(found)

    def in_intersection(self, x_m: float, y_m: float) -> bool:
        """Whether the point lies inside an intersection."""
        return self._intersection_index.query(shapely.Point(x_m, y_m), predicate="within").size > 0

    def drivable(self, xy: ArrayLike) -> NDArray[np.bool_]:
        """(K,) whether points (K, 2) lie inside the drivable area.

        Drivable are road segments, intersections, generic drivable areas and
        car parks (nuPlan's rule); lanes themselves are not consulted.
        """
        points = np.atleast_1d(np.asarray(shapely.points(np.atleast_2d(np.asarray(xy, dtype=np.float64)))))
        inside = np.zeros(len(points), dtype=np.bool_)
        inside[self._drivable_index.query(points, predicate="within")[0]] = True
        return inside

    def distance_to_drivable_m(self, xy: ArrayLike) -> NDArray[np.float64]:
        """(K,) distance of points (K, 2) to the nearest drivable polygon; infinite where the map has none."""
        points = np.atleast_1d(np.asarray(shapely.points(np.atleast_2d(np.asarray(xy, dtype=np.float64)))))
        distance = np.full(len(points), np.inf)
        if self._drivable_index.geometries.size:
            (rows, _), found = self._drivable_index.query_nearest(points, all_matches=False, return_distance=True)
            distance[rows] = found
        return distance

    @cached_property
    def drivable_area(self) -> shapely.Geometry:
        """The union of all drivable areas, for drawing and export."""
        return shapely.union_all(self._drivable_index.geometries)

    # --- routes --------------------------------------------------------------------------------

    def route_through(self, lane_ids: Iterable[str]) -> tuple[str, ...]:
        """Roadblock ids that a chain of lanes and connectors passes, repeats removed."""
        route: list[str] = []
        for lane_id in lane_ids:
            block = self[lane_id].roadblock_id
            if not route or route[-1] != block:
                route.append(block)
        return tuple(route)
