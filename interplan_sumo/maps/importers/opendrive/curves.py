"""Reference lines of roads: lines, arcs, spirals and cubic polynomials, evaluated at any station.

A curve lies in a frame of its own, u along its start and v to the left of it;
its parameter is the arc length from its start. Metres and radians.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import leggauss

from interplan_sumo.world.geometry import Floats

Curve = Callable[[Floats], tuple[Floats, Floats]]
"""Arc lengths (N,) to points (N, 2) and headings (N,) in the frame of the curve."""

Coefficients = tuple[float, float, float, float]
"""a, b, c, d of a + b p + c p^2 + d p^3."""

_STRAIGHT = 1e-12  # curvatures below this, in 1/m, are none
_PANEL_RAD = 0.3
"""Spirals are integrated over panels that turn by no more than this; seven Gauss points are then exact to 1e-14."""
_MOST_PANELS = 20_000
_GAUSS_AT, _GAUSS_WEIGHT = leggauss(7)
_STEPS = 512
"""Panels over which the arc length of a polynomial is added up."""


def line() -> Curve:
    """A straight line."""

    def at(arc_m: Floats) -> tuple[Floats, Floats]:
        return np.stack((arc_m, np.zeros_like(arc_m)), axis=1), np.zeros_like(arc_m)

    return at


def arc(curvature: float) -> Curve:
    """A circular arc; the curvature is in 1/m, positive to the left."""
    if abs(curvature) < _STRAIGHT:
        return line()

    def at(arc_m: Floats) -> tuple[Floats, Floats]:
        turn = curvature * arc_m
        half = np.sinc(turn / (2.0 * np.pi))  # sin(turn / 2) / (turn / 2): exact for the flattest arc, too
        chord = arc_m * half
        return np.stack((chord * np.cos(turn / 2.0), chord * np.sin(turn / 2.0)), axis=1), turn

    return at


def spiral(start: float, end: float, length_m: float) -> Curve:
    """A clothoid, whose curvature grows evenly from `start` to `end`, both in 1/m.

    ValueError if it winds up too tightly to be a road.
    """
    rate = (end - start) / length_m
    if abs(rate) * length_m < _STRAIGHT:
        return arc(start)
    turn_rad = max(abs(start), abs(end)) * length_m
    panels = 1 + int(turn_rad / _PANEL_RAD)
    if panels > _MOST_PANELS:
        raise ValueError("a spiral winds up too tightly to be a road")
    knots = np.linspace(0.0, length_m, panels + 1)

    def heading(arc_m: Floats) -> Floats:
        return (start + rate * arc_m / 2.0) * arc_m

    def ahead(begin_m: Floats, stop_m: Floats) -> Floats:
        """(N, 2) the way from one arc length to another within a panel."""
        half = (stop_m - begin_m) / 2.0
        angle = heading(begin_m[:, None] + half[:, None] * (1.0 + _GAUSS_AT))
        return half[:, None] * np.stack((np.cos(angle) @ _GAUSS_WEIGHT, np.sin(angle) @ _GAUSS_WEIGHT), axis=1)

    reached = np.concatenate((np.zeros((1, 2)), np.cumsum(ahead(knots[:-1], knots[1:]), axis=0)))

    def at(arc_m: Floats) -> tuple[Floats, Floats]:
        panel = np.clip(np.searchsorted(knots, arc_m, side="right") - 1, 0, panels - 1)
        return reached[panel] + ahead(knots[panel], arc_m), heading(arc_m)

    return at


def cubic(u: Coefficients, v: Coefficients, span: float, length_m: float) -> Curve:
    """A curve whose u and v are cubic polynomials of a parameter that runs evenly from 0 at its start to `span`.

    The parameter is taken for a linear function of the arc length, as in
    OpenDRIVE's paramPoly3.
    """

    def at(arc_m: Floats) -> tuple[Floats, Floats]:
        return _on_cubic(u, v, arc_m * (span / length_m))

    return at


def graph(v: Coefficients, length_m: float) -> Curve:
    """The graph of v over u, as in OpenDRIVE's poly3, whose length is measured along the curve."""
    reach = np.linspace(0.0, length_m, _STEPS + 1)  # the graph over so much of u is at least as long
    half = length_m / _STEPS / 2.0
    at_gauss = reach[:-1, None] + half * (1.0 + _GAUSS_AT)
    slope = v[1] + at_gauss * (2.0 * v[2] + at_gauss * 3.0 * v[3])
    arc_of = np.concatenate(([0.0], np.cumsum(half * (np.hypot(1.0, slope) @ _GAUSS_WEIGHT))))

    def at(arc_m: Floats) -> tuple[Floats, Floats]:
        return _on_cubic((0.0, 1.0, 0.0, 0.0), v, np.interp(arc_m, arc_of, reach))

    return at


