"""Lanes of OpenDRIVE roads as lines: every side of a road cut where its lanes change, and its edges sampled."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from interplan_sumo.maps.importers.lines import SHORTEST_M, length_m
from interplan_sumo.maps.importers.opendrive.curves import PiecewiseCubic
from interplan_sumo.maps.importers.opendrive.elements import UnusableRoadError, XodrLane, XodrRoad, XodrSection
from interplan_sumo.maps.importers.opendrive.lane_types import reason_of
from interplan_sumo.maps.importers.opendrive.loops import without_loops
from interplan_sumo.world.geometry import Floats

CHORD_M = 0.01
"""No edge of a lane lies further than this from the line that is drawn for it."""
NARROWEST_M = 1.8
"""Where a lane that opens or ends is narrower, no car uses it; netconvert's bound, too."""
_LONGEST_STEP_M, _SHORTEST_STEP_M = 20.0, 0.02
_MOST_POINTS = 20_000
_THIRDS = (1.0 / 3.0, 2.0 / 3.0)
_SAFE = 0.8
"""Two points of an arc see eight ninths of how far its chord is off."""
_CUT_M = 1.0
"""A cut so near to an end of a section is none."""
_WIDTH_STEP_M = 1.0
_PIVOT_SHARE = 0.05
"""How far, of its width, the edge about which a lane turns is moved into it."""


@dataclass(eq=False, slots=True)
class DrawnStretch:
    """A lane between two stations, sampled; its lines run along the reference line."""

    id: str
    road: XodrRoad
    lane: XodrLane
    start_m: float
    end_m: float
    inner: Floats
    """(N, 2) the edge nearer to the reference line."""
    middle: Floats
    """(M, 2)"""
    outer: Floats
    """(K, 2)"""
    width_m: Floats
    """(L,) at its stations."""
    reason: str | None
    """Why cars do not use it; None if they do."""
    limit_mps: float | None

    @property
    def length_m(self) -> float:
        return self.end_m - self.start_m

    @property
    def left(self) -> bool:
        """Whether it lies to the left of the reference line."""
        return self.lane.id > 0

    @property
    def along(self) -> bool:
        """Whether its own traffic runs along the reference line."""
        return (self.left == self.road.left_hand) != (self.lane.direction == "reversed")

    def middle_at(self, *, at_end: bool) -> Floats:
        """(2,) the middle at one of its ends."""
        return self.middle[-1 if at_end else 0]


@dataclass(frozen=True, slots=True, eq=False)
class SideStretch:
    """One side of a road between two stations, lanes by their ids."""

    section: int
    start_m: float
    end_m: float
    lanes: dict[int, DrawnStretch]


def side_stretches(road: XodrRoad, cuts_m: Iterable[float], *, left: bool) -> list[SideStretch]:
    """One side of a road from its start to its end, cut at its sections, where limits and access change, where a lane
    becomes wide enough for cars, and at `cuts_m`.

    UnusableRoadError if it cannot be drawn.
    """
    sections = [s for s in road.sections if not (s.right_only if left else s.left_only)]
    if not sections:
        return []
    stops = [*(section.start_m for section in sections[1:]), road.length_m]
    found: list[SideStretch] = []
    for section, stop_m in zip(sections, stops, strict=True):
        if stop_m <= section.start_m:
            continue
        lanes = section.side(left=left)
        inside = [*cuts_m, *_changes(road, section, lanes, stop_m)]
        at = [section.start_m, *_cuts(inside, section.start_m, stop_m), stop_m]
        for piece, (start_m, end_m) in enumerate(pairwise(at)):
            drawn = _drawn(road, section, lanes, (start_m, end_m), piece) if lanes else {}
            found.append(SideStretch(section.number, start_m, end_m, drawn))
    return found


def _cuts(inside_m: Iterable[float], start_m: float, end_m: float) -> Iterator[float]:
    at = start_m
    for cut_m in sorted(inside_m):
        if cut_m - at > _CUT_M and end_m - cut_m > _CUT_M:
            yield cut_m
            at = cut_m


