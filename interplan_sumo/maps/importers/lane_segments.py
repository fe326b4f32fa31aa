"""Segments: which stretches of the sections become lanes, and which connectors.

nuPlan wants lanes that never overlap, and a connector between any two. A
stretch on which lanes overlap (where they fork, merge or cross), or which the
file calls an intersection, becomes connectors; so does half a metre on either
side of a joint at which two lanes would meet directly. The rest are lanes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.maps.importers.cross_sections import cells
from interplan_sumo.maps.importers.sections import LaneSection
from interplan_sumo.maps.importers.source import SourceLane
from interplan_sumo.world.geometry import Floats

OVERLAP_SHARE = 0.25
"""Lanes that share more than this of their width are in each other's way; less is a matter of drawing."""
CELL_M = 1.0
MARGIN_M = 0.5
"""Kept free before and behind an overlap."""
JOINT_M = 0.5
"""What each of two lanes gives to the connector between them."""
SHORTEST_END_M = 4.0
"""A free stretch before or behind an overlap is a lane from this length on."""
SHORTEST_BETWEEN_M = 20.0
"""A free stretch between two overlaps: a shorter one lies within an intersection, and nobody should wait there."""
SHORTEST_WHOLE_M = 1.5
"""A section free from end to end."""
CROSSING_SHARE, LONGEST_CROSSING_M = 0.4, 80.0
"""A section no longer than this, of which so much overlaps, leads through an intersection: all of it is connectors."""
STUB_M = 1.4
"""The lane that stands where an overlap leads out of the map."""

LaneEnd = tuple[int, int]
"""Section and lane in it."""


@dataclass(frozen=True, slots=True)
class LaneSegment:
    """A stretch of a section, all its lanes."""

    start_m: float
    end_m: float
    is_lane: bool

    @property
    def length_m(self) -> float:
        return self.end_m - self.start_m


@dataclass(frozen=True, slots=True)
class Links:
    """Who follows whom across the ends of sections, in the file's order."""

    ahead: Mapping[LaneEnd, tuple[LaneEnd, ...]]
    behind: Mapping[LaneEnd, tuple[LaneEnd, ...]]


def links(lanes: Mapping[str, SourceLane], sections: Sequence[LaneSection]) -> Links:
    """The links between the ends of sections; within one, lanes go on by themselves."""
    start_of = {section.rows[0][i]: (s, i) for s, section in enumerate(sections) for i in range(section.lanes)}
    ahead: dict[LaneEnd, list[LaneEnd]] = {}
    behind: dict[LaneEnd, list[LaneEnd]] = {}
    for s, section in enumerate(sections):
        for i, lane in enumerate(section.rows[-1]):
            ahead.setdefault((s, i), [])
            behind.setdefault((s, i), [])
            for following in lanes[lane].successors:
                if following in start_of and start_of[following] not in ahead[s, i]:
                    ahead[s, i].append(start_of[following])
                    behind.setdefault(start_of[following], []).append((s, i))
    return Links({k: tuple(v) for k, v in ahead.items()}, {k: tuple(v) for k, v in behind.items()})


def lane_segments(
    lanes: Mapping[str, SourceLane], sections: Sequence[LaneSection], ways: Links
) -> tuple[tuple[LaneSegment, ...], ...]:
    """The segments of every section, one behind the other from its start to its end."""
    apart = _stretches(lanes, sections, ways)
    found: list[tuple[LaneSegment, ...]] = []
    for s, section in enumerate(sections):
        first, last = apart[s][0].is_lane, apart[s][-1].is_lane
        ends = [(s, i) for i in range(section.lanes)]
        joint_ahead = last and any(apart[t][0].is_lane for end in ends for t, _ in ways.ahead.get(end, ()))
        joint_behind = first and any(apart[t][-1].is_lane for end in ends for t, _ in ways.behind.get(end, ()))
        found.append(_with_joints(apart[s], behind=joint_behind, ahead=joint_ahead))
    return tuple(found)


def _with_joints(parts: Sequence[LaneSegment], *, behind: bool, ahead: bool) -> tuple[LaneSegment, ...]:
    """The segments with connectors at the ends where lanes would meet lanes directly."""
    found = list(parts)
    if behind:
        lane = found[0]
        cut_m = lane.start_m + min(JOINT_M, lane.length_m / 4.0)
        found[:1] = [LaneSegment(lane.start_m, cut_m, False), LaneSegment(cut_m, lane.end_m, True)]
    if ahead:
        lane = found[-1]
        cut_m = lane.end_m - min(JOINT_M, lane.length_m / 4.0)
        found[-1:] = [LaneSegment(lane.start_m, cut_m, True), LaneSegment(cut_m, lane.end_m, False)]
    return tuple(found)


