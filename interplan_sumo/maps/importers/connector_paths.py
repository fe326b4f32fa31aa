"""Ways: every path from one lane to the next over the segments between them, as connectors to be."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely

from interplan_sumo.maps.importers.cross_sections import SPACING_M, CrossSections, bridge
from interplan_sumo.maps.importers.lane_segments import LaneSegment, Links
from interplan_sumo.maps.importers.lines import SHORTEST_M
from interplan_sumo.maps.importers.overlaps import OVERLAP_SHARE
from interplan_sumo.maps.importers.sections import LaneSection
from interplan_sumo.world.geometry import wrap_angle

MEETING_M = 0.3
"""Ends that lie no further apart than this are moved together; over a wider gap a curve is drawn."""
TWINS_M = 1.0
"""Lanes at the end of the map that lie on each other are one unless they are further apart where they go on."""
FARTHEST_M = 80.0
"""No way is drawn over a wider gap: such a link is a fault of the file."""
_ALONG_RAD = np.radians(45.0)
MOST_PARTS = 24
"""Segments in one way; longer chains of overlaps do not occur on roads."""


class SegmentLane(NamedTuple):
    """One lane of one segment of a section."""

    section: int
    segment: int
    lane: int


@dataclass(frozen=True, eq=False)
class ConnectorPath:
    """A path from the end of one lane to the start of another."""

    start: SegmentLane
    parts: tuple[SegmentLane, ...]
    """The segments between; none where only a gap lies between the two."""
    end: SegmentLane
    cross_sections: CrossSections
    """Of one lane, from end to start exactly."""
    drawn_m: tuple[float, ...]
    """Length of the curve drawn over a gap before each part and before the end; 0 where both meet."""


@dataclass(eq=False)
class SegmentSurfaces:
    """The segments of a map, with the surface of each."""

    sections: Sequence[LaneSection]
    segments: Sequence[Sequence[LaneSegment]]
    links: Links
    torn: list[tuple[SegmentLane, SegmentLane, float]] = field(
        default_factory=list[tuple[SegmentLane, SegmentLane, float]]
    )
    """Links over a gap too wide to be one, with its width in metres."""
    outdone: set[SegmentLane] = field(default_factory=set[SegmentLane])
    """Segments of ways between two lanes that a shorter one joins."""
    twins: dict[SegmentLane, SegmentLane] = field(init=False)
    """Lanes that lie on another one where both lead out of the map, or into it, with that other: they are one."""
    _twins_of: dict[SegmentLane, list[SegmentLane]] = field(init=False)
    _cross_sections: dict[tuple[int, int], CrossSections] = field(default_factory=dict[tuple[int, int], CrossSections])

    def __post_init__(self) -> None:
        self.twins = {}
        self.twins = _twins(self)
        self._twins_of = {}
        for other, twin in self.twins.items():
            self._twins_of.setdefault(twin, []).append(other)

    def segment(self, node: SegmentLane) -> LaneSegment:
        return self.segments[node.section][node.segment]

    def surface(self, section: int, segment: int) -> CrossSections:
        """The cross-sections of a segment."""
        key = section, segment
        if key not in self._cross_sections:
            part = self.segments[section][segment]
            cross_sections = self.sections[section].cross_sections.cut(part.start_m, part.end_m)
            self._cross_sections[key] = cross_sections.uncrossed() if cross_sections.lanes == 1 else cross_sections
        return self._cross_sections[key]

    def cross_sections(self, node: SegmentLane) -> CrossSections:
        """The cross-sections of one lane of a segment."""
        return self.surface(node.section, node.segment).lane(node.lane)

    def nodes(self) -> Iterator[SegmentLane]:
        for s, parts in enumerate(self.segments):
            for p in range(len(parts)):
                for i in range(self.sections[s].lanes):
                    yield SegmentLane(s, p, i)

    def twins_of(self, node: SegmentLane) -> Sequence[SegmentLane]:
        """The lanes that lie on this one."""
        return self._twins_of.get(node, ())

    def following(self, node: SegmentLane) -> tuple[SegmentLane, ...]:
        """The nodes into which a node leads, with those into which its twins do."""
        one = (node, *self.twins_of(node))
        found = (self.twins.get(ahead, ahead) for each in one for ahead in self._ahead(each))
        return tuple(dict.fromkeys(found))

    def _ahead(self, node: SegmentLane) -> tuple[SegmentLane, ...]:
        if node.segment + 1 < len(self.segments[node.section]):
            return (SegmentLane(node.section, node.segment + 1, node.lane),)
        ahead = self.links.ahead.get((node.section, node.lane), ())
        return tuple(SegmentLane(s, 0, i) for s, i in ahead)


def _twins(ground: SegmentSurfaces) -> dict[SegmentLane, SegmentLane]:
    """Lanes at the ends of the map that lie on an earlier one of the same direction."""
    found: dict[SegmentLane, SegmentLane] = {}
    for at_end in (False, True):
        nodes = [node for node in ground.nodes() if _is_loose(ground, node, at_end=at_end)]
        for one, other in _lying_on(ground, nodes):
            inner = [ground.cross_sections(node).middles[0 if at_end else -1, 0] for node in (one, other)]
            if np.hypot(*(inner[1] - inner[0])) > TWINS_M or _turned_rad(ground, one, other) > _ALONG_RAD:
                continue
            if one not in found and other not in found:
                found[other] = one
    return found


def _lying_on(ground: SegmentSurfaces, nodes: Sequence[SegmentLane]) -> list[tuple[SegmentLane, SegmentLane]]:
    """Pairs of lanes that share too much of the surface of one of them, the earlier first."""
    shapes = np.array([ground.cross_sections(node).polygon() for node in nodes], dtype=object)
    if not len(shapes):
        return []
    one, other = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    one, other = one[one < other], other[one < other]
    shared = shapely.area(shapely.intersection(shapes[one], shapes[other]))
    smaller = np.minimum(shapely.area(shapes[one]), shapely.area(shapes[other]))
    rows = np.flatnonzero(shared > OVERLAP_SHARE * smaller)
    return sorted((nodes[int(one[k])], nodes[int(other[k])]) for k in rows)


def _turned_rad(ground: SegmentSurfaces, one: SegmentLane, other: SegmentLane) -> float:
    """The angle between the directions of two lanes."""
    headings = [ground.cross_sections(node).centerline().segment_heading_rad[0] for node in (one, other)]
    return abs(float(wrap_angle(headings[1] - headings[0])))


def _is_loose(ground: SegmentSurfaces, node: SegmentLane, *, at_end: bool) -> bool:
    """Whether a lane begins (or ends) where the map does."""
    parts = ground.segments[node.section]
    links = ground.links.ahead if at_end else ground.links.behind
    at_edge = node.segment == (len(parts) - 1 if at_end else 0)
    return len(parts) > 1 and at_edge and parts[node.segment].is_lane and not links.get((node.section, node.lane))


def connector_paths(ground: SegmentSurfaces) -> tuple[ConnectorPath, ...]:
    """All ways of a map; of several between the same two lanes the shortest, since SUMO knows one."""
    best: dict[tuple[SegmentLane, SegmentLane], ConnectorPath] = {}
    torn: dict[tuple[SegmentLane, SegmentLane], float] = {}
    for start in ground.nodes():
        if not ground.segment(start).is_lane or start in ground.twins:
            continue
        for parts, end in _paths(ground, start):
            way = _connector_path(ground, (start, *parts, end), torn)
            known = best.get((start, end))
            if way is None:
                continue
            if known is None or way.cross_sections.length_m < known.cross_sections.length_m:
                best[start, end], way = way, known
            ground.outdone.update(() if way is None else way.parts)
    ground.torn.extend((a, b, gap_m) for (a, b), gap_m in torn.items())
    return tuple(best.values())


def _paths(ground: SegmentSurfaces, start: SegmentLane) -> Iterator[tuple[tuple[SegmentLane, ...], SegmentLane]]:
    """Every path from a lane to a lane: the segments between, and where it ends."""
    stack: list[tuple[SegmentLane, ...]] = [(node,) for node in reversed(ground.following(start))]
    while stack:
        path = stack.pop()
        if ground.segment(path[-1]).is_lane:
            yield path[:-1], path[-1]
        elif len(path) <= MOST_PARTS:
            stack += [(*path, node) for node in reversed(ground.following(path[-1])) if node not in path]


def _connector_path(
    ground: SegmentSurfaces, path: Sequence[SegmentLane], torn: dict[tuple[SegmentLane, SegmentLane], float]
) -> ConnectorPath | None:
    """What lies between the first and the last lane of a path; None where the path is torn or leads nowhere."""
    found: CrossSections | None = None
    drawn_m: list[float] = []
    before = ground.cross_sections(path[0])
    for here, there in pairwise(path):
        after = ground.cross_sections(there)
        gap_m = float(np.hypot(*(after.middles[0, 0] - before.middles[-1, 0])))
        if gap_m > FARTHEST_M:
            torn[here, there] = gap_m
            return None
        if gap_m > MEETING_M:
            curve = bridge(before, after)
            found = curve if found is None else found.joined(curve)
        drawn_m.append(gap_m if gap_m > MEETING_M else 0.0)
        if there != path[-1]:
            found = after if found is None else found.joined(after)
        before = after
    if found is None:  # two lanes that meet, with nothing between: cannot be, joints give each a segment
        return None
    start, end = ground.cross_sections(path[0]).middles[-1, 0], ground.cross_sections(path[-1]).middles[0, 0]
    if np.hypot(*(end - start)) < SHORTEST_M / 2.0 and found.length_m < SPACING_M:  # out and straight back, or nowhere
        return None
    whole = found.moved(start - found.middles[0, 0], end - found.middles[-1, 0]).uncrossed()
    return ConnectorPath(path[0], tuple(path[1:-1]), path[-1], whole, tuple(drawn_m))