def _changes(road: XodrRoad, section: XodrSection, lanes: Sequence[XodrLane], end_m: float) -> Iterator[float]:
    """Stations at which the limit, the access or the use of a lane for cars changes."""
    yield from (station_m for station_m, _ in road.limits)
    for lane in lanes:
        yield from (section.start_m + offset_m for offset_m, _ in lane.limits)
        yield from (section.start_m + rule.offset_m for rule in lane.access)
        if reason_of(lane, 0.0) is None:
            yield from _wide_from(road, section, lanes, lane, end_m)


def _wide_from(
    road: XodrRoad, section: XodrSection, lanes: Sequence[XodrLane], lane: XodrLane, end_m: float
) -> Iterator[float]:
    """Stations at which a lane becomes wide enough for cars, or ceases to be."""
    count = 2 + int((end_m - section.start_m) / _WIDTH_STEP_M)
    at = np.linspace(section.start_m, end_m, count)
    edges = _edges(road, section, lanes, at)
    k = lanes.index(lane)
    spare = np.abs(edges[k + 1] - edges[k]) - NARROWEST_M
    for i in np.flatnonzero((spare[:-1] < 0.0) != (spare[1:] < 0.0)).tolist():
        share = spare[i] / (spare[i] - spare[i + 1])
        yield float(at[i] + share * (at[i + 1] - at[i]))


def _edges(road: XodrRoad, section: XodrSection, lanes: Sequence[XodrLane], station_m: Floats) -> Floats:
    """(n + 1, N) how far to the left of the reference line the edges of the lanes of one side lie, from the middle."""
    sign = 1.0 if lanes[0].id > 0 else -1.0
    at = np.zeros_like(station_m) if road.offset is None else road.offset.at(station_m, ending=True)
    found = [at]
    for lane in lanes:
        if lane.width is not None:
            at = at + sign * np.maximum(lane.width.at(station_m - section.start_m, ending=True), 0.0)
        elif lane.border is not None:
            outer = lane.border.at(station_m - section.start_m, ending=True)
            outer = -outer if _is_unsigned(road, section, lane.border, sign) else outer
            at = np.maximum(at, outer) if sign > 0.0 else np.minimum(at, outer)
        found.append(at)
    return np.stack(found)


def _is_unsigned(road: XodrRoad, section: XodrSection, border: PiecewiseCubic, sign: float) -> bool:
    """Whether a border was written without its sign: as it is, it lies on the other side of the middle."""
    at = np.concatenate((border.starts_m, border.starts_m + _WIDTH_STEP_M))
    middle = np.zeros_like(at) if road.offset is None else road.offset.at(at + section.start_m, ending=True)
    return bool((sign * (border.at(at, ending=True) - middle)).mean() < -CHORD_M)


def _drawn(
    road: XodrRoad, section: XodrSection, lanes: Sequence[XodrLane], between_m: tuple[float, float], piece: int
) -> dict[int, DrawnStretch]:
    station_m = _stations(road, section, lanes, between_m)
    edges = _lines(road, section, lanes, station_m)
    away_m = [np.abs(edge).max() for edge in _edges(road, section, lanes, station_m)]
    drawn = [without_loops(edge, far_m) for edge, far_m in zip(edges, away_m, strict=True)]
    middle_m = (between_m[0] + between_m[1]) / 2.0
    name = f":{piece + 1}" if piece else ""
    return {
        lane.id: DrawnStretch(
            id=f"{road.id}/{section.number}/{lane.id}{name}",
            road=road,
            lane=lane,
            start_m=between_m[0],
            end_m=between_m[1],
            inner=_opened(drawn[k], edges[k], edges[k + 1]),
            middle=without_loops((edges[k] + edges[k + 1]) / 2.0, away_m[k + 1]),
            outer=_opened(drawn[k + 1], edges[k + 1], edges[k]),
            width_m=np.hypot(*(edges[k + 1] - edges[k]).T),
            reason=reason_of(lane, middle_m - section.start_m),
            limit_mps=_limit(road, lane, middle_m, middle_m - section.start_m),
        )
        for k, lane in enumerate(lanes)
    }


