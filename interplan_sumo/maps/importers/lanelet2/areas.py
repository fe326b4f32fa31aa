"""Areas and lanelets that are no lanes, as polygons: car parks, ways for pedestrians, other paved ground."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np
import shapely

from interplan_sumo.maps.importers.lanelet2.lanelets import (
    Kind,
    Lanelet,
    UnusableError,
    kind_of,
    points_of,
    reason_of,
    truth,
)
from interplan_sumo.maps.importers.lanelet2.osm import OsmFile, Relation
from interplan_sumo.maps.importers.source import LeftOut
from interplan_sumo.world.geometry import Floats

_CARPARKS = frozenset({"parking", "parking_lot", "parking_space"})
_WALKWAYS = frozenset({"walkway", "shared_walkway", "stairs"})
_DRIVABLE = frozenset(
    {"road", "highway", "play_street", "exit", "freespace", "bus_lane", "bicycle_lane", "emergency_lane"}
)
_DRIVABLE_OUTLINES = frozenset({"hatched_road_markings", "bus_stop_area"})  # ways with area=yes, Autoware's


@dataclass(eq=False)
class Grounds:
    """The polygons of a map by use, and what could not be used."""

    crosswalks: list[shapely.Polygon] = field(default_factory=list[shapely.Polygon])
    walkways: list[shapely.Polygon] = field(default_factory=list[shapely.Polygon])
    carparks: list[shapely.Polygon] = field(default_factory=list[shapely.Polygon])
    drivable: list[shapely.Polygon] = field(default_factory=list[shapely.Polygon])
    left_out: list[LeftOut] = field(default_factory=list[LeftOut])
    """Every lanelet that is no lane for cars."""
    unusable: list[str] = field(default_factory=list[str])
    """Areas that cannot be drawn, each with the reason."""
    passed_over: Counter[str] = field(default_factory=Counter[str])
    """Areas that matter to nobody who drives, by subtype."""

    def add_lanelet(self, lanelet: Lanelet) -> None:
        """A lanelet that is no lane for cars."""
        kind = kind_of(lanelet.tags)
        polygon = lanelet.polygon
        if polygon is not None and kind in (Kind.CROSSWALK, Kind.WALKWAY):
            (self.crosswalks if kind is Kind.CROSSWALK else self.walkways).append(polygon)
        self.left_out.append(LeftOut(lanelet.id, reason_of(lanelet.tags), polygon if kind is Kind.DRIVABLE else None))

    def add_areas(self, file: OsmFile, points: dict[str, tuple[float, float]]) -> None:
        """Multipolygons, and ways that outline an area."""
        for relation in file.of_type("multipolygon", "area"):
            subtype = relation.tags.get("subtype", "")
            use = self._use(subtype)
            if use is None:
                self.passed_over[subtype or "without subtype"] += 1
                continue
            try:
                use.extend(_polygons(file, points, relation))
            except UnusableError as error:
                self.unusable.append(f"{relation.id}, which {error}")
        for way in file.ways.values():
            use = self._use(way.tags.get("type", ""))
            if use is not None and truth(way.tags.get("area", ""), False):
                try:
                    use.append(_polygon(points_of(file, points, way.id), []))
                except UnusableError as error:
                    self.unusable.append(f"{way.id}, which {error}")

    def _use(self, subtype: str) -> list[shapely.Polygon] | None:
        if subtype in _CARPARKS:
            return self.carparks
        if subtype in _WALKWAYS:
            return self.walkways
        return self.drivable if subtype in _DRIVABLE | _DRIVABLE_OUTLINES else None


def _polygons(file: OsmFile, points: dict[str, tuple[float, float]], relation: Relation) -> list[shapely.Polygon]:
    outer, inner = (_rings(file, points, relation.refs(role)) for role in ("outer", "inner"))
    if not outer:
        raise UnusableError("has no outline")
    return [
        _polygon(ring, [hole for hole in inner if shapely.Polygon(ring).covers(shapely.Point(hole[0]))])
        for ring in outer
    ]


def _polygon(ring: Floats, holes: list[Floats]) -> shapely.Polygon:
    if len(ring) < 3:
        raise UnusableError("has fewer than three corners")
    polygon = shapely.Polygon(ring, holes)
    if not polygon.is_valid or polygon.area <= 0.0:
        raise UnusableError("has an outline that crosses itself")
    return polygon


def _rings(file: OsmFile, points: dict[str, tuple[float, float]], ways: tuple[str, ...]) -> list[Floats]:
    """Closed rings of ways laid end to end, each turned as needed; UnusableError if they do not close."""
    rings: list[Floats] = []
    lines = {way: points_of(file, points, way) for way in ways}
    pending = [(file.ways[way].nodes, line) for way, line in lines.items() if len(line)]
    while pending:
        nodes, line = pending.pop(0)
        while nodes[0] != nodes[-1]:
            row = next((row for row, (other, _) in enumerate(pending) if nodes[-1] in (other[0], other[-1])), None)
            if row is None:
                raise UnusableError("has an outline that does not close")
            more, more_line = pending.pop(row)
            if more[0] != nodes[-1]:
                more, more_line = more[::-1], more_line[::-1]
            nodes, line = nodes + more[1:], np.concatenate((line, more_line[1:]))
        if len(nodes) < 4:
            raise UnusableError("has fewer than three corners")
        rings.append(line)
    return rings
