"""Alignments and curves: the geometry with which road plans become lines on the ground.

Plans are drawn in local metres, x east and y north. A *station* is the distance
along an alignment from its start; an *offset* is a distance to its left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from interplan_sumo.world.geometry import Floats, Pose, wrap_angle

MAX_SPACING_M = 0.9
"""Planners take the vertices of a centre line as they are: less than 1 m apart, also where a lane glides sideways."""
CURVE_SPACING_M = 0.7
"""On curves, so that lanes on the outside keep below 1 m, too."""
MAX_STEP_RAD = np.radians(0.9)
"""Greatest change of heading between two vertices of an alignment, so that no join shows a kink of a degree."""
TURN_SPACING_M = 0.4
"""Vertex spacing of turns inside junctions."""
SPIRAL_SHARE = 0.3
"""Share of a turn's deflection that its two transition curves take; the rest is a circular arc."""
LONGEST_SPIRAL = 0.8
"""Share of a bend that its spirals may take up."""

# Gauss-Legendre nodes on [0, 1]: exact to 1e-12 m for the gentle spirals drawn here.
_LEGENDRE_NODES, _LEGENDRE_WEIGHTS = np.polynomial.legendre.leggauss(12)
_NODES, _WEIGHTS = (_LEGENDRE_NODES + 1.0) / 2.0, _LEGENDRE_WEIGHTS / 2.0


@dataclass(frozen=True, slots=True)
class Element:
    """A straight, an arc or a transition curve: curvature changes linearly along it."""

    start: Pose
    length_m: float
    start_curvature_per_m: float
    end_curvature_per_m: float

    def poses(self, along_m: Floats) -> Floats:
        """(K, 3) x, y, heading (not wrapped) at distances along the element."""
        rate = (self.end_curvature_per_m - self.start_curvature_per_m) / self.length_m

        def heading(at_m: Floats) -> Floats:
            return self.start.heading_rad + at_m * (self.start_curvature_per_m + 0.5 * rate * at_m)

        steps = along_m[:, None] * _NODES[None, :]
        angles = heading(steps)
        x = self.start.x_m + along_m * (np.cos(angles) * _WEIGHTS).sum(axis=1)
        y = self.start.y_m + along_m * (np.sin(angles) * _WEIGHTS).sum(axis=1)
        return np.stack((x, y, heading(along_m)), axis=1)

    @property
    def end(self) -> Pose:
        x_m, y_m, heading_rad = self.poses(np.array([self.length_m]))[0]
        return Pose(float(x_m), float(y_m), float(heading_rad))


@dataclass(frozen=True, slots=True, eq=False)
class SmoothCurve:
    """A smooth line as vertices with exact headings, so that parallels of it are exact too."""

    points: Floats
    """(N, 2) metres."""
    heading_rad: Floats
    """(N,) direction of travel at each vertex."""

    def shifted(self, left_m: ArrayLike) -> Floats:
        """(N, 2) the line moved to its left, by one distance or by one per vertex."""
        left = np.broadcast_to(np.asarray(left_m, dtype=np.float64), self.heading_rad.shape)
        normal = np.stack((-np.sin(self.heading_rad), np.cos(self.heading_rad)), axis=1)
        return self.points + left[:, None] * normal

    def reversed(self) -> SmoothCurve:
        return SmoothCurve(self.points[::-1], self.heading_rad[::-1] + np.pi)


