"""CrossSections: parallel lanes as cross-sections, so that neighbours share every vertex however they are cut."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.maps.geopackage_writer import GRID_M
from interplan_sumo.world.geometry import Floats, Polyline

SPACING_M = 0.9
"""Cross-sections are at most this far apart: nuPlan's planners take headings from the vertices."""
WELDED_M = 0.6
"""Ends no further apart than this are meant to be one."""
_LEAST_SURFACE = 0.1  # share of length times width below which boundaries have changed sides
_NARROWEST_M = 0.5
_SAME_M = 0.01  # vertices closer than this along a line are one


@dataclass(frozen=True, eq=False)
class CrossSections:
    """A stretch of `n` parallel lanes: the points of their `n + 1` boundaries at K cross-sections."""

    across: Floats
    """(K, n + 1, 2) metres; boundaries from left to right, cross-sections in the direction of travel."""

    @classmethod
    def of(cls, boundaries: Sequence[Floats]) -> CrossSections:
        """The cross-sections between lines of (N, 2) points each, from left to right.

        Lines are matched by their relative arc length, or vertex by vertex
        where that brings them closer; every vertex of each makes a
        cross-section. ValueError for a line without length.
        """
        lines = [Polyline(points) for points in boundaries]
        longest_m = max(line.length_m for line in lines)
        knots = _matched(lines)
        grid = np.linspace(0.0, 1.0, 1 + max(1, int(np.ceil(longest_m / SPACING_M))))
        inner = np.sort(np.concatenate([own[1:-1] for own in knots]))
        inner = inner[(inner * longest_m > _SAME_M) & ((1.0 - inner) * longest_m > _SAME_M)]
        inner = inner[np.diff(inner, prepend=-1.0) * longest_m > _SAME_M]
        # Vertices first: a point of the grid that lies beside one is not needed.
        around = np.concatenate(([-1.0], inner, [2.0]))
        following = around.searchsorted(grid[1:-1])
        nearest = np.minimum(around[following] - grid[1:-1], grid[1:-1] - around[following - 1])
        beside = nearest * longest_m < SPACING_M / 3.0
        shares = np.unique(np.concatenate((grid[:1], inner, grid[1:-1][~beside], grid[-1:])))
        arcs = [np.interp(shares, own, line.arc_m) for own, line in zip(knots, lines, strict=True)]
        segments = np.maximum(1, np.ceil(np.max([np.diff(arc) for arc in arcs], axis=0) / SPACING_M)).astype(np.int64)
        starts = np.repeat(shares[:-1], segments)
        within = np.concatenate([np.arange(count) / count for count in segments])
        shares = np.append(starts + within * np.repeat(np.diff(shares), segments), shares[-1])
        arcs = [np.interp(shares, own, line.arc_m) for own, line in zip(knots, lines, strict=True)]
        return cls(np.stack([line.poses_at(arc)[:, :2] for line, arc in zip(lines, arcs, strict=True)], axis=1))

    @property
    def lanes(self) -> int:
        return self.across.shape[1] - 1

    @cached_property
    def middles(self) -> Floats:
        """(K, n, 2) the middle of each lane."""
        return (self.across[:, :-1] + self.across[:, 1:]) / 2.0

    @property
    def widths_m(self) -> Floats:
        """(K, n) of each lane."""
        return np.hypot(*np.moveaxis(np.diff(self.across, axis=1), -1, 0))

    @cached_property
    def arcs_m(self) -> Floats:
        """(K, n) distance along the middle of each lane."""
        steps = np.hypot(*np.moveaxis(np.diff(self.middles, axis=0), -1, 0))
        return np.concatenate((np.zeros((1, self.lanes)), np.cumsum(steps, axis=0)))

    @cached_property
    def station_m(self) -> Floats:
        """(K,) distance along the cross-sections, the mean of its lanes."""
        return self.arcs_m.mean(axis=1)

    @property
    def length_m(self) -> float:
        return float(self.station_m[-1])

    def cut(self, start_m: float, end_m: float) -> CrossSections:
        """The cross-sections between two stations, `start_m` < `end_m`."""
        at = self.station_m
        inside = self.across[(at > start_m + _SAME_M) & (at < end_m - _SAME_M)]
        return CrossSections(np.concatenate((self._at(start_m)[None], inside, self._at(end_m)[None])))

    def _at(self, station_m: float) -> Floats:
        """(n + 1, 2) the cross-section at a station."""
        row = int(np.clip(np.searchsorted(self.station_m, station_m) - 1, 0, len(self.across) - 2))
        first, last = self.station_m[row : row + 2].tolist()
        share = min(1.0, max(0.0, (station_m - first) / (last - first))) if last > first else 0.0
        return (1.0 - share) * self.across[row] + share * self.across[row + 1]

    def joined(self, other: CrossSections) -> CrossSections:
        """These cross-sections followed by others of as many lanes; where they nearly meet they are welded half-way.

        Ends further apart than `WELDED_M` are joined by a straight segment.
        """
        gap_m = float(np.hypot(*(other.across[0] - self.across[-1]).T).max())
        if gap_m > WELDED_M:
            return CrossSections(np.concatenate((self.across, other.across)))
        before = self.across[:-1][self.station_m[:-1] < max(self.length_m - gap_m, _SAME_M)]
        after = other.across[1:][other.station_m[1:] > min(gap_m, other.length_m - _SAME_M)]
        seam = (self.across[-1:] + other.across[:1]) / 2.0
        return CrossSections(np.concatenate((before, seam, after)))

    def lane(self, index: int) -> CrossSections:
        """One lane of it."""
        return CrossSections(self.across[:, index : index + 2])

    def moved(self, start: Floats, end: Floats) -> CrossSections:
        """The cross-sections with its ends moved by two vectors (2,), and what lies between in proportion."""
        share = (self.station_m / max(self.length_m, 1e-9))[:, None, None]
        return CrossSections(self.across + (1.0 - share) * start + share * end)

    def uncrossed(self) -> CrossSections:
        """Those of one lane, at even width around its middle where its boundaries change sides or turn back."""
        (width_m,) = np.median(self.widths_m, axis=0).tolist()
        ring = np.concatenate((self.across[:, 1], self.across[::-1, 0])) - self.across[0, 0]
        x, y = ring.T
        signed_m2 = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2.0
        line = self.centerline()
        along = all(self.boundary(k).runs_with(line) for k in (0, 1) if np.ptp(self.across[:, k], axis=0).any())
        if along and signed_m2 > _LEAST_SURFACE * width_m * self.length_m:
            return self
        heading = line.vertex_heading_rad
        if line.length_m < 2.0 * width_m:  # too short to bend at this width
            heading = np.full_like(heading, np.arctan2(*(line.points[-1] - line.points[0])[::-1]))
        half = max(width_m, _NARROWEST_M) / 2.0 * np.stack((-np.sin(heading), np.cos(heading)), axis=1)
        return CrossSections(np.stack((line.points + half, line.points - half), axis=1))

    # --- one lane as nuPlan wants it ---------------------------------------------------------------

    def centerline(self, index: int = 0) -> Polyline:
        """The middle of a lane with evenly spaced vertices; ValueError if it has no length."""
        line = Polyline(self.middles[:, index])
        count = max(1, int(np.ceil(line.length_m / SPACING_M)))
        return Polyline(line.poses_at(np.linspace(0.0, line.length_m, count + 1))[:, :2])

    def boundary(self, index: int) -> Polyline:
        """A boundary, counted from the left."""
        return Polyline(self.across[:, index])

    def polygon(self, index: int = 0) -> shapely.Polygon:
        """The surface of a lane, valid; where its boundaries cross, the largest part of it."""
        return sound(shapely.Polygon(np.concatenate((self.across[:, index], self.across[::-1, index + 1]))))

    def outline(self) -> shapely.Polygon:
        """The surface of all lanes together."""
        return sound(shapely.Polygon(np.concatenate((self.across[:, 0], self.across[::-1, -1]))))


