"""Lane polygons: convex parts of lanes, and how much of a box lies on them, in plain floats.

A step asks about one box and a handful of pieces of lanes near it; there
calls into a geometry library cost many times the arithmetic.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from math import cos, floor, hypot, inf, sin
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats

Ring = Sequence[tuple[float, float]]
"""Corners of a convex area in order, the first one not repeated."""
CELL_M = 16.0
"""Size of the squares in which things are looked up."""
ON_THE_LINE_M = 1e-9
"""A point this far outside of a side is on it, but for rounding."""
_FLAT_M2 = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class ConvexPart:
    """A convex piece of a lane."""

    sides: tuple[tuple[float, float, float], ...]
    """(a, b, c) of each: a x + b y + c is how far inside of it a point lies."""
    ring: Ring
    low_x: float
    low_y: float
    high_x: float
    high_y: float
    segment: int | None
    """The segment of the lane piece's line on both sides of which it lies; None: there is no single one."""

    def apart(self, low_x: float, low_y: float, high_x: float, high_y: float) -> bool:
        """Whether an upright rectangle lies clear of the part's."""
        return low_x > self.high_x or high_x < self.low_x or low_y > self.high_y or high_y < self.low_y

    def holds(self, x_m: float, y_m: float) -> bool:
        """Whether a point lies inside or on a side."""
        return all(a * x_m + b * y_m + c >= -ON_THE_LINE_M for a, b, c in self.sides)

    def distance_m(self, x_m: float, y_m: float) -> float:
        """From a point to the part; 0 inside."""
        if self.holds(x_m, y_m):
            return 0.0
        away = inf
        for (x, y), (next_x, next_y) in pairwise((*self.ring, self.ring[0])):
            dx, dy = next_x - x, next_y - y
            share = min(1.0, max(0.0, ((x_m - x) * dx + (y_m - y) * dy) / (dx * dx + dy * dy)))
            away = min(away, hypot(x_m - x - share * dx, y_m - y - share * dy))
        return away


def ego_ring(ego: EgoState, shape: EgoShape, origin_m: tuple[float, float]) -> Ring:
    """The corners of the ego's box less an origin, in the order of `EgoState.corners`."""
    cosine, sine = cos(ego.heading_rad), sin(ego.heading_rad)
    ahead_x, ahead_y = cosine * shape.length_m / 2, sine * shape.length_m / 2
    left_x, left_y = -sine * shape.width_m / 2, cosine * shape.width_m / 2
    x, y, (origin_x, origin_y) = ego.x_m, ego.y_m, origin_m
    return (
        (x + ahead_x + left_x - origin_x, y + ahead_y + left_y - origin_y),
        (x - ahead_x + left_x - origin_x, y - ahead_y + left_y - origin_y),
        (x - ahead_x - left_x - origin_x, y - ahead_y - left_y - origin_y),
        (x + ahead_x - left_x - origin_x, y + ahead_y - left_y - origin_y),
    )


def body_ring(front_x: float, front_y: float, heading_rad: float, length_m: float, width_m: float) -> Ring:
    """The corners of a car by the middle of its front bumper, in the same order."""
    cosine, sine = cos(heading_rad), sin(heading_rad)
    left_x, left_y = -sine * width_m / 2.0, cosine * width_m / 2.0
    rear_x, rear_y = front_x - cosine * length_m, front_y - sine * length_m
    return (
        (front_x + left_x, front_y + left_y),
        (rear_x + left_x, rear_y + left_y),
        (rear_x - left_x, rear_y - left_y),
        (front_x - left_x, front_y - left_y),
    )


