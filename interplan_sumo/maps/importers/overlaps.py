"""Overlaps: where lanes of a file are in each other's way, and where both directions merely share a narrow street."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.maps.importers.cross_sections import cells
from interplan_sumo.maps.importers.sections import LaneSection
from interplan_sumo.world.geometry import Floats, Ints, wrap_angle

OVERLAP_SHARE = 0.25
"""Lanes that share more than this of their width are in each other's way; less is a matter of drawing."""
CLEAR_M = 2.0
"""Cars on centre lines so far apart pass each other: streets of a file that knows its intersections are lanes from
there on, however wide they are drawn."""
CELL_M = 1.0
OPPOSED_RAD = np.radians(155.0)
"""Directions that differ by more are opposed: two ways that cross or turn into each other differ by less."""
SHORTEST_SHARED_M = 10.0
"""Opposed lanes on the same ground are one narrow street from this length on, or if it is all of a lane."""
_LEAST_M2 = 0.05

LaneEnd = tuple[int, int]
"""Section and lane in it."""


@dataclass(frozen=True, eq=False)
class SectionCells:
    """What happens in the cells of a section, about a metre long each."""

    stations: Floats
    """(C + 1,) where they begin, and the end of the last."""
    in_junction: NDArray[np.bool_]
    """(C,) the file calls this an intersection."""
    taken: NDArray[np.bool_]
    """(C,) a lane is in the way of another one that is neither its neighbour nor linked to it."""


@dataclass(frozen=True, eq=False)
class _Cells:
    """All cells of a map, one row per cell and lane, section by section."""

    shapes: NDArray[np.object_]
    middles: NDArray[np.object_]
    heading_rad: Floats
    section: Ints
    lane: Ints
    row: Ints
    """Which cell of its section."""
    in_junction: NDArray[np.bool_]

    @property
    def lane_keys(self) -> Ints:
        """A number for each lane of each section."""
        return self.section * (int(self.lane.max(initial=0)) + 1) + self.lane


def section_cells(
    sections: Sequence[LaneSection], in_junction: Sequence[Sequence[bool]], linked: frozenset[tuple[LaneEnd, LaneEnd]]
) -> tuple[SectionCells, ...]:
    """The cells of each section; `in_junction` tells it for every row of lanes, `linked` who follows whom.

    Lanes are in each other's way where they share a quarter of their width. In a file that names its
    intersections they are so outside of these only where two cars could not
    pass, and an intersection takes nothing from a street beside it. Opposed
    lanes on the same ground are a narrow street, and stay.
    """
    cut = [cells(section.cross_sections, CELL_M) for section in sections]
    inside = [
        _in_junction(section, flags, stations)
        for section, flags, (_, stations) in zip(sections, in_junction, cut, strict=True)
    ]
    every = _every(sections, [shapes for shapes, _ in cut], [stations for _, stations in cut], inside)
    one, other = _meeting(every, linked)
    opposed = _opposed(every, one, other)
    knows = any(flags.any() for flags in inside)
    apart = ~opposed
    if knows:
        apart &= ~_siblings(every, one, other, linked)
    taken = _crowded(every, one[apart], other[apart], apart=knows)
    facing = _crowded(every, one[opposed], other[opposed], apart=False)
    found: list[SectionCells] = []
    begin = 0
    for s, (shapes, stations) in enumerate(cut):
        own = slice(begin, begin + shapes.size)
        begin = own.stop
        mine = taken[own].reshape(shapes.shape)
        face = facing[own].reshape(shapes.shape)
        brief = np.stack([_brief(face[:, i], stations) for i in range(shapes.shape[1])], axis=1)
        found.append(SectionCells(stations, inside[s], np.asarray((mine | brief).any(axis=1))))
    return tuple(found)


def _in_junction(section: LaneSection, flags: Sequence[bool], stations: Floats) -> NDArray[np.bool_]:
    middle = (stations[:-1] + stations[1:]) / 2.0
    row = np.clip(np.searchsorted(section.seams_m, middle) - 1, 0, len(section.rows) - 1)
    return np.asarray(flags, dtype=np.bool_)[row]