@dataclass(frozen=True, eq=False)
class Alignment:
    """The axis of a road: elements that follow one another without a kink."""

    elements: tuple[Element, ...]

    @cached_property
    def starts_m(self) -> Floats:
        """(E,) station at which each element starts."""
        return np.concatenate(([0.0], np.cumsum([e.length_m for e in self.elements])[:-1]))

    @cached_property
    def length_m(self) -> float:
        return float(sum(e.length_m for e in self.elements))

    @cached_property
    def grid_m(self) -> Floats:
        """Stations of all vertices ever drawn on this road.

        Lanes of both directions take their vertices from this one grid, so
        neighbours share them exactly and no slivers arise between polygons.
        """
        stations = [np.zeros(1)]
        for start_m, element in zip(self.starts_m, self.elements, strict=True):
            bend = max(abs(element.start_curvature_per_m), abs(element.end_curvature_per_m))
            spacing_m = MAX_SPACING_M if bend == 0.0 else min(CURVE_SPACING_M, MAX_STEP_RAD / bend)
            count = max(1, int(np.ceil(element.length_m / spacing_m - 1e-9)))
            stations.append(start_m + element.length_m * np.arange(1, count + 1) / count)
        return np.concatenate(stations)

    def snapped_m(self, station_m: float) -> float:
        """The station of the grid nearest to `station_m`."""
        return float(self.grid_m[int(np.argmin(np.abs(self.grid_m - station_m)))])

    def grid_between(self, from_m: float, to_m: float) -> Floats:
        """Grid stations from `from_m` to `to_m`, both included, which must lie on the grid."""
        return self.grid_m[(self.grid_m >= from_m - 1e-9) & (self.grid_m <= to_m + 1e-9)]

    def poses(self, stations_m: ArrayLike) -> Floats:
        """(K, 3) x, y, heading (not wrapped); the end elements are prolonged beyond the ends."""
        at = np.atleast_1d(np.asarray(stations_m, dtype=np.float64))
        which = np.clip(np.searchsorted(self.starts_m, at, side="right") - 1, 0, len(self.elements) - 1)
        out = np.empty((len(at), 3))
        for i in np.unique(which):
            rows = which == i
            out[rows] = self.elements[i].poses(at[rows] - self.starts_m[i])
        return out

    def curvature_per_m(self, stations_m: ArrayLike) -> Floats:
        """(K,) curvature, positive to the left."""
        at = np.atleast_1d(np.asarray(stations_m, dtype=np.float64))
        which = np.clip(np.searchsorted(self.starts_m, at, side="right") - 1, 0, len(self.elements) - 1)
        share = (at - self.starts_m[which]) / np.array([e.length_m for e in self.elements])[which]
        first = np.array([e.start_curvature_per_m for e in self.elements])[which]
        last = np.array([e.end_curvature_per_m for e in self.elements])[which]
        return first + share * (last - first)

    def pose(self, station_m: float, left_m: float = 0.0) -> Pose:
        """The pose at one station, moved `left_m` to the left of the axis."""
        x_m, y_m, heading = self.poses(station_m)[0]
        return beside_pose(Pose(float(x_m), float(y_m), float(heading)), left_m)

    def station_of(self, x_m: float, y_m: float) -> float:
        """The station whose normal passes through a point, found from the nearest vertex."""
        at = self.poses(self.grid_m)
        station_m = float(self.grid_m[int(np.argmin(np.hypot(at[:, 0] - x_m, at[:, 1] - y_m)))])
        for _ in range(6):
            pose = self.pose(station_m)
            ahead_m = (x_m - pose.x_m) * np.cos(pose.heading_rad) + (y_m - pose.y_m) * np.sin(pose.heading_rad)
            station_m = float(np.clip(station_m + ahead_m, 0.0, self.length_m))
        return station_m


def _spiral_end(angle_rad: float) -> tuple[float, float]:
    """x and y at the end of a spiral to radius 1 that turns by `angle_rad`, seen from its start."""
    along = 2.0 * angle_rad * _NODES
    turned = along**2 / (4.0 * angle_rad) if angle_rad > 0.0 else along * 0.0
    return (
        float(2.0 * angle_rad * (np.cos(turned) * _WEIGHTS).sum()),
        float(2.0 * angle_rad * (np.sin(turned) * _WEIGHTS).sum()),
    )


def _tangent_per_radius(deflection_rad: float, spiral_rad: float) -> float:
    """Tangent length of a spiral-arc-spiral bend over its radius; each spiral turns by `spiral_rad`."""
    x, y = _spiral_end(spiral_rad)
    inset, ahead = y - (1.0 - np.cos(spiral_rad)), x - np.sin(spiral_rad)
    return float((1.0 + inset) * np.tan(abs(deflection_rad) / 2.0) + ahead)