def _matched(lines: Sequence[Polyline]) -> list[Floats]:
    """(N,) per line: at which share of the way across from all lines its vertices lie."""
    own = [line.arc_m / line.length_m for line in lines]
    if len({len(line.points) for line in lines}) > 1:
        return own
    common = np.mean(own, axis=0)
    by_share = np.stack([line.poses_at(common * line.length_m)[:, :2] for line in lines])
    by_vertex = np.stack([line.points for line in lines])

    def apart_m(points: Floats) -> float:
        return float(np.hypot(*np.moveaxis(np.diff(points, axis=0), -1, 0)).sum())

    return [common] * len(lines) if apart_m(by_vertex) <= apart_m(by_share) else own


def bridge(before: CrossSections, after: CrossSections) -> CrossSections:
    """Those of one lane from the end of one to the start of another, on a curve that leaves and arrives straight."""
    start, end = before.middles[-1, 0], after.middles[0, 0]
    reach_m = float(np.hypot(*(end - start)))
    leave, arrive = _direction(before, -1) * reach_m, _direction(after, 0) * reach_m
    share = np.linspace(0.0, 1.0, 2 + int(np.ceil(reach_m / SPACING_M)))[:, None]
    middle = (
        (2 * share**3 - 3 * share**2 + 1) * start
        + (share**3 - 2 * share**2 + share) * leave
        + (3 * share**2 - 2 * share**3) * end
        + (share**3 - share**2) * arrive
    )
    ahead = np.gradient(middle, axis=0)
    normal = np.stack((-ahead[:, 1], ahead[:, 0]), axis=1) / np.hypot(*ahead.T)[:, None]
    half = [float(np.hypot(*(r.across[k, 0] - r.across[k, 1]))) / 2.0 for r, k in ((before, -1), (after, 0))]
    width = (1.0 - share) * half[0] + share * half[1]
    return CrossSections(np.stack((middle + width * normal, middle - width * normal), axis=1))