def _on_cubic(u: Coefficients, v: Coefficients, p: Floats) -> tuple[Floats, Floats]:
    (a, b, c, d), (e, f, g, h) = u, v
    points = np.stack((a + p * (b + p * (c + p * d)), e + p * (f + p * (g + p * h))), axis=1)
    along_u = b + p * (2.0 * c + p * 3.0 * d)
    along_v = f + p * (2.0 * g + p * 3.0 * h)
    return points, np.arctan2(along_v, along_u)


@dataclass(frozen=True, slots=True)
class Piece:
    """A curve in its place."""

    start_m: float
    """Station at which it begins."""
    length_m: float
    x_m: float
    y_m: float
    heading_rad: float
    curve: Curve

    def at(self, station_m: Floats) -> tuple[Floats, Floats]:
        """(N, 2) points and (N,) headings at stations."""
        local, turn = self.curve(station_m - self.start_m)
        cos, sin = np.cos(self.heading_rad), np.sin(self.heading_rad)
        x = self.x_m + cos * local[:, 0] - sin * local[:, 1]
        y = self.y_m + sin * local[:, 0] + cos * local[:, 1]
        return np.stack((x, y), axis=1), self.heading_rad + turn


@dataclass(frozen=True)
class ReferenceLine:
    """The line to which everything of a road refers; stations are metres along it."""

    pieces: Sequence[Piece]
    """At least one, in the order of their stations."""

    @cached_property
    def starts_m(self) -> Floats:
        return np.array([piece.start_m for piece in self.pieces])

    @property
    def length_m(self) -> float:
        return self.pieces[-1].start_m + self.pieces[-1].length_m

    def at(self, station_m: Floats, *, ending: bool = False) -> tuple[Floats, Floats]:
        """(N, 2) points and (N,) headings at stations.

        With `ending` the last of them counts to the piece that ends there.
        """
        index = index_of(self.starts_m, station_m, ending=ending)
        points, heading = np.empty((len(station_m), 2)), np.empty(len(station_m))
        for k in np.unique(index).tolist():
            here = index == k
            points[here], heading[here] = self.pieces[k].at(station_m[here])
        return points, heading

    def beside(self, station_m: Floats, left_m: Floats, *, ending: bool = False) -> Floats:
        """(N, 2) points so far to the left of the line at stations."""
        points, heading = self.at(station_m, ending=ending)
        return points + left_m[:, None] * np.stack((-np.sin(heading), np.cos(heading)), axis=1)

    def gaps_m(self) -> Floats:
        """(N - 1,) how far the end of each piece lies from the start of the next."""
        ends = [piece.at(np.array([after.start_m]))[0][0] for piece, after in pairwise(self.pieces)]
        starts = [(piece.x_m, piece.y_m) for piece in self.pieces[1:]]
        return np.hypot(*(np.array(ends) - np.array(starts)).reshape(-1, 2).T)


@dataclass(frozen=True)
class PiecewiseCubic:
    """A quantity along a road: cubic polynomials, each from its station on."""

    starts_m: Floats
    """(N,) ascending."""
    coefficients: Floats
    """(N, 4), of the distance from the start."""

    def at(self, station_m: Floats, *, ending: bool = False) -> Floats:
        """(N,) values; 0 before the first station. With `ending` the last counts to the record that ends there."""
        index = index_of(self.starts_m, station_m, ending=ending)
        a, b, c, d = self.coefficients[index].T
        p = station_m - self.starts_m[index]
        return np.where(station_m < self.starts_m[0] - _SAME_STATION_M, 0.0, a + p * (b + p * (c + p * d)))

    @property
    def is_flat(self) -> bool:
        """Whether it is zero everywhere."""
        return not self.coefficients.any()


_SAME_STATION_M = 1e-6


def index_of(starts_m: Floats, station_m: Floats, *, ending: bool) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """(N,) which of the records that begin at `starts_m` holds at each station.

    With `ending`, the last station counts to the record that ends there.
    """
    index = np.searchsorted(starts_m, station_m + _SAME_STATION_M, side="right") - 1
    if ending and len(index):
        index[-1] = np.searchsorted(starts_m, station_m[-1] - _SAME_STATION_M, side="right") - 1
    return np.clip(index, 0, len(starts_m) - 1)
