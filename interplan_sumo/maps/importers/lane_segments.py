"""Segments: which stretches of the sections become lanes, and which connectors.

nuPlan wants lanes that never overlap, and a connector between any two. A
stretch on which lanes are in each other's way (where they fork, merge or
cross), or which the file calls an intersection, becomes connectors; so does
half a metre on either side of a joint at which two lanes would meet directly.
The rest are lanes, also where both directions share a narrow street.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.maps.importers.overlaps import LaneEnd, SectionCells, section_cells
from interplan_sumo.maps.importers.sections import LaneSection
from interplan_sumo.maps.importers.source import SourceLane

MARGIN_M = 0.5
"""Kept free before and behind an overlap."""
JOINT_M = 0.3
"""What each of two lanes gives to the connector between them."""
SHORTEST_END_M = 5.6
"""A free stretch before or behind an overlap is a lane from this length on."""
SHORTEST_BETWEEN_M = 20.0
"""A free stretch between two overlaps: a shorter one lies within an intersection, and nobody should wait there.
What the file tells apart from its intersections is a lane from `SHORTEST_END_M` on."""
LONGEST_WAY_M = 30.0
"""What the file calls an intersection, with nobody in the way for longer than this, is a drive or an alley."""
SHORTEST_WHOLE_M = 1.5
"""A section free from end to end."""
CROSSING_SHARE, LONGEST_CROSSING_M = 0.4, 80.0
"""A section no longer than this, of which so much overlaps, leads through an intersection, unless the file knows where
these are: all of it is connectors."""
STUB_M = 5.6
"""The lane that stands where an overlap leads out of the map; what is hardly longer is all lane."""


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
    flags = [[any(lanes[lane].in_intersection for lane in row) for row in section.rows] for section in sections]
    linked = frozenset((end, following) for end, ahead in ways.ahead.items() for following in ahead)
    knows = any(any(row) for row in flags)
    found: list[tuple[LaneSegment, ...]] = []
    for s, (section, cells) in enumerate(zip(sections, section_cells(sections, flags, linked), strict=True)):
        ends = [(s, i) for i in range(section.lanes)]
        open_start = any(not ways.behind.get(end) for end in ends)
        open_end = any(not ways.ahead.get(end) for end in ends)
        busy = _busy(cells, section.length_m, knows=knows)
        found.append(_turns(section.length_m, busy, open_start=open_start, open_end=open_end))
    return tuple(found)


def _busy(cells: SectionCells, length_m: float, *, knows: bool) -> list[tuple[float, float]]:
    """(start, end) of the stretches that lead through intersections; `knows` if the file tells where these are."""
    stations = cells.stations
    taken = cells.taken | cells.in_junction
    for first, last in _runs(cells.in_junction & ~cells.taken):
        if stations[last] - stations[first] > LONGEST_WAY_M:
            taken[first:last] = False
    if not taken.any():
        return []
    if not knows and taken.mean() >= CROSSING_SHARE and length_m <= LONGEST_CROSSING_M:
        return [(0.0, length_m)]
    spans = [
        (max(0.0, float(stations[a]) - MARGIN_M), min(length_m, float(stations[b]) + MARGIN_M)) for a, b in _runs(taken)
    ]
    shortest_m = SHORTEST_END_M if knows else SHORTEST_BETWEEN_M
    merged = spans[:1]
    for start_m, end_m in spans[1:]:
        if start_m - merged[-1][1] < shortest_m:
            merged[-1] = merged[-1][0], end_m
        else:
            merged.append((start_m, end_m))
    if merged[0][0] < SHORTEST_END_M:
        merged[0] = 0.0, merged[0][1]
    if length_m - merged[-1][1] < SHORTEST_END_M:
        merged[-1] = merged[-1][0], length_m
    return merged


def _runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """(first, behind the last) of every run of flags that are set."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def _turns(
    length_m: float, busy: Sequence[tuple[float, float]], *, open_start: bool, open_end: bool
) -> tuple[LaneSegment, ...]:
    """Lanes and connectors in turn along a section, from the stretches that lead through intersections."""
    if not busy:
        return (LaneSegment(0.0, length_m, length_m >= SHORTEST_WHOLE_M or open_start or open_end),)
    spans = [[start_m, end_m] for start_m, end_m in busy]
    opened = open_start and spans[0][0] == 0.0, open_end and spans[-1][1] == length_m
    if opened[0]:
        spans[0][0] = STUB_M
    if opened[1]:
        spans[-1][1] = length_m - STUB_M
    if any(opened):  # what is hardly longer than a stub is one, and leads on without a gap
        spans = [span for span in spans if span[1] - span[0] > JOINT_M]
    found: list[LaneSegment] = []
    at_m = 0.0
    for start_m, end_m in spans:
        if start_m > at_m:
            found.append(LaneSegment(at_m, start_m, True))
        found.append(LaneSegment(start_m, end_m, False))
        at_m = end_m
    if at_m < length_m:
        found.append(LaneSegment(at_m, length_m, True))
    return tuple(found)
