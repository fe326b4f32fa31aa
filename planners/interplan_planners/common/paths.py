"""Paths for the ego along lane centre lines and between them, quick projections on them, and plans on them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import accumulate, pairwise
from math import tan

import numpy as np
from numpy.typing import ArrayLike

from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, Ints, Polyline, Pose, frozen, wrap_angle
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trajectory import Trajectory

_STRIDE = 4
"""Every so manieth vertex of a path is looked at before the segments in between."""
_SPAN = 2 * _STRIDE
"""Segments on either side of the nearest such vertex that are looked at."""


def centerline(roads: Roads, lane_ids: Iterable[str]) -> Polyline:
    """The centre lines of a chain of lanes and connectors as one line; arc length 0 is where the first lane starts."""
    return Polyline(np.concatenate([roads[lane_id].centerline.points for lane_id in lane_ids]))


def shifted(line: Polyline, left_m: float | Floats) -> Polyline:
    """A line parallel to another, `left_m` to its left; an array (N,) shifts vertex by vertex.

    On the inner side of a bend that is narrower than the shift, the vertices
    that would lead backwards are left out.
    """
    before, after = line.points[:-1], line.points[1:]
    unit = (after - before) / np.diff(line.arc_m)[:, None]
    tangent = np.concatenate((unit[:1], unit[:-1] + unit[1:], unit[-1:]))
    tangent /= np.maximum(np.hypot(tangent[:, 0], tangent[:, 1]), 1e-9)[:, None]
    left = np.broadcast_to(np.asarray(left_m, dtype=np.float64), (len(line.points),))
    points = line.points + left[:, None] * np.stack((-tangent[:, 1], tangent[:, 0]), axis=1)
    if not (((points[1:] - points[:-1]) * unit).sum(axis=1) > 0.0).all():
        arc_m, _ = line.project(points)
        highest_m = np.maximum.accumulate(arc_m)
        points = points[np.concatenate(([True], arc_m[1:] > highest_m[:-1]))]
    return Polyline(points)


class DrivingPath:
    """A line with quick projections of many points that lie near it.

    The nearest of every fourth vertex is sought first, then the nearest point
    on the segments around it: equal to `Polyline.project` for points that are
    nearer to the line than the line is to itself.
    """

    def __init__(self, line: Polyline) -> None:
        """`line` should have vertices about 1 m apart, as centre lines have."""
        self.line = line
        points = line.points
        length = np.diff(line.arc_m)
        unit = (points[1:] - points[:-1]) / length[:, None]
        starts = (np.ascontiguousarray(points[:-1, i]) for i in (0, 1))
        self.segments: tuple[Floats, ...] = (*starts, *np.ascontiguousarray(unit.T), length, line.arc_m[:-1])
        """x and y of the start, x and y of the direction, length, arc length at the start; (S,) each."""
        self.coarse_at: Ints = frozen(np.unique(np.append(np.arange(0, len(points), _STRIDE), len(points) - 1)), int)
        """Every fourth vertex."""
        self.coarse_arc_m: Floats = line.arc_m[self.coarse_at]
        self.coarse_m = float(np.diff(self.coarse_arc_m).max())
        """Largest distance between the vertices that are looked at first."""
        self.fine_m = float(np.median(length))
        """Usual length of a segment."""

    @property
    def length_m(self) -> float:
        return self.line.length_m

    @cached_property
    def bundle(self) -> PathBundle:
        """This path alone."""
        return PathBundle((self,))

    def project(self, x_m: Floats, y_m: Floats, between_m: tuple[float, float] | None = None) -> tuple[Floats, Floats]:
        """Arc length (M,) and lateral offset (M,), left positive, of points (M,); `between_m` narrows the search."""
        bundle, of = self.bundle, np.zeros(len(x_m), dtype=np.int64)
        vertices, _ = bundle.nearest_vertices(of, x_m, y_m, [between_m or (0.0, self.length_m)])
        return bundle.project_near(of, x_m, y_m, vertices)[:2]


class PathBundle:
    """Several paths on which points are projected at once, each on its own one.

    Segments are counted through all paths; between two paths one number is left
    out, so that the same numbers stand for vertices.
    """

    def __init__(self, paths: Sequence[DrivingPath]) -> None:
        self.paths = tuple(paths)
        counts = np.array([len(path.line.points) for path in paths])
        self.first: Ints = np.cumsum(counts) - counts
        """(P,) where the vertices of each begin, and its segments."""
        self._last = self.first + counts - 2
        if len(paths) == 1:
            self._columns = paths[0].segments
            coarse, self._coarse_at = paths[0].line.points[paths[0].coarse_at], paths[0].coarse_at
        else:
            gap = np.zeros(1)
            columns = zip(*(path.segments for path in paths), strict=True)
            self._columns = tuple(np.concatenate([p for part in each for p in (part, gap)]) for each in columns)
            coarse = np.concatenate([path.line.points[path.coarse_at] for path in paths])
            self._coarse_at = np.concatenate([path.coarse_at + k for path, k in zip(paths, self.first, strict=True)])
        self._coarse_x, self._coarse_y = np.ascontiguousarray(coarse.T)
        self._coarse_first: list[int] = [0, *accumulate(len(path.coarse_at) for path in paths)]
        self.coarse_m: Floats = np.array([path.coarse_m for path in paths])
        self.fine_m: Floats = np.array([path.fine_m for path in paths])

    def nearest_vertices(
        self, of: Ints, x_m: Floats, y_m: Floats, between_m: Sequence[tuple[float, float]]
    ) -> tuple[Ints, Floats]:
        """For points (M,): the nearest of every fourth vertex of path `of` (M,), which increases, and its distance.

        Each path is looked at within a stretch of its own.
        """
        nearest, away_m = np.empty(len(of), dtype=np.int64), np.empty(len(of))
        pieces = of.searchsorted(np.arange(len(self.paths) + 1)).tolist()
        # path after path: picking each point's own vertices would take longer than the sums
        for p, ((a, b), stretch_m) in enumerate(zip(pairwise(pieces), between_m, strict=True)):
            if a == b:
                continue
            first, last = self._window(p, stretch_m)
            off_x = x_m[a:b, None] - self._coarse_x[first:last]
            off_y = y_m[a:b, None] - self._coarse_y[first:last]
            off_x *= off_x
            off_y *= off_y
            off_x += off_y
            best = off_x.argmin(axis=1)
            np.take(self._coarse_at, first + best, out=nearest[a:b])
            np.sqrt(off_x.ravel()[best + (last - first) * np.arange(b - a)], away_m[a:b])
        return nearest, away_m

    def _window(self, p: int, between_m: tuple[float, float]) -> tuple[int, int]:
        """Which of every fourth vertex of a path lie in a stretch: the first of them, and the one after the last."""
        arc_m = self.paths[p].coarse_arc_m
        first = max(int(arc_m.searchsorted(between_m[0])) - 1, 0)
        last = max(min(int(arc_m.searchsorted(between_m[1])) + 1, len(arc_m)), first + 1)
        return self._coarse_first[p] + first, self._coarse_first[p] + last

    def directions(self, segments: Ints) -> tuple[Floats, Floats]:
        """Cosine and sine of the headings of segments."""
        return self._columns[2][segments], self._columns[3][segments]

    def project_near(
        self, of: Ints, x_m: Floats, y_m: Floats, segments: Ints, spans: Ints | int = _SPAN
    ) -> tuple[Floats, Floats, Ints]:
        """Arc length, lateral offset (left positive) and segment, (..., M) each, of points (..., M) on paths (M,).

        Looks at `spans`, one for all or (P,) by path, segments on either side of given ones (M,).
        """
        low, high = self.first[of], self._last[of]
        if isinstance(spans, int):
            span = spans
        else:
            span, own = int(spans.max()), spans[of]
            low, high = np.maximum(low, segments - own), np.minimum(high, segments + own)
        # segments come first and points last, so that numpy has long rows to work on
        rows = np.minimum(np.maximum(segments + np.arange(-span, span + 1)[:, None], low), high)
        shape = (len(rows),) + (1,) * (x_m.ndim - 1) + (len(of),)
        start_x, start_y, unit_x, unit_y, length = (column[rows].reshape(shape) for column in self._columns[:5])
        off_x, off_y = x_m - start_x, y_m - start_y
        along, part = off_x * unit_x, off_y * unit_y
        along += part
        np.maximum(along, 0.0, out=along)
        np.minimum(along, length, out=along)
        off_x -= np.multiply(along, unit_x, part)
        off_y -= np.multiply(along, unit_y, part)
        distance2 = off_x * off_x
        distance2 += np.multiply(off_y, off_y, part)
        best = distance2.argmin(axis=0)
        at = best.ravel() * best.size + np.arange(best.size)
        segment = rows.ravel()[best * len(of) + np.arange(len(of))]
        along, off_x, off_y, distance2 = (a.ravel()[at].reshape(best.shape) for a in (along, off_x, off_y, distance2))
        side = self._columns[2][segment] * off_y - self._columns[3][segment] * off_x
        return self._columns[5][segment] + along, np.copysign(np.sqrt(distance2), side), segment


def center_poses(
    paths: Sequence[DrivingPath], path_of: Ints, progress_m: Floats, shape: EgoShape
) -> tuple[Floats, Floats, Floats]:
    """x, y, heading (N, T) of the box centre where the rear axle is at arc lengths (N, T) of paths `path_of` (N,)."""
    x_m, y_m, heading_rad = (np.empty_like(progress_m) for _ in range(3))
    for i, path in enumerate(paths):
        rows = np.flatnonzero(path_of == i)
        if not rows.size:
            continue
        line = path.line
        at = np.minimum(np.maximum(progress_m[rows], 0.0), line.length_m)
        x_m[rows] = np.interp(at, line.arc_m, line.points[:, 0])
        y_m[rows] = np.interp(at, line.arc_m, line.points[:, 1])
        heading_rad[rows] = np.interp(at, line.arc_m, line.vertex_heading_rad)
    ahead_m = shape.rear_axle_to_center_m
    return x_m + ahead_m * np.cos(heading_rad), y_m + ahead_m * np.sin(heading_rad), heading_rad


def rear_axle_plan(
    line: Polyline, time_s: ArrayLike, progress_m: ArrayLike, speed_mps: ArrayLike, shape: EgoShape
) -> Trajectory:
    """A plan whose rear axle lies on a line at arc lengths (N,), which are clamped to it."""
    x_m, y_m, heading_rad = line.poses_at(progress_m).T
    ahead_m = shape.rear_axle_to_center_m
    return Trajectory(
        np.asarray(time_s, float),
        x_m + ahead_m * np.cos(heading_rad),
        y_m + ahead_m * np.sin(heading_rad),
        heading_rad,
        np.asarray(speed_mps, float),
    )


def plan_along(path: Polyline, time_s: ArrayLike, progress_m: ArrayLike, speed_mps: ArrayLike) -> Trajectory:
    """A plan whose poses lie on a path at arc lengths (N,), which are clamped to it."""
    x_m, y_m, heading_rad = path.poses_at(progress_m).T
    return Trajectory(np.asarray(time_s, float), x_m, y_m, heading_rad, np.asarray(speed_mps, float))


def braking_plan(ego: EgoState, deceleration_mps2: float, horizon_s: float, step_s: float) -> Trajectory:
    """A plan that brakes to a standstill straight ahead; for when there is no path to follow."""
    ahead_s: Floats = np.linspace(0.0, horizon_s, round(horizon_s / step_s) + 1)
    speed_mps = max(0.0, ego.speed_mps)
    until_stop_s = np.minimum(ahead_s, speed_mps / deceleration_mps2)
    travelled_m = speed_mps * until_stop_s - 0.5 * deceleration_mps2 * until_stop_s**2
    return Trajectory(
        ego.time_s + ahead_s,
        ego.x_m + travelled_m * np.cos(ego.heading_rad),
        ego.y_m + travelled_m * np.sin(ego.heading_rad),
        np.full_like(ahead_s, ego.heading_rad),
        speed_mps - deceleration_mps2 * until_stop_s,
    )


def lane_change_path(target: Polyline, start: Pose, length_m: float, steepest_rad: float = 0.5) -> Polyline:
    """The target lane's centre line, approached from a pose beside it along `length_m` of it.

    The lateral offset is a quintic: it starts with the pose's offset and
    heading (at most `steepest_rad` off the lane's) and without curvature, and
    ends with none of them. Arc lengths before the pose belong to a line parallel to
    the target; those after it are those of the target but for what the way
    across adds.
    """
    arc_m, left_m = target.project_point(start.x_m, start.y_m)
    turned = float(wrap_angle(start.heading_rad - target.pose_at(arc_m).heading_rad))
    slope = tan(max(-steepest_rad, min(steepest_rad, turned)))
    cut = np.arange(max(arc_m - 10.0, 0.0), min(arc_m + length_m, target.length_m), 1.0)
    arcs = np.unique(np.concatenate((target.arc_m, cut, [arc_m])))
    arcs = arcs[np.concatenate(([True], np.diff(arcs) > 0.05))]
    line = Polyline(target.poses_at(arcs)[:, :2])
    # a line drops vertices that lie too close together; offsets belong to those that are left
    at = arcs if len(line.points) == len(arcs) else target.project(line.points)[0]
    return shifted(line, quintic_offset((at - arc_m) / length_m, left_m, slope * length_m))


def quintic_offset(share: Floats, offset_m: float, slope_m: float) -> Floats:
    """Offsets (N,) at shares of the way: `offset_m` up to share 0, where it changes by `slope_m` per way, 0 from 1 on.

    Slope at the end and curvature at both ends are 0.
    """
    u = np.clip(share, 0.0, 1.0)
    fall = 1.0 - u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    tilt = u - u**3 * (6.0 - 8.0 * u + 3.0 * u**2)
    return offset_m * fall + slope_m * tilt