def _bend(start: Pose, deflection_rad: float, radius_m: float, spiral_m: float) -> list[Element]:
    """Spiral, arc and spiral from a pose on."""
    curvature = np.copysign(1.0 / radius_m, deflection_rad)
    arc_m = abs(deflection_rad) * radius_m - spiral_m
    parts = ((spiral_m, 0.0, curvature), (arc_m, curvature, curvature), (spiral_m, curvature, 0.0))
    elements: list[Element] = []
    for length_m, first, last in parts:
        if length_m > 1e-9:
            elements.append(Element(start, length_m, float(first), float(last)))
            start = elements[-1].end
    return elements


def alignment(points: Sequence[Sequence[float]]) -> Alignment:
    """The road axis through a polygon of tangents, as road engineers draw it.

    Each point is (x, y) for the two ends and (x, y, radius) or
    (x, y, radius, spiral length) for a bend, which is rounded with that radius;
    the spirals of slight bends are shorter.
    ValueError where a bend does not fit between its neighbours.
    """
    corner = np.array([p[:2] for p in points], dtype=np.float64)
    legs = np.diff(corner, axis=0)
    heading = np.arctan2(legs[:, 1], legs[:, 0])
    left_m = np.hypot(legs[:, 0], legs[:, 1])
    pose = Pose(float(corner[0, 0]), float(corner[0, 1]), float(heading[0]))
    elements: list[Element] = []
    for i in range(1, len(corner) - 1):
        deflection = float(wrap_angle(heading[i] - heading[i - 1]))
        radius_m = points[i][2]
        spiral_m = min(points[i][3] if len(points[i]) > 3 else 0.0, LONGEST_SPIRAL * abs(deflection) * radius_m)
        tangent_m = radius_m * _tangent_per_radius(deflection, spiral_m / (2.0 * radius_m))
        for leg in (i - 1, i):
            left_m[leg] -= tangent_m
            if left_m[leg] < -1e-9:
                raise ValueError(f"the bend at {tuple(points[i])} needs {-left_m[leg]:.1f} m more on one side")
        if left_m[i - 1] > 1e-6:
            elements.append(Element(pose, float(left_m[i - 1]), 0.0, 0.0))
            pose = elements[-1].end
        elements += _bend(pose, deflection, radius_m, spiral_m)
        # Restart on the exact tangent: sums of small errors never pull the road off its plan.
        unit = legs[i] / np.hypot(*legs[i])
        x_m, y_m = corner[i] + tangent_m * unit
        pose = Pose(float(x_m), float(y_m), float(elements[-1].end.heading_rad))
    elements.append(Element(pose, float(left_m[-1]), 0.0, 0.0))
    return Alignment(tuple(e for e in elements if e.length_m > 1e-6))


def smooth_step(share: ArrayLike) -> tuple[Floats, Floats]:
    """The quintic from 0 to 1 without slope or bend at its ends, and its derivative."""
    t = np.clip(np.asarray(share, dtype=np.float64), 0.0, 1.0)
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2), 30.0 * t**2 * (1.0 - t) ** 2


def beside(axis: Alignment, stations_m: Floats, from_left_m: float, to_left_m: float) -> SmoothCurve:
    """The line along an axis whose offset glides from one value to another between the first and last station."""
    span_m = float(stations_m[-1] - stations_m[0])
    blend, slope = smooth_step((stations_m - stations_m[0]) / span_m)
    left_m = from_left_m + (to_left_m - from_left_m) * blend
    poses = axis.poses(stations_m)
    stretch = 1.0 - axis.curvature_per_m(stations_m) * left_m
    drift = np.arctan2((to_left_m - from_left_m) / span_m * slope, stretch)
    normal = np.stack((-np.sin(poses[:, 2]), np.cos(poses[:, 2])), axis=1)
    return SmoothCurve(poses[:, :2] + left_m[:, None] * normal, poses[:, 2] + drift)


