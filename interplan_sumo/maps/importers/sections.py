"""Sections: lanes side by side, followed along the road for as long as nothing forks, merges or changes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from interplan_sumo.errors import MapError
from interplan_sumo.maps.importers.cross_sections import WELDED_M, CrossSections
from interplan_sumo.maps.importers.source import SourceLane, SourceMap
from interplan_sumo.maps.network_file import WIDEST_M
from interplan_sumo.world.geometry import hausdorff_m

ADJOINING_M = WELDED_M
"""Neighbours whose boundaries are further apart than this at an end are not side by side."""

Row = tuple[str, ...]
"""Ids of lanes side by side, from left to right."""


class SourceStretch(NamedTuple):
    """A stretch of a lane of the file."""

    source_id: str
    from_share: float
    """Of the length of its middle."""
    to_share: float
    length_m: float


@dataclass(frozen=True, eq=False)
class LaneSection:
    """Rows that follow one another, every lane into the one ahead of it."""

    rows: tuple[Row, ...]
    cross_sections: CrossSections
    seams_m: tuple[float, ...]
    """Stations at which the rows begin, and the end of the last."""

    @property
    def lanes(self) -> int:
        return len(self.rows[0])

    @property
    def length_m(self) -> float:
        return self.cross_sections.length_m

    @cached_property
    def columns(self) -> tuple[tuple[str, ...], ...]:
        """The lanes of the file along each lane of the section."""
        return tuple(zip(*self.rows, strict=True))

    def stretches(self, lane: int, start_m: float, end_m: float) -> tuple[SourceStretch, ...]:
        """The lanes of the file that make up one lane between two stations."""
        found: list[SourceStretch] = []
        for row, (begin_m, stop_m) in zip(self.rows, pairwise(self.seams_m), strict=True):
            first, last = max(begin_m, start_m), min(stop_m, end_m)
            if last - first > 1e-6:
                at = np.interp(
                    (begin_m, first, last, stop_m), self.cross_sections.station_m, self.cross_sections.arcs_m[:, lane]
                )
                begin, start, end, stop = at.tolist()
                whole_m = stop - begin
                found.append(SourceStretch(row[lane], (start - begin) / whole_m, (end - begin) / whole_m, end - start))
        return tuple(found)


def sections(source: SourceMap) -> tuple[LaneSection, ...]:
    """All lanes of the map in sections, in the order of the file; MapError names one that is as wide as a field."""
    rows = _rows(source.lanes)
    row_of = {lane: row for row in rows for lane in row}
    ahead = {row: following for row in rows if (following := _continuation(source.lanes, row, row_of)) is not None}
    behind = {following: row for row, following in ahead.items()}
    found: list[LaneSection] = []
    placed: set[Row] = set()
    for row in rows:
        if row in placed:
            continue
        chain = [_first(row, behind)]
        while (following := ahead.get(chain[-1])) is not None and following != chain[0]:
            chain.append(following)
        placed.update(chain)
        found.append(_section(source, chain))
    return tuple(found)


def _first(row: Row, behind: Mapping[Row, Row]) -> Row:
    """The row at which the chain that `row` belongs to begins; `row` itself in a ring."""
    at = row
    while (before := behind.get(at)) is not None:
        if before == row:
            return row
        at = before
    return at


def _rows(lanes: Mapping[str, SourceLane]) -> tuple[Row, ...]:
    right: dict[str, str] = {}
    taken: set[str] = set()
    for lane in lanes.values():
        for one, other in ((lane.id, lane.right_neighbour), (lane.left_neighbour, lane.id)):
            if one is None or other is None or one == other or one not in lanes or other not in lanes:
                continue
            if one not in right and other not in taken and _adjoin(lanes[one], lanes[other]):
                right[one] = other
                taken.add(other)
    rows: list[Row] = []
    placed: set[str] = set()
    for lane in (*(id_ for id_ in lanes if id_ not in taken), *lanes):
        row: list[str] = []
        at: str | None = lane
        while at is not None and at not in placed:
            row.append(at)
            placed.add(at)
            at = right.get(at)
        if row:
            rows.append(tuple(row))
    return tuple(rows)


def _adjoin(left: SourceLane, right: SourceLane) -> bool:
    """Whether two lanes share their boundary from end to end."""
    if any(float(np.hypot(*(left.right[k] - right.left[k]))) > ADJOINING_M for k in (0, -1)):
        return False
    return hausdorff_m(left.right, right.left, 10) <= ADJOINING_M


def _continuation(lanes: Mapping[str, SourceLane], row: Row, row_of: Mapping[str, Row]) -> Row | None:
    """The row into which every lane of `row` leads straight on, alone and unchanged."""
    following = row_of.get(next(iter(lanes[row[0]].successors), ""))
    if following is None or following == row or len(following) != len(row):
        return None
    for here, there in zip((lanes[i] for i in row), (lanes[i] for i in following), strict=True):
        if tuple(here.successors) != (there.id,) or tuple(there.predecessors) != (here.id,):
            return None
        if here.lights_at_end or there.lights_at_start or here.sign_at_end is not None:
            return None
        if here.speed_limit_mps != there.speed_limit_mps or here.in_intersection != there.in_intersection:
            return None
        if not _meet(here, there):
            return None
    return following


def _meet(here: SourceLane, there: SourceLane) -> bool:
    """Whether one lane begins where the other ends."""
    ends = ((here.left, there.left), (here.right, there.right))
    return all(float(np.hypot(*(a[-1] - b[0]))) <= ADJOINING_M for a, b in ends)


def _section(source: SourceMap, chain: Iterable[Row]) -> LaneSection:
    lanes = source.lanes
    rows = tuple(chain)
    cross_sections: CrossSections | None = None
    seams_m = [0.0]
    for row in rows:
        segment = CrossSections.of([lanes[row[0]].left, *(lanes[lane].right for lane in row)])
        for lane, width_m in zip(row, np.median(segment.widths_m, axis=0).tolist(), strict=True):
            if width_m >= WIDEST_M:
                raise MapError(f"{source.name}: lane {lane} is {width_m:.0f} m wide; look at its boundaries")
        cross_sections = segment if cross_sections is None else cross_sections.joined(segment)
        seams_m.append(cross_sections.length_m)
    assert cross_sections is not None
    return LaneSection(rows, cross_sections, tuple(seams_m))