def clipped(area: Ring, sides: Sequence[tuple[float, float, float]]) -> Ring:
    """The part of a convex area on the inner side of all `sides`; empty if they share no more than an edge."""
    for a, b, c in sides:
        depths = [a * x + b * y + c for x, y in area]
        if min(depths) >= 0.0:
            continue
        if max(depths) <= 0.0:
            return ()
        kept: list[tuple[float, float]] = []
        before, (before_x, before_y) = depths[-1], area[-1]
        for depth, (x, y) in zip(depths, area, strict=True):
            if (depth >= 0.0) != (before >= 0.0):
                share = before / (before - depth)
                kept.append((before_x + share * (x - before_x), before_y + share * (y - before_y)))
            if depth >= 0.0:
                kept.append((x, y))
            before, before_x, before_y = depth, x, y
        area = kept
    return area


class ClipArea(NamedTuple):
    """A convex area that is held against many parts of lanes."""

    ring: Ring
    low_x: float
    low_y: float
    high_x: float
    high_y: float
    x_m: float
    """Of the middle of its upright rectangle."""
    y_m: float
    radius_m: float
    """No point is farther from the middle."""

    @classmethod
    def of(cls, ring: Ring) -> ClipArea:
        low_x, low_y, high_x, high_y = bounds(ring)
        radius_m = hypot(high_x - low_x, high_y - low_y) / 2.0
        return cls(ring, low_x, low_y, high_x, high_y, (low_x + high_x) / 2.0, (low_y + high_y) / 2.0, radius_m)

    def on(self, parts: Iterable[ConvexPart]) -> Iterator[tuple[ConvexPart, Ring]]:
        """The parts of a lane on which some of it lies, and what; they share more than an edge."""
        ring, low_x, low_y, high_x, high_y, x, y, radius_m = self
        for part in parts:
            if low_x > part.high_x or high_x < part.low_x or low_y > part.high_y or high_y < part.low_y:
                continue
            covered = clipped(ring, [each for each in part.sides if each[0] * x + each[1] * y + each[2] < radius_m])
            if covered:
                yield part, covered