def _direction(cross_sections: CrossSections, at: int) -> Floats:
    """(2,) unit vector of travel at the first (0) or last (-1) cross-section of a single lane."""
    line = cross_sections.centerline()
    heading = line.segment_heading_rad[at]
    return np.array([np.cos(heading), np.sin(heading)])


def sound(polygon: shapely.Polygon) -> shapely.Polygon:
    """The polygon on the grid of map files, or the largest part of it where it has flaws; empty if nothing is left."""
    whole = polygon if polygon.is_valid else largest(shapely.make_valid(polygon))
    return largest(shapely.set_precision(whole, GRID_M))


def largest(shape: shapely.Geometry) -> shapely.Polygon:
    """The largest polygon of a geometry; an empty one if it has none."""
    return max(polygons_in(shape), key=shapely.area, default=shapely.Polygon())


def polygons_in(shape: shapely.Geometry) -> list[shapely.Polygon]:
    """The polygons that a geometry consists of; its lines and points are left out."""
    parts = shapely.get_parts(shapely.get_parts(shape))  # a collection may hold multi-polygons
    return [part for part in parts.tolist() if isinstance(part, shapely.Polygon) and not part.is_empty]


def cells(cross_sections: CrossSections, length_m: float) -> tuple[NDArray[np.object_], Floats]:
    """Cross-sections cut crosswise into cells of about `length_m`.

    Returns (C, n) polygons, one per cell and lane, and the (C + 1,) stations of the cuts.
    """
    count = max(1, round(cross_sections.length_m / length_m))
    stations = np.linspace(0.0, cross_sections.length_m, count + 1)
    at = np.array([np.interp(stations, cross_sections.station_m, column) for column in _columns(cross_sections)])
    points = at.reshape(cross_sections.lanes + 1, 2, count + 1).transpose(2, 0, 1)
    quads = np.stack((points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]), axis=2)
    return np.asarray(shapely.polygons(quads)), stations


def _columns(cross_sections: CrossSections) -> Floats:
    """((n + 1) * 2, K) every coordinate along the cross-sections."""
    return cross_sections.across.reshape(len(cross_sections.across), -1).T
