"""Plane geometry that every layer shares: angles, polylines and oriented boxes.

Map frame: metres, float64, x east and y north. Headings are radians,
counter-clockwise from +x. "Left" is always geometrically left of the heading.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import copysign, cos, hypot, sin
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


_SHARES = np.linspace(0.0, 1.0, 9)
_FEW = 50_000
"""Pairs of vertices of which the nearest are found faster by trying all than by a tree."""


def frozen(values: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    """`values` as a C-contiguous, read-only array; a copy only where needed."""
    array = np.ascontiguousarray(values, dtype=dtype)
    if array.flags.writeable:
        if array is values or array.base is not None:
            array = array.copy()
        array.setflags(write=False)
    return array


def wrap_angle(angle_rad: Any) -> Any:
    """The same angle(s) in [-pi, pi)."""
    return (angle_rad + np.pi) % (2.0 * np.pi) - np.pi


@dataclass(frozen=True, slots=True)
class Pose:
    """A position and heading in the map frame."""

    x_m: float
    y_m: float
    heading_rad: float


@dataclass(frozen=True, eq=False)
class Polyline:
    """A directed polyline with at least two distinct points, measured by arc length.

    Projections beyond an end stop at that end, as in nuPlan and shapely.
    """

    points: Floats
    """(N, 2) vertices in metres; consecutive duplicates are dropped on construction."""
    arc_m: Floats = field(init=False)
    """(N,) arc length of each vertex, starting at 0."""

    def __post_init__(self) -> None:
        points = np.asarray(self.points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2:
            raise ValueError(f"Polyline.points has shape {points.shape}, expected (N, 2)")
        if not np.isfinite(points).all():
            raise ValueError("Polyline.points holds a number that is not finite")
        steps = np.hypot(*np.diff(points, axis=0).T)
        points = points[np.concatenate(([True], steps > 1e-9))]
        if len(points) < 2:
            raise ValueError("a Polyline needs two distinct points")
        steps = np.hypot(*np.diff(points, axis=0).T)
        object.__setattr__(self, "points", frozen(points))
        object.__setattr__(self, "arc_m", frozen(np.concatenate(([0.0], np.cumsum(steps)))))

    @property
    def length_m(self) -> float:
        """From the first point to the last, along the line."""
        return float(self.arc_m[-1])

    @cached_property
    def linestring(self) -> shapely.LineString:
        """The same line as a shapely geometry."""
        return shapely.LineString(self.points)

    @cached_property
    def segment_heading_rad(self) -> Floats:
        """(N-1,) heading of each segment."""
        delta = np.diff(self.points, axis=0)
        return frozen(np.arctan2(delta[:, 1], delta[:, 0]))

    @property
    def turned_rad(self) -> float:
        """Heading of the last segment relative to the first, counter-clockwise, at most half a turn."""
        return float(wrap_angle(self.segment_heading_rad[-1] - self.segment_heading_rad[0]))

    @cached_property
    def vertex_heading_rad(self) -> Floats:
        """(N,) unwrapped heading at each vertex: that of the segment ahead, the last one repeated (nuPlan's rule)."""
        headings = np.append(self.segment_heading_rad, self.segment_heading_rad[-1])
        return frozen(np.unwrap(headings))

    @cached_property
    def _segments(self) -> tuple[Floats, Floats, Floats]:
        """(N-1, 2) starts, (N-1, 2) unit directions and (N-1,) lengths of the segments."""
        lengths = self.arc_m[1:] - self.arc_m[:-1]
        return self.points[:-1], (self.points[1:] - self.points[:-1]) / lengths[:, None], lengths

    def project(self, xy: ArrayLike, between_m: tuple[float, float] | None = None) -> tuple[Floats, Floats]:
        """Arc length (K,) and signed lateral offset (K,), left positive, of the nearest point for each of (K, 2).

        `between_m` looks only at the segments that reach into this stretch.
        """
        at = np.atleast_2d(np.asarray(xy, dtype=np.float64))
        start, unit, lengths = self._segments
        arc_m = self.arc_m
        if between_m is not None:
            rows = self._rows(*between_m)
            start, unit, lengths, arc_m = start[rows], unit[rows], lengths[rows], arc_m[rows.start :]
        rel_x = at[:, None, 0] - start[None, :, 0]
        rel_y = at[:, None, 1] - start[None, :, 1]
        along = np.clip(rel_x * unit[:, 0] + rel_y * unit[:, 1], 0.0, lengths)
        off_x = rel_x - along * unit[:, 0]
        off_y = rel_y - along * unit[:, 1]
        distance2 = off_x * off_x + off_y * off_y
        nearest = np.argmin(distance2, axis=1)
        rows = np.arange(len(at))
        side = unit[nearest, 0] * off_y[rows, nearest] - unit[nearest, 1] * off_x[rows, nearest]
        lateral = np.copysign(np.sqrt(distance2[rows, nearest]), side)
        return arc_m[nearest] + along[rows, nearest], lateral

    def _rows(self, start_m: float, end_m: float) -> slice:
        """The segments that reach into a stretch; at least one."""
        last = len(self.points) - 2
        first = min(max(int(self.arc_m.searchsorted(start_m, side="right")) - 1, 0), last)
        return slice(first, min(max(int(self.arc_m.searchsorted(end_m)) - 1, first), last) + 1)

    def project_point(
        self, x_m: float, y_m: float, between_m: tuple[float, float] | None = None
    ) -> tuple[float, float]:
        """`project` for one point."""
        start, unit, lengths = self._segments
        arc_m = self.arc_m
        if between_m is not None:
            rows = self._rows(*between_m)
            start, unit, lengths, arc_m = start[rows], unit[rows], lengths[rows], arc_m[rows.start :]
        rel_x, rel_y = x_m - start[:, 0], y_m - start[:, 1]
        along = np.minimum(np.maximum(rel_x * unit[:, 0] + rel_y * unit[:, 1], 0.0), lengths)
        off_x, off_y = rel_x - along * unit[:, 0], rel_y - along * unit[:, 1]
        i = int((off_x * off_x + off_y * off_y).argmin())
        x, y = float(off_x[i]), float(off_y[i])
        return float(arc_m[i] + along[i]), copysign(hypot(x, y), unit[i, 0] * y - unit[i, 1] * x)

    def poses_at(self, arc_m: ArrayLike) -> Floats:
        """(K, 3) x, y and heading at arc lengths (K,), which are clamped to the line.

        Headings are interpolated between vertices and not wrapped.
        """
        at = np.clip(np.atleast_1d(np.asarray(arc_m, dtype=np.float64)), 0.0, self.length_m)
        return np.stack(
            (
                np.interp(at, self.arc_m, self.points[:, 0]),
                np.interp(at, self.arc_m, self.points[:, 1]),
                np.interp(at, self.arc_m, self.vertex_heading_rad),
            ),
            axis=1,
        )

    def pose_at(self, arc_m: float, left_m: float = 0.0) -> Pose:
        """The pose at one arc length, moved `left_m` to the left of the line."""
        at = min(max(arc_m, 0.0), self.length_m)
        i = min(max(int(self.arc_m.searchsorted(at, side="right")) - 1, 0), len(self.points) - 2)
        first, last = float(self.arc_m[i]), float(self.arc_m[i + 1])
        share = (at - first) / (last - first)
        (x, y), (next_x, next_y) = self.points[i].tolist(), self.points[i + 1].tolist()
        here, there = self.vertex_heading_rad[i : i + 2].tolist()
        heading = here + share * (there - here)
        return Pose(
            x + share * (next_x - x) - left_m * sin(heading),
            y + share * (next_y - y) + left_m * cos(heading),
            float(wrap_angle(heading)),
        )

    def between(self, start_m: float, end_m: float) -> Polyline:
        """The piece between two arc lengths, `start_m` < `end_m`, clamped to the line."""
        start_m, end_m = max(0.0, start_m), min(self.length_m, end_m)
        if end_m - start_m <= 1e-9:
            raise ValueError(f"empty piece of a polyline: {start_m} to {end_m} m")
        inside = (self.arc_m > start_m + 1e-9) & (self.arc_m < end_m - 1e-9)
        ends = self.poses_at((start_m, end_m))[:, :2]
        return Polyline(np.concatenate((ends[:1], self.points[inside], ends[1:])))

    def runs_with(self, other: Polyline) -> bool:
        """Whether two lines beside one another run the same way, rings and U-turns included.

        Compares the ends of the lines; of one that turns back on itself, all of
        it: True unless it clearly runs the other way.
        """
        turns_back = np.hypot(*(other.points[-1] - other.points[0])) < 0.5 * other.length_m
        shares = _SHARES if turns_back else _SHARES[[0, -1]]
        here = self.poses_at(shares * self.length_m)[:, :2]
        there = other.poses_at(shares * other.length_m)[:, :2]
        same, turned = np.hypot(*(here - there).T).sum(), np.hypot(*(here - there[::-1]).T).sum()
        return bool(same <= (2.0 if turns_back else 1.0) * turned)

    def joined(self, other: Polyline) -> Polyline:
        """This line followed by another one."""
        return Polyline(np.concatenate((self.points, other.points)))

    def resampled(self, spacing_m: float) -> Polyline:
        """The same line with vertices at most `spacing_m` apart; every old vertex is kept."""
        lengths = np.diff(self.arc_m)
        pieces = np.maximum(1, np.ceil(lengths / spacing_m - 1e-9)).astype(np.int64)
        within = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        arc = within * np.repeat(lengths / pieces, pieces) + np.repeat(self.arc_m[:-1], pieces)
        arc = np.append(arc, self.arc_m[-1])
        return Polyline(self.poses_at(arc)[:, :2])


def hausdorff_m(one: Floats, other: Floats, pieces: int = 1) -> float:
    """Hausdorff distance of two lines of (N, 2) points, taken where their segments are cut into `pieces`."""
    if len(one) * len(other) * pieces < _FEW:
        lines = shapely.LineString(one), shapely.LineString(other)
        return shapely.hausdorff_distance(*lines, densify=1.0 / pieces)
    return max(_farthest_m(one, other, pieces), _farthest_m(other, one, pieces))


def _farthest_m(points: Floats, line: Floats, pieces: int) -> float:
    """How far from a line the points get; not by shapely, whose time goes with the product of their numbers."""
    steps = np.diff(points, axis=0)[:, None] * (np.arange(pieces) / pieces)[:, None]
    at = np.concatenate(((points[:-1, None] + steps).reshape(-1, 2), points[-1:]))
    tree = shapely.STRtree(np.asarray(shapely.linestrings(np.stack((line[:-1], line[1:]), axis=1))))
    _, off_m = tree.query_nearest(shapely.points(at), all_matches=False, return_distance=True)
    return float(off_m.max())


FRONTWARD, LEFTWARD = np.array((1.0, -1.0, -1.0, 1.0)), np.array((1.0, 1.0, -1.0, -1.0))
"""Of the corners of a box: front left, rear left, rear right, front right."""


def box_corners(
    x_m: ArrayLike, y_m: ArrayLike, heading_rad: ArrayLike, length_m: ArrayLike, width_m: ArrayLike
) -> Floats:
    """(N, 4, 2) corners of oriented boxes given by their centres.

    Order: front left, rear left, rear right, front right (nuPlan's order).
    """
    x, y, heading, length, width = (
        np.atleast_1d(np.asarray(v, dtype=np.float64))[:, None] for v in (x_m, y_m, heading_rad, length_m, width_m)
    )
    cos, sin = np.cos(heading), np.sin(heading)
    corners = np.empty((np.broadcast(x, y, heading, length, width).size, 4, 2))
    corners[..., 0] = x + FRONTWARD * (cos * length / 2) + LEFTWARD * (-sin * width / 2)
    corners[..., 1] = y + FRONTWARD * (sin * length / 2) + LEFTWARD * (cos * width / 2)
    return corners


def box_polygons(
    x_m: ArrayLike, y_m: ArrayLike, heading_rad: ArrayLike, length_m: ArrayLike, width_m: ArrayLike
) -> NDArray[Any]:
    """(N,) shapely polygons of oriented boxes given by their centres."""
    return np.asarray(shapely.polygons(box_corners(x_m, y_m, heading_rad, length_m, width_m)))


def penetration_m(corners_a: Floats, corners_b: Floats) -> Floats:
    """(N,) depth by which pairs of boxes (N, 4, 2) overlap; negative where a gap separates them.

    The smallest overlap over the four separating axes of two rectangles. A
    positive value is how far one box must move to come free; a negative value
    is a lower bound of the gap.
    """
    depth = np.full(len(corners_a), np.inf)
    for corners in (corners_a, corners_b):
        for edge in (corners[:, 0] - corners[:, 1], corners[:, 0] - corners[:, 3]):
            axis = edge / np.hypot(edge[:, 0], edge[:, 1])[:, None]
            a = corners_a[..., 0] * axis[:, None, 0] + corners_a[..., 1] * axis[:, None, 1]
            b = corners_b[..., 0] * axis[:, None, 0] + corners_b[..., 1] * axis[:, None, 1]
            depth = np.minimum(depth, np.minimum(a.max(axis=1) - b.min(axis=1), b.max(axis=1) - a.min(axis=1)))
    return depth
