"""From a foreign map to `Roads`: lanes that never overlap, connectors between them, roadblocks, intersections."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import shapely

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers import signs
from interplan_sumo.maps.importers.areas import clipped, intersections, numbered, surface_of
from interplan_sumo.maps.importers.connector_paths import ConnectorPath, SegmentLane, SegmentSurfaces, connector_paths
from interplan_sumo.maps.importers.cross_sections import CrossSections
from interplan_sumo.maps.importers.drop_invalid import drop_invalid
from interplan_sumo.maps.importers.implausible import plausible
from interplan_sumo.maps.importers.lane_segments import JOINT_M, lane_segments, links
from interplan_sumo.maps.importers.record import LaneOrigin
from interplan_sumo.maps.importers.sections import SourceStretch, sections
from interplan_sumo.maps.importers.shared_ground import divided
from interplan_sumo.maps.importers.smooth import FARTHEST_IN_JUNCTION_M, FARTHEST_M, smoothed
from interplan_sumo.maps.importers.source import SourceMap
from interplan_sumo.world.geometry import Polyline, wrap_angle
from interplan_sumo.world.roads import Connector, Lane, Roadblock, Roads, Turn

BLOCKS_BEFORE_WAYS = 1_000_000
"""Roadblocks count from 1, roadblock connectors from here."""
LANES_PER_BLOCK = 100
"""Lane and connector ids are those of their block times this, plus the place in it."""
_NOWHERE, _OUTDONE = "an overlap that leads from no lane or to none", "a shorter way joins the same two lanes"
_STRAIGHT_RAD, _U_TURN_RAD = np.radians(30.0), np.radians(150.0)


@dataclass(frozen=True, eq=False)
class Built:
    """Roads made of a foreign map, and how."""

    roads: Roads
    origins: Mapping[str, tuple[LaneOrigin, ...]]
    """By lane and connector id: the stretches of lanes of the file that it consists of, in driving order."""
    left_out: Mapping[str, tuple[str, ...]]
    """Ids of the file by the reason why they are no lanes of the map."""
    notes: tuple[str, ...]


def build(source: SourceMap) -> Built:
    """The map in nuPlan's terms; MapError if the file has no lane, or one without end.

    See `segments` for what becomes a lane and what a connector. A roadblock is a
    stretch of lanes side by side; a roadblock connector holds all connectors
    between the same two. Ids are new; `Built.origins` says what came from where.
    """
    source, flat = plausible(source)
    if not source.lanes:
        raise MapError(f"{source.name}: the file holds no lane for cars")
    parts = sections(source)
    joined = links(source.lanes, parts)
    drawing = _Drawing(source, SegmentSurfaces(parts, lane_segments(source.lanes, parts, joined), joined))
    drawing.draw_lanes()
    drawing.draw_connectors()
    left_out: dict[str, list[str]] = defaultdict(list)
    for item in source.left_out:
        left_out[item.reason].append(item.id)
    reasons = {reason: tuple(ids) for reason, ids in left_out.items()}
    roads, broken = drop_invalid(drawing.roads())
    taken_out = tuple(
        f"{', '.join(dict.fromkeys(origin.source_id for origin in drawing.origins[id_]))}: left out, {reason}"
        for id_, reason in broken.items()
    )
    origins = {id_: rows for id_, rows in drawing.origins.items() if id_ in roads}
    return Built(roads, origins, reasons, (*source.notes, *drawing.notes(), *flat, *taken_out))


@dataclass(eq=False)
class _Drawing:
    source: SourceMap
    ground: SegmentSurfaces
    lanes: dict[str, Lane] = field(default_factory=dict[str, Lane])
    connectors: dict[str, Connector] = field(default_factory=dict[str, Connector])
    roadblocks: dict[str, Roadblock] = field(default_factory=dict[str, Roadblock])
    origins: dict[str, tuple[LaneOrigin, ...]] = field(default_factory=dict[str, tuple[LaneOrigin, ...]])
    id_of: dict[SegmentLane, str] = field(default_factory=dict[SegmentLane, str])
    paths: dict[str, ConnectorPath] = field(default_factory=dict[str, ConnectorPath])
    used: set[SegmentLane] = field(default_factory=set[SegmentLane])

    # --- lanes -----------------------------------------------------------------------------------

    def draw_lanes(self) -> None:
        grounds: dict[str, shapely.Polygon] = {}
        members: dict[str, list[str]] = {}
        for s, section_segments in enumerate(self.ground.segments):
            for p, segment in enumerate(section_segments):
                if not segment.is_lane:
                    continue
                block = str(len(members) + 1)
                members[block] = []
                cross_sections = self.ground.surface(s, p)
                grounds[block] = cross_sections.outline()
                for i in range(cross_sections.lanes):
                    if SegmentLane(s, p, i) in self.ground.twins:
                        self.used.add(SegmentLane(s, p, i))
                        continue
                    id_ = str(int(block) * LANES_PER_BLOCK + i)
                    self.id_of[SegmentLane(s, p, i)] = id_
                    self.used.add(SegmentLane(s, p, i))
                    members[block].append(id_)
                    self.lanes[id_] = self._lane(SegmentLane(s, p, i), id_, block, cross_sections)
        shares = divided(self.lanes, self.source.driving_side)
        surfaces = clipped({id_: shares.get(id_, lane.polygon) for id_, lane in self.lanes.items()})
        self.lanes = {id_: replace(lane, polygon=surfaces[id_]) for id_, lane in self.lanes.items()}
        for block, ids in members.items():
            if any(id_ in shares for id_ in ids):
                grounds[block] = surface_of([surfaces[id_] for id_ in ids])
        for block, polygon in clipped({block: grounds[block] for block, ids in members.items() if ids}).items():
            self.roadblocks[block] = Roadblock(block, polygon, tuple(members[block]))

    def _lane(self, node: SegmentLane, id_: str, block: str, cross_sections: CrossSections) -> Lane:
        line = smoothed(cross_sections.centerline(node.lane))
        own = self._origins((node,), (0.0, 0.0), line)
        on_it = tuple(row for twin in self.ground.twins_of(node) for row in self._origins((twin,), (0.0, 0.0), line))
        self.origins[id_] = (*on_it, *own) if node.segment == 0 else (*own, *on_it)
        first = self.ground.sections[node.section].columns[node.lane][0]
        return Lane(
            id=id_,
            roadblock_id=block,
            index=node.lane,
            centerline=line,
            polygon=cross_sections.polygon(node.lane),
            left_boundary=cross_sections.boundary(node.lane),
            right_boundary=cross_sections.boundary(node.lane + 1),
            speed_limit_mps=self.source.lanes[first].speed_limit_mps,
        )

    # --- connectors ------------------------------------------------------------------------------

    def draw_connectors(self) -> None:
        between: dict[tuple[str, str], list[ConnectorPath]] = defaultdict(list)
        for path in connector_paths(self.ground):
            ends = (self.lanes[self.id_of[node]].roadblock_id for node in (path.start, path.end))
            between[next(ends), next(ends)].append(path)
            self.used.update(path.parts)
        for number, ((start, end), found) in enumerate(sorted(between.items(), key=_by_blocks)):
            block = str(BLOCKS_BEFORE_WAYS + number + 1)
            found.sort(key=lambda path: (path.start.lane, path.end.lane, path.start, path.end))
            ids = [str(int(block) * LANES_PER_BLOCK + k) for k in range(len(found))]
            for id_, path in zip(ids, found, strict=True):
                self.paths[id_] = path
                self.connectors[id_] = self._connector(path, id_, block)
            shape = surface_of([self.connectors[id_].polygon for id_ in ids])
            self.roadblocks[block] = Roadblock(block, shape, tuple(ids), is_connector=True, from_id=start, to_id=end)

    def _connector(self, path: ConnectorPath, id_: str, block: str) -> Connector:
        ends = (self.lanes[self.id_of[node]].centerline for node in (path.start, path.end))
        farthest_m = FARTHEST_IN_JUNCTION_M if self._in_junction(path) else FARTHEST_M
        line = smoothed(path.cross_sections.centerline(), *ends, farthest_m=farthest_m)
        self.origins[id_] = self._origins(path.parts, path.drawn_m, line)
        polygon = path.cross_sections.polygon()
        if polygon.is_empty:
            polygon = shapely.buffer(line.linestring, 1.0, cap_style="flat")
        return Connector(
            id=id_,
            roadblock_id=block,
            from_lane_id=self.id_of[path.start],
            to_lane_id=self.id_of[path.end],
            centerline=line,
            polygon=polygon,
            left_boundary=path.cross_sections.boundary(0),
            right_boundary=path.cross_sections.boundary(1),
            speed_limit_mps=self._limit_mps(path),
            turn=_turn(line),
        )

    def _in_junction(self, path: ConnectorPath) -> bool:
        """Whether a way leads through an intersection: over one that the file names, else over more than a joint."""
        rows = [row for node in path.parts for row in self._stretches(node)]
        if self._names_junctions:
            return any(self.source.lanes[row.source_id].in_intersection for row in rows)
        return path.cross_sections.length_m > 4.0 * JOINT_M

    @cached_property
    def _names_junctions(self) -> bool:
        return any(lane.in_intersection for lane in self.source.lanes.values())

    def _limit_mps(self, path: ConnectorPath) -> float | None:
        """The lowest limit of the lanes of the file on the way; on a mere joint that of the lane before it."""
        rows = [row for node in path.parts for row in self._stretches(node)]
        own = [row for row in rows if row.length_m > 2.0 * JOINT_M or row.to_share - row.from_share > 0.99]
        limits = [self.source.lanes[row.source_id].speed_limit_mps for row in own]
        if not own:
            return self.lanes[self.id_of[path.start]].speed_limit_mps
        return min((limit for limit in limits if limit is not None), default=None)

    # --- where things come from ------------------------------------------------------------------

    def _stretches(self, node: SegmentLane) -> tuple[SourceStretch, ...]:
        """Lanes of the file along a node."""
        segment = self.ground.segment(node)
        return self.ground.sections[node.section].stretches(node.lane, segment.start_m, segment.end_m)

    def _origins(
        self, nodes: Sequence[SegmentLane], drawn_m: Sequence[float], line: Polyline
    ) -> tuple[LaneOrigin, ...]:
        """Origins along a line, whose length the nodes, and what was drawn before and behind each, share by theirs."""
        rows = [self._stretches(node) for node in nodes]
        total = sum(drawn_m) + sum(row.length_m for own in rows for row in own) or 1.0
        found: list[LaneOrigin] = []
        at = 0.0
        for own, gap_m in zip(rows, drawn_m, strict=False):
            at += gap_m / total * line.length_m
            for source_id, first, last, length_m in own:
                to = at + length_m / total * line.length_m
                found.append(LaneOrigin(source_id, round(first, 6), round(last, 6), round(at, 3), round(to, 3)))
                at = to
        return tuple(found)

    def notes(self) -> list[str]:
        """What of the file could not be used."""
        found: list[str] = []
        for here, there, gap_m in self.ground.torn:
            ends = (self._stretches(node)[k][0] for node, k in ((here, -1), (there, 0)))
            found.append(f"the link from {next(ends)} to {next(ends)} is left out: {gap_m:.1f} m lie between the two")
        lost: dict[tuple[str, str], float] = defaultdict(float)
        for node in self.ground.nodes():
            if node not in self.used:
                reason = _OUTDONE if node in self.ground.outdone else _NOWHERE
                for source_id, _, _, length_m in self._stretches(node):
                    lost[source_id, reason] += length_m
        found += [
            f"lane {source_id}: {length_m:.1f} m of it are left out: {reason}"
            for (source_id, reason), length_m in lost.items()
            if length_m > 2.0 * JOINT_M
        ]
        return found

    # --- the whole -------------------------------------------------------------------------------

    def roads(self) -> Roads:
        controls = signs.controls(self.source, self.ground, self.paths)
        stop_lines, connectors = signs.place(self.source, controls, self.lanes, self.connectors)
        areas, roadblocks = intersections(self.lanes, connectors, self.roadblocks, controls)
        paved = [*self.source.drivable, *(item.polygon for item in self.source.left_out if item.polygon is not None)]
        surfaces = shapely.union_all([shapely.buffer(lane.polygon, 0.01) for lane in self.lanes.values()])
        return Roads(
            name=self.source.name,
            crs=self.source.crs,
            driving_side=self.source.driving_side,
            lanes=self.lanes,
            connectors=connectors,
            roadblocks=roadblocks,
            intersections=areas,
            stop_lines=stop_lines,
            crosswalks=numbered(self.source.crosswalks),
            walkways=numbered(self.source.walkways),
            carparks=numbered(self.source.carparks),
            road_segments=numbered([surfaces]),
            generic_drivable_areas=numbered(paved),
        )


def _by_blocks(item: tuple[tuple[str, str], list[ConnectorPath]]) -> tuple[int, int]:
    return int(item[0][0]), int(item[0][1])


def _turn(line: Polyline) -> Turn:
    headings = line.segment_heading_rad
    turned = float(wrap_angle(headings[-1] - headings[0]))
    if abs(turned) <= _STRAIGHT_RAD:
        return Turn.STRAIGHT
    if abs(turned) >= _U_TURN_RAD:
        return Turn.U_TURN
    return Turn.LEFT if turned > 0.0 else Turn.RIGHT