def area_m2(ring: Ring) -> float:
    """Positive if the ring runs counter-clockwise."""
    (x0, y0), *rest = ring
    twice = 0.0
    for (x1, y1), (x2, y2) in pairwise(rest):
        twice += (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    return twice / 2.0


def bounds(ring: Ring) -> tuple[float, float, float, float]:
    """Lowest x, lowest y, highest x, highest y."""
    xs, ys = zip(*ring, strict=True)
    return min(xs), min(ys), max(xs), max(ys)


def hull(points: Sequence[tuple[float, float]]) -> Ring:
    """The convex hull of points that do not all lie on one line, counter-clockwise."""
    ordered = sorted(set(points))
    rings: list[list[tuple[float, float]]] = []
    for run in (ordered, ordered[::-1]):
        ring: list[tuple[float, float]] = []
        for x, y in run:
            while len(ring) > 1 and area_m2((ring[-2], ring[-1], (x, y))) <= 0.0:
                ring.pop()
            ring.append((x, y))
        rings.append(ring[:-1])
    return rings[0] + rings[1]


def convex_parts_between(left: Floats, right: Floats, outline: shapely.Geometry) -> tuple[ConvexPart, ...]:
    """The convex parts of an area between two sides (N, 2), which run along N - 1 segments of a line.

    One per segment where these are convex and do not overlap. `outline` is
    the whole area; where they are not it is taken as it is, or cut into triangles.
    """
    rings = np.stack((right[:-1], right[1:], left[1:], left[:-1]), axis=1)
    edges = np.roll(rings, -1, axis=1) - rings
    after = np.roll(edges, -1, axis=1)
    convex = bool((edges[..., 0] * after[..., 1] - edges[..., 1] * after[..., 0] > 0.0).all())
    whole_m2 = float(shapely.area(outline))
    if convex and abs(sum(area_m2(_ring(each)) for each in rings) - whole_m2) <= 1e-9 * whole_m2:
        return tuple(_convex_part(_ring(each), segment) for segment, each in enumerate(rings))
    around = shapely.convex_hull(outline)
    if shapely.area(around) - whole_m2 <= 1e-9 * whole_m2:
        parts = [around]
    else:
        parts = shapely.get_parts(shapely.constrained_delaunay_triangles(outline))
    found = [_ring(shapely.get_coordinates(shapely.orient_polygons(part))[:-1]) for part in parts]
    return tuple(_convex_part(each, None) for each in found if area_m2(each) > _FLAT_M2)


def _ring(corners: Floats) -> Ring:
    return [(x, y) for x, y in corners.tolist()]


def _convex_part(ring: Ring, segment: int | None) -> ConvexPart:
    """A part from its corners, counter-clockwise."""
    sides: list[tuple[float, float, float]] = []
    for (x, y), (next_x, next_y) in pairwise((*ring, ring[0])):
        length_m = hypot(next_x - x, next_y - y)
        a, b = (y - next_y) / length_m, (next_x - x) / length_m
        sides.append((a, b, -a * x - b * y))
    return ConvexPart(tuple(sides), tuple(ring), *bounds(ring), segment)


class RectangleIndex:
    """Finds things by their upright rectangles."""

    def __init__(self, rectangles: NDArray[np.float64]) -> None:
        """`rectangles`: (N, 4) lowest x, lowest y, highest x, highest y."""
        self._rectangles: list[tuple[float, float, float, float]] = [(a, b, c, d) for a, b, c, d in rectangles.tolist()]
        self._cells: dict[tuple[int, int], list[int]] = {}
        self._blocks: dict[tuple[int, int, int, int], list[tuple[float, float, float, float, int]]] = {}
        """Rectangles and numbers of what is in cells that were asked about together."""
        for number, rectangle in enumerate(self._rectangles):
            first_column, first_row, last_column, last_row = _block(*rectangle)
            for column in range(first_column, last_column + 1):
                for row in range(first_row, last_row + 1):
                    self._cells.setdefault((column, row), []).append(number)

    def within(self, low_x: float, low_y: float, high_x: float, high_y: float) -> list[int]:
        """Numbers of the things whose rectangles meet this one, in order."""
        together = self._together(_block(low_x, low_y, high_x, high_y))
        return [each for a, b, c, d, each in together if a <= high_x and c >= low_x and b <= high_y and d >= low_y]

    def _together(self, block: tuple[int, int, int, int]) -> list[tuple[float, float, float, float, int]]:
        """Rectangles and numbers of what is in the cells of a block, in order."""
        found = self._blocks.get(block)
        if found is None:
            first_column, first_row, last_column, last_row = block
            cells = product(range(first_column, last_column + 1), range(first_row, last_row + 1))
            numbers = sorted({each for cell in cells for each in self._cells.get(cell, ())})
            found = self._blocks[block] = [(*self._rectangles[each], each) for each in numbers]
        return found

    def around(self, x_m: float, y_m: float, reach_m: float) -> list[tuple[float, int]]:
        """Distances from a point to the rectangles within reach, and whose they are, nearest first."""
        low_x, low_y, high_x, high_y = x_m - reach_m, y_m - reach_m, x_m + reach_m, y_m + reach_m
        found: list[tuple[float, int]] = []
        for a, b, c, d, each in self._together(_block(low_x, low_y, high_x, high_y)):
            if a <= high_x and c >= low_x and b <= high_y and d >= low_y:
                aside_m = a - x_m if x_m < a else x_m - c if x_m > c else 0.0
                above_m = b - y_m if y_m < b else y_m - d if y_m > d else 0.0
                found.append((hypot(aside_m, above_m), each))
        return sorted(found)


def _block(low_x: float, low_y: float, high_x: float, high_y: float) -> tuple[int, int, int, int]:
    """First column, first row, last column and last row of the cells that a rectangle meets."""
    return floor(low_x / CELL_M), floor(low_y / CELL_M), floor(high_x / CELL_M), floor(high_y / CELL_M)
