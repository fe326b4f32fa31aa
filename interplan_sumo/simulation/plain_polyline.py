"""A polyline in plain floats, for questions about one point at a time.

A step looks at a few points and a few segments near them; there arrays cost
more than they save. Results equal those of `Polyline` to the bit.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from math import copysign, cos, hypot, inf, sin

from interplan_sumo.world.geometry import Polyline, Pose, wrap_angle


class PlainPolyline:
    """A polyline of N vertices."""

    __slots__ = ("_inner_arc_m", "_points", "_segments", "_vertex_heading_rad", "arc_m", "heading_rad", "length_m")

    def __init__(self, line: Polyline) -> None:
        self.arc_m: list[float] = line.arc_m.tolist()
        """(N,) arc length of each vertex."""
        self.heading_rad: list[float] = line.segment_heading_rad.tolist()
        """(N-1,) heading of each segment."""
        self.length_m = self.arc_m[-1]
        self._inner_arc_m = self.arc_m[1:-1]
        self._points: list[list[float]] = line.points.tolist()
        self._vertex_heading_rad: list[float] = line.vertex_heading_rad.tolist()
        lengths = line.arc_m[1:] - line.arc_m[:-1]
        unit = (line.points[1:] - line.points[:-1]) / lengths[:, None]
        rows = zip(self._points, unit.tolist(), lengths.tolist(), self.arc_m, strict=False)
        self._segments = [(x, y, ux, uy, length, arc) for (x, y), (ux, uy), length, arc in rows]

    def project(self, x_m: float, y_m: float, between_m: tuple[float, float] | None = None) -> tuple[float, float]:
        """Arc length and signed lateral offset, left positive, of the nearest point.

        `between_m` looks only at the segments that reach into this stretch.
        """
        segments = self._segments
        if between_m is not None and len(segments) > 1:
            segments = segments[self._rows(*between_m)]
        least = inf
        found = (0.0, 0.0, 0.0, 0.0)
        for x, y, ux, uy, length, arc in segments:
            rel_x, rel_y = x_m - x, y_m - y
            along = rel_x * ux + rel_y * uy
            along = 0.0 if along < 0.0 else min(along, length)
            off_x, off_y = rel_x - along * ux, rel_y - along * uy
            away = off_x * off_x + off_y * off_y
            if away < least:
                least = away
                found = (arc + along, off_x, off_y, ux * off_y - uy * off_x)
        arc_m, off_x, off_y, side = found
        return arc_m, copysign(hypot(off_x, off_y), side)

    def keeps_off(self, box: Sequence[tuple[float, float]], away_m: float) -> bool:
        """Whether the corners of a box show that none of it is as near as this: they lie on one side of each segment.

        Where it is False the box may still be farther away.
        """
        for x, y, ux, uy, length, _ in self._segments:
            left_m = [ux * (y_m - y) - uy * (x_m - x) for x_m, y_m in box]
            if min(left_m) > away_m or max(left_m) < -away_m:
                continue
            along_m = [ux * (x_m - x) + uy * (y_m - y) for x_m, y_m in box]
            if min(along_m) <= length + away_m and max(along_m) >= -away_m:
                return False
        return True

    def _rows(self, start_m: float, end_m: float) -> slice:
        """The segments that reach into a stretch; at least one."""
        last = len(self._segments) - 1
        first = min(max(bisect_right(self.arc_m, start_m) - 1, 0), last)
        return slice(first, min(max(bisect_left(self.arc_m, end_m) - 1, first), last) + 1)

    def arc_on(self, segment: int, x_m: float, y_m: float) -> float:
        """Arc length of the point of one segment that is nearest."""
        x, y, ux, uy, length, arc = self._segments[segment]
        along = (x_m - x) * ux + (y_m - y) * uy
        return arc + (0.0 if along < 0.0 else min(along, length))

    def heading_at(self, arc_m: float) -> float:
        """Heading at an arc length, interpolated between vertices, not wrapped."""
        i, share = self._place(arc_m)
        here, there = self._vertex_heading_rad[i : i + 2]
        return here + share * (there - here)

    def pose_at(self, arc_m: float) -> Pose:
        """The pose at one arc length, which is clamped to the line."""
        i, share = self._place(arc_m)
        (x, y), (next_x, next_y) = self._points[i : i + 2]
        here, there = self._vertex_heading_rad[i : i + 2]
        return Pose(x + share * (next_x - x), y + share * (next_y - y), wrap_angle(here + share * (there - here)))

    def _place(self, arc_m: float) -> tuple[int, float]:
        """Segment and share of it at an arc length."""
        at = min(max(arc_m, 0.0), self.length_m)
        i = min(max(bisect_right(self.arc_m, at) - 1, 0), len(self._segments) - 1)
        first, last = self.arc_m[i], self.arc_m[i + 1]
        return i, (at - first) / (last - first)

    def speed_along(self, arc_m: float, velocity_mps: tuple[float, float]) -> float:
        """The part of a velocity along the segment at an arc length."""
        heading = self.heading_rad[bisect_left(self._inner_arc_m, arc_m)]
        return velocity_mps[0] * cos(heading) + velocity_mps[1] * sin(heading)
