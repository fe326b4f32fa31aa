"""Numbers for a page: whole ones, and differences where neighbours are alike; a browser undoes both.

Coordinates are centimetres from the origin of the page, angles thousandths of
a radian. A column is its first value and the differences to the next ones; one
that never changes is its first value only.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely
from numpy.typing import ArrayLike

from interplan_sumo.world.geometry import Floats

PER_METRE: Final = 100
PER_RADIAN: Final = 1000
PER_UNIT: Final = 100
"""Of series, whatever their unit."""

Whole = list[int]


def column(values: ArrayLike, per_unit: int) -> Whole:
    """Values (N,) as whole numbers of 1 / `per_unit`: the first one and the differences, or one if all are equal."""
    whole = np.round(np.asarray(values, dtype=np.float64) * per_unit).astype(np.int64)
    steps = np.diff(whole, prepend=0)
    return steps[: 1 if not steps[1:].any() else None].tolist()


def angles(values_rad: Floats) -> Whole:
    """Headings (N,) as a column; neighbours differ by less than half a turn."""
    return column(np.unwrap(values_rad), PER_RADIAN)


def points(xy: Floats, origin: Floats) -> Whole:
    """Points (N, 2) of the map as x, y of the first and the differences x, y to each next one."""
    whole = np.round((np.asarray(xy) - origin) * PER_METRE).astype(np.int64)
    return np.diff(whole, axis=0, prepend=[[0, 0]]).reshape(-1).tolist()


def series(values: Floats) -> list[int | None]:
    """Values (N,) as whole numbers of 1 / `PER_UNIT`; None where a value is not finite."""
    whole = np.round(values * PER_UNIT)
    return [int(value) if np.isfinite(value) else None for value in whole.tolist()]


def rings(geometries: Sequence[shapely.Geometry], origin: Floats) -> list[list[Whole]]:
    """The polygons among geometries, each as its rings, the outer one first, without the closing point."""
    found: list[list[Whole]] = []
    for part in shapely.get_parts(np.asarray(geometries, dtype=object)):
        if isinstance(part, shapely.Polygon) and not part.is_empty:
            edges = (part.exterior, *part.interiors)
            found.append([points(shapely.get_coordinates(edge)[:-1], origin) for edge in edges])
    return found


def lines(geometries: Sequence[shapely.Geometry], origin: Floats) -> list[Whole]:
    """The lines among geometries."""
    parts = shapely.get_parts(np.asarray(geometries, dtype=object))
    return [
        points(shapely.get_coordinates(part), origin)
        for part in parts
        if isinstance(part, shapely.LineString) and not part.is_empty
    ]
