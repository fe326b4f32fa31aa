"""Lines and rings of a file: freed of what makes them unusable, and boundaries beside the middle of a lane."""

from __future__ import annotations

import numpy as np
import shapely

from interplan_sumo.world.geometry import Floats

_SAME_M = 1e-3
_SMALLEST_M2 = 0.01
_LONGEST_MITRE = 4.0
"""A mitre may be so many times as long as the offset; sharper corners are cut off."""
_SHARES = (1.0, 0.75, 0.5, 0.25, 0.1)
"""Inside a turn that is tighter than the lane is wide, the boundary comes nearer to the middle."""
SHORTEST_M = 0.1
"""SUMO's least length of a lane. What is shorter has no direction: what leads to it leads to what follows it."""
TORN_M = 10.0
"""A link between lanes so far apart is a mistake of a file whose lanes meet."""


def along(points: Floats) -> Floats:
    """(N, 2) the line without points that repeat the one before."""
    if len(points) < 2:
        return points
    return points[np.concatenate(([True], np.hypot(*np.diff(points, axis=0).T) > _SAME_M))]


def length_m(points: Floats) -> float:
    """How long a line (N, 2) is."""
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def mean_length_m(left: Floats, right: Floats) -> float:
    """How long a lane between two boundaries (N, 2) is: as long as they are in the mean."""
    return (length_m(left) + length_m(right)) / 2.0


def ring(points: Floats) -> shapely.Polygon | None:
    """The polygon of a ring (N, 2), open or closed; the largest part of one that crosses itself, None of a flat one."""
    if len(points) < 3:
        return None
    shape = shapely.Polygon(points)
    parts = shapely.get_parts(shapely.make_valid(shape)) if not shape.is_valid else [shape]
    polygons = [part for part in parts if isinstance(part, shapely.Polygon) and part.area > _SMALLEST_M2]
    return max(polygons, key=lambda part: part.area, default=None)


def beside(middle: Floats, left_m: float) -> Floats:
    """(N, 2) a line `left_m` to the left of the line `middle` (M, 2), or to its right if negative.

    Corners are mitred. Where that would fold the line, as within a sharp bend
    of short segments, the folds are cut out, so that the line does not cross
    itself. `middle` must have two distinct points; N may differ from M.
    """
    for share in _SHARES:
        shifted = _mitred(middle, share * left_m)
        if _sound(shifted, middle):
            return shifted
        shifted = _without_folds(middle, share * left_m)
        if shifted is not None:
            return shifted
    return middle


def _normals(middle: Floats) -> Floats:
    """(N, 2) at each vertex, the shift that moves a line by one metre to its left, with mitred corners."""
    steps = np.diff(middle, axis=0)
    unit = steps / np.hypot(*steps.T)[:, None]
    left = np.stack((-unit[:, 1], unit[:, 0]), axis=1)
    before, after = np.concatenate((left[:1], left)), np.concatenate((left, left[-1:]))
    both = before + after
    size = (both * both).sum(axis=1)[:, None]
    mitre = 2.0 * both / np.maximum(size, 1e-12)
    length = np.hypot(*mitre.T)[:, None]
    return np.where(length > _LONGEST_MITRE, mitre * (_LONGEST_MITRE / np.maximum(length, 1e-12)), mitre)


def _mitred(middle: Floats, left_m: float) -> Floats:
    return middle + left_m * _normals(middle)


def _sound(line: Floats, middle: Floats) -> bool:
    """Whether no segment runs against its own of the middle, and the line crosses itself only if the middle does."""
    forward = (np.diff(line, axis=0) * np.diff(middle, axis=0)).sum(axis=1) > 0.0
    return bool(forward.all()) and (shapely.LineString(line).is_simple or not shapely.LineString(middle).is_simple)


def _without_folds(middle: Floats, left_m: float) -> Floats | None:
    """The offset line as shapely cuts it; None unless it runs from the offset start to the offset end."""
    ends = _mitred(middle, left_m)[[0, -1]]
    curve = shapely.offset_curve(shapely.LineString(middle), left_m, join_style="mitre", mitre_limit=_LONGEST_MITRE)
    if not isinstance(curve, shapely.LineString) or curve.is_empty:
        return None
    points = along(shapely.get_coordinates(curve))
    if len(points) < 2 or curve.length < SHORTEST_M or np.hypot(*(points[[0, -1]] - ends).T).max() > abs(left_m) / 2.0:
        return None
    return points
