"""Lines and rings of a file, freed of what makes them unusable."""

from __future__ import annotations

import numpy as np
import shapely

from interplan_sumo.world.geometry import Floats

_SAME_M = 1e-3
_SMALLEST_M2 = 0.01


def along(points: Floats) -> Floats:
    """(N, 2) the line without points that repeat the one before."""
    if len(points) < 2:
        return points
    return points[np.concatenate(([True], np.hypot(*np.diff(points, axis=0).T) > _SAME_M))]


def ring(points: Floats) -> shapely.Polygon | None:
    """The polygon of a ring (N, 2), open or closed; the largest part of one that crosses itself, None of a flat one."""
    if len(points) < 3:
        return None
    shape = shapely.Polygon(points)
    parts = shapely.get_parts(shapely.make_valid(shape)) if not shape.is_valid else [shape]
    polygons = [part for part in parts if isinstance(part, shapely.Polygon) and part.area > _SMALLEST_M2]
    return max(polygons, key=lambda part: part.area, default=None)