def _opened(line: Floats, edge: Floats, other: Floats) -> Floats:
    """The edge of a lane as it is drawn; one that is a point is moved a little towards the other edge.

    It is a point where a lane turns about its own edge, as at corners whose
    radius is the lane's width.
    """
    return edge + _PIVOT_SHARE * (other - edge) if length_m(line) < SHORTEST_M <= length_m(other) else line


def _limit(road: XodrRoad, lane: XodrLane, station_m: float, offset_m: float) -> float | None:
    """The limit of a lane: its own, where it has one, else the road's."""
    for records, at in ((lane.limits, offset_m), (road.limits, station_m)):
        held = [limit for start_m, limit in records if start_m <= at]
        if held:
            return held[-1]
    return None


def _lines(road: XodrRoad, section: XodrSection, lanes: Sequence[XodrLane], station_m: Floats) -> list[Floats]:
    """(N, 2) each: the edges of the lanes, from the middle outwards."""
    points, heading = road.reference.at(station_m, ending=True)
    normal = np.stack((-np.sin(heading), np.cos(heading)), axis=1)
    lines = [points + left_m[:, None] * normal for left_m in _edges(road, section, lanes, station_m)]
    if not all(np.isfinite(line).all() for line in lines):
        raise UnusableRoadError("its coordinates are no numbers")
    return lines


def _stations(
    road: XodrRoad, section: XodrSection, lanes: Sequence[XodrLane], between_m: tuple[float, float]
) -> Floats:
    """(N,) stations between which straight lines follow every edge within CHORD_M."""
    start_m, end_m = between_m
    knots = [road.reference.starts_m]
    knots += [] if road.offset is None else [road.offset.starts_m]
    knots += [p.starts_m + section.start_m for lane in lanes for p in (lane.width, lane.border) if p is not None]
    coarse = np.linspace(start_m, end_m, 1 + max(1, int(np.ceil((end_m - start_m) / _LONGEST_STEP_M))))
    inner = np.concatenate(knots)
    inner = inner[(inner > start_m + _SHORTEST_STEP_M) & (inner < end_m - _SHORTEST_STEP_M)]
    inner = np.unique(np.concatenate((inner, coarse)))
    at = inner[np.append(np.diff(inner) > _SHORTEST_STEP_M, True)]
    at[0] = start_m
    open_ = np.ones(len(at) - 1, dtype=np.bool_)
    while open_.any():
        if len(at) > _MOST_POINTS:
            raise UnusableRoadError(f"it needs more than {_MOST_POINTS} points: it bends too tightly to be a road")
        first, last = at[:-1][open_], at[1:][open_]
        wide = _off_m(road, section, lanes, first, last) > _SAFE * CHORD_M
        wide &= last - first > 2.0 * _SHORTEST_STEP_M
        added = (first + last)[wide] / 2.0
        fresh = np.insert(at, np.flatnonzero(open_)[wide] + 1, added)
        place = np.searchsorted(fresh, added)
        open_ = np.zeros(len(fresh) - 1, dtype=np.bool_)
        open_[place - 1], open_[place] = True, True
        at = fresh
    return at


def _off_m(road: XodrRoad, section: XodrSection, lanes: Sequence[XodrLane], first: Floats, last: Floats) -> Floats:
    """(N,) how far the edges of the lanes lie from their chords, at most, as seen at a third and two thirds."""
    probes = [first, *(first + share * (last - first) for share in _THIRDS), last]
    flat = np.stack(probes, axis=1).ravel()
    found = np.zeros(len(first))
    for line in _lines(road, section, lanes, flat):
        start, *between, end = np.moveaxis(line.reshape(-1, len(probes), 2), 1, 0)
        chord = end - start
        length = np.maximum(np.hypot(*chord.T), 1e-9)
        for point in between:
            away = point - start
            off = np.abs(chord[:, 0] * away[:, 1] - chord[:, 1] * away[:, 0]) / length
            found = np.maximum(found, np.where(length > 1e-6, off, np.hypot(*away.T)))
    return found