def _every(
    sections: Sequence[LaneSection],
    cut: Sequence[NDArray[np.object_]],
    stations: Sequence[Floats],
    inside: Sequence[NDArray[np.bool_]],
) -> _Cells:
    shapes = np.concatenate([p.ravel() for p in cut])
    bad = ~shapely.is_valid(shapes)
    shapes[bad] = shapely.convex_hull(shapes[bad])
    ends: list[Floats] = []
    for section, at in zip(sections, stations, strict=True):
        own = section.cross_sections
        columns = own.middles.reshape(len(own.middles), -1).T
        points = np.array([np.interp(at, own.station_m, column) for column in columns])
        points = points.reshape(own.lanes, 2, -1).transpose(2, 0, 1)  # stations, lanes, x and y
        ends.append(np.stack((points[:-1], points[1:]), axis=2).reshape(-1, 2, 2))
    both = np.concatenate(ends)
    along = both[:, 1] - both[:, 0]
    return _Cells(
        shapes,
        np.asarray(shapely.linestrings(both)),
        np.arctan2(along[:, 1], along[:, 0]),
        np.concatenate([np.full(p.size, s) for s, p in enumerate(cut)]),
        np.concatenate([np.tile(np.arange(p.shape[1]), p.shape[0]) for p in cut]),
        np.concatenate([np.repeat(np.arange(p.shape[0]), p.shape[1]) for p in cut]),
        np.concatenate([np.repeat(flags, p.shape[1]) for flags, p in zip(inside, cut, strict=True)]),
    )


def _meeting(every: _Cells, linked: frozenset[tuple[LaneEnd, LaneEnd]]) -> tuple[Ints, Ints]:
    """Pairs of cells that touch, of different sections, of lanes that do not lead into each other; each both ways."""
    one, other = shapely.STRtree(every.shapes).query(every.shapes, predicate="intersects")
    apart = (every.section[one] != every.section[other]) & (one < other)
    one, other = one[apart], other[apart]
    keys = every.lane_keys
    key_of = {(s, i): k for s, i, k in zip(every.section.tolist(), every.lane.tolist(), keys.tolist(), strict=True)}
    size = int(keys.max(initial=0)) + 1
    joined = [key_of[a] * size + key_of[b] for a, b in linked if a in key_of and b in key_of]
    pair = np.minimum(keys[one], keys[other]) * size + np.maximum(keys[one], keys[other])
    known = np.array([min(k // size, k % size) * size + max(k // size, k % size) for k in joined], dtype=np.int64)
    free = ~np.isin(pair, known)
    one, other = one[free], other[free]
    return np.append(one, other), np.append(other, one)


def _opposed(every: _Cells, one: Ints, other: Ints) -> NDArray[np.bool_]:
    """Which pairs face each other."""
    return np.abs(wrap_angle(every.heading_rad[one] - every.heading_rad[other])) > OPPOSED_RAD


def _siblings(every: _Cells, one: Ints, other: Ints, linked: frozenset[tuple[LaneEnd, LaneEnd]]) -> NDArray[np.bool_]:
    """Which pairs fork from the same lane, or merge into the same one, on a street."""
    keys = every.lane_keys
    key_of = {(s, i): k for s, i, k in zip(every.section.tolist(), every.lane.tolist(), keys.tolist(), strict=True)}
    size = int(keys.max(initial=0)) + 1
    near: dict[tuple[LaneEnd, bool], list[int]] = {}
    for here, there in linked:
        near.setdefault((here, True), []).append(key_of[there])
        near.setdefault((there, False), []).append(key_of[here])
    pairs = np.array(
        sorted({a * size + b for own in near.values() for a in own for b in own if a != b}), dtype=np.int64
    )
    street = ~(every.in_junction[one] | every.in_junction[other])
    return street & np.isin(keys[one] * size + keys[other], pairs)


def _crowded(every: _Cells, one: Ints, other: Ints, *, apart: bool) -> NDArray[np.bool_]:
    """Per cell: whether another lane takes too much of its width, and, with `apart`, comes too close for two cars."""
    found = np.zeros(len(every.shapes), dtype=np.bool_)
    if not len(one):
        return found
    common = shapely.area(shapely.intersection(every.shapes[one], every.shapes[other]))
    # Cells of the other lane lie behind one another, so what they share with this one adds up, lane by lane.
    lanes_of = every.lane_keys[other]
    order = np.lexsort((lanes_of, one))
    one, other, lanes_of, common = one[order], other[order], lanes_of[order], common[order]
    fresh = np.flatnonzero(np.diff(one, prepend=-1).astype(bool) | np.diff(lanes_of, prepend=-1).astype(bool))
    shared = np.add.reduceat(common, fresh)
    rows = one[fresh]
    much = (shared > OVERLAP_SHARE * shapely.area(every.shapes[rows])) & (shared > _LEAST_M2)
    if apart:
        gap_m = np.minimum.reduceat(shapely.distance(every.middles[one], every.middles[other]), fresh)
        much &= every.in_junction[rows] | (gap_m < CLEAR_M)
    found[rows[much]] = True
    return found


def _brief(facing: NDArray[np.bool_], stations: Floats) -> NDArray[np.bool_]:
    """Of the cells that face an oncoming lane those that do so only for a moment, as where two ways turn."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], facing, [False])).astype(np.int8)))
    found = np.zeros_like(facing)
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        whole = first == 0 and last == len(facing)
        if not whole and stations[last] - stations[first] < SHORTEST_SHARED_M:
            found[first:last] = True
    return found