def _stretches(
    lanes: Mapping[str, SourceLane], sections: Sequence[LaneSection], ways: Links
) -> tuple[tuple[LaneSegment, ...], ...]:
    """Free and overlapped stretches of every section, as lanes and connectors in turn."""
    cut = [cells(section.cross_sections, CELL_M) for section in sections]
    taken = _overlapped([polygons for polygons, _ in cut], ways)
    found: list[tuple[LaneSegment, ...]] = []
    for s, section in enumerate(sections):
        stations = cut[s][1]
        taken[s] |= _in_intersections(lanes, section, stations)
        ends = [(s, i) for i in range(section.lanes)]
        open_start = any(not ways.behind.get(end) for end in ends)
        open_end = any(not ways.ahead.get(end) for end in ends)
        found.append(_turns(section.length_m, stations, taken[s], open_start=open_start, open_end=open_end))
    return tuple(found)


def _in_intersections(lanes: Mapping[str, SourceLane], section: LaneSection, stations: Floats) -> NDArray[np.bool_]:
    """(C,) cells that lie in what the file calls an intersection."""
    middle = (stations[:-1] + stations[1:]) / 2.0
    row = np.clip(np.searchsorted(section.seams_m, middle) - 1, 0, len(section.rows) - 1)
    inside = np.array([any(lanes[lane].in_intersection for lane in ids) for ids in section.rows])
    return inside[row]


def _overlapped(polygons: Sequence[NDArray[np.object_]], ways: Links) -> list[NDArray[np.bool_]]:
    """(C,) per section: cells in which a lane shares too much of its width with one that is not its neighbour."""
    shapes = np.concatenate([p.ravel() for p in polygons])
    bad = ~shapely.is_valid(shapes)
    shapes[bad] = shapely.convex_hull(shapes[bad])
    section = np.concatenate([np.full(p.size, s) for s, p in enumerate(polygons)])
    lane = np.concatenate([np.tile(np.arange(p.shape[1]), p.shape[0]) for p in polygons])
    cell = np.concatenate([np.repeat(np.arange(p.shape[0]), p.shape[1]) for p in polygons])
    one, other = shapely.STRtree(shapes).query(shapes, predicate="intersects")
    apart = (section[one] != section[other]) & (one < other)
    one, other = one[apart], other[apart]
    joined = {((s, i), end) for (s, i), ends in ways.ahead.items() for end in ends}
    joined |= {(b, a) for a, b in joined}
    linked = np.array(
        [
            ((int(section[a]), int(lane[a])), (int(section[b]), int(lane[b]))) in joined
            for a, b in zip(one, other, strict=True)
        ],
        dtype=np.bool_,
    )
    one, other = one[~linked], other[~linked]
    common = shapely.area(shapely.intersection(shapes[one], shapes[other]))
    one, other, common = np.append(one, other), np.append(other, one), np.append(common, common)
    # Cells of the other lane lie behind one another, so what they share with this one adds up, lane by lane.
    lanes_of = section[other] * (int(lane.max(initial=0)) + 1) + lane[other]
    order = np.lexsort((lanes_of, one))
    one, lanes_of, common = one[order], lanes_of[order], common[order]
    fresh = np.flatnonzero(np.diff(one, prepend=-1).astype(bool) | np.diff(lanes_of, prepend=-1).astype(bool))
    shared = np.add.reduceat(common, fresh) if len(fresh) else common
    whole = shapely.area(shapes)
    found = [np.zeros(p.shape[0], dtype=np.bool_) for p in polygons]
    for row, area in zip(one[fresh].tolist(), shared.tolist(), strict=True):
        if area > OVERLAP_SHARE * whole[row] and area > 0.05:
            found[int(section[row])][int(cell[row])] = True
    return found


def _turns(
    length_m: float, stations: Floats, taken: NDArray[np.bool_], *, open_start: bool, open_end: bool
) -> tuple[LaneSegment, ...]:
    """Lanes and connectors in turn along a section, from the cells that are taken."""
    if not taken.any():
        return (LaneSegment(0.0, length_m, length_m >= SHORTEST_WHOLE_M or open_start or open_end),)
    if taken.mean() >= CROSSING_SHARE and length_m <= LONGEST_CROSSING_M:
        taken = np.ones_like(taken)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], taken, [False])).astype(np.int8)))
    busy = [
        [max(0.0, float(stations[a]) - MARGIN_M), min(length_m, float(stations[b]) + MARGIN_M)]
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]
    if busy[0][0] < SHORTEST_END_M:
        busy[0][0] = 0.0
    if length_m - busy[-1][1] < SHORTEST_END_M:
        busy[-1][1] = length_m
    merged = [busy[0]]
    for start_m, end_m in busy[1:]:
        if start_m - merged[-1][1] < SHORTEST_BETWEEN_M:
            merged[-1][1] = end_m
        else:
            merged.append([start_m, end_m])
    stub_m = min(STUB_M, length_m / 3.0)
    if open_start and merged[0][0] == 0.0:
        merged[0][0] = stub_m
    if open_end and merged[-1][1] == length_m:
        merged[-1][1] = length_m - stub_m
    found: list[LaneSegment] = []
    at_m = 0.0
    for start_m, end_m in merged:
        if start_m > at_m:
            found.append(LaneSegment(at_m, start_m, True))
        found.append(LaneSegment(start_m, end_m, False))
        at_m = end_m
    if at_m < length_m:
        found.append(LaneSegment(at_m, length_m, True))
    return tuple(found)