def crossing_m(one: Pose, other: Pose) -> tuple[float, float]:
    """How far ahead of two poses their lines cross (negative: behind); the lines must not be parallel."""
    sine = np.sin(other.heading_rad - one.heading_rad)
    dx, dy = other.x_m - one.x_m, other.y_m - one.y_m
    return (
        float((dx * np.sin(other.heading_rad) - dy * np.cos(other.heading_rad)) / sine),
        float((dx * np.sin(one.heading_rad) - dy * np.cos(one.heading_rad)) / sine),
    )


def beside_pose(pose: Pose, left_m: float) -> Pose:
    """The pose moved to its left."""
    x_m = pose.x_m - left_m * np.sin(pose.heading_rad)
    y_m = pose.y_m + left_m * np.cos(pose.heading_rad)
    return Pose(float(x_m), float(y_m), pose.heading_rad)


def turn(start: Pose, end: Pose, *, spiral_share: float = SPIRAL_SHARE) -> SmoothCurve:
    """The way from one pose to another as a driver steers it.

    Where the tangents of both poses cross ahead of the first and behind the
    second: straight, transition, arc, transition, straight, with the largest
    radius that fits. Else (a parallel shift, or nearly) a quintic without
    curvature at its ends.
    """
    deflection = float(wrap_angle(end.heading_rad - start.heading_rad))
    if abs(deflection) > np.radians(4.0):
        before_m, beyond_m = crossing_m(start, end)
        after_m = -beyond_m
        if min(before_m, after_m) > 0.5 and abs(deflection) < np.radians(170.0):
            return _rounded(start, deflection, before_m, after_m, spiral_share)
    return _quintic(start, end)


def _rounded(start: Pose, deflection_rad: float, before_m: float, after_m: float, spiral_share: float) -> SmoothCurve:
    spiral_rad = abs(deflection_rad) * spiral_share / 2.0
    tangent_m = min(before_m, after_m)
    radius_m = tangent_m / _tangent_per_radius(deflection_rad, spiral_rad)
    elements: list[Element] = []
    pose = start
    if before_m - tangent_m > 1e-6:
        elements.append(Element(pose, before_m - tangent_m, 0.0, 0.0))
        pose = elements[-1].end
    elements += _bend(pose, deflection_rad, radius_m, 2.0 * spiral_rad * radius_m)
    if after_m - tangent_m > 1e-6:
        elements.append(Element(elements[-1].end, after_m - tangent_m, 0.0, 0.0))
    line = Alignment(tuple(elements))
    count = max(2, int(np.ceil(line.length_m / TURN_SPACING_M)))
    poses = line.poses(np.linspace(0.0, line.length_m, count + 1))
    return SmoothCurve(poses[:, :2], poses[:, 2])


def _quintic(start: Pose, end: Pose) -> SmoothCurve:
    chord_m = float(np.hypot(end.x_m - start.x_m, end.y_m - start.y_m))
    count = max(2, int(np.ceil(chord_m / TURN_SPACING_M)))
    t = np.linspace(0.0, 1.0, count + 1)
    blend, slope = smooth_step(t)
    # Quintic Hermite basis with zero second derivatives at both ends.
    first, first_d = t - 6 * t**3 + 8 * t**4 - 3 * t**5, 1 - 18 * t**2 + 32 * t**3 - 15 * t**4
    last, last_d = -4 * t**3 + 7 * t**4 - 3 * t**5, -12 * t**2 + 28 * t**3 - 15 * t**4
    columns: list[Floats] = []
    rates: list[Floats] = []
    for a, b, along_a, along_b in (
        (start.x_m, end.x_m, np.cos(start.heading_rad), np.cos(end.heading_rad)),
        (start.y_m, end.y_m, np.sin(start.heading_rad), np.sin(end.heading_rad)),
    ):
        columns.append(a + (b - a) * blend + chord_m * (along_a * first + along_b * last))
        rates.append((b - a) * slope + chord_m * (along_a * first_d + along_b * last_d))
    heading = np.unwrap(np.arctan2(rates[1], rates[0]))
    return SmoothCurve(np.stack(columns, axis=1), heading)
