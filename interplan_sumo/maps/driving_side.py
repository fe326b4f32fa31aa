"""Which side traffic keeps to, as the boundaries of lanes show it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import DrivingSide

_MEDIAN_M = 12.0  # oncoming lanes that lie further apart are not of one road


def shown_side(left: Iterable[shapely.LineString], right: Iterable[shapely.LineString]) -> DrivingSide | None:
    """The driving side that left and right boundaries of lanes show, None if they show none.

    Oncoming lanes have their left boundaries next to each other, or in common,
    where traffic keeps right; their right boundaries where it keeps left.
    """
    kept_right_m, kept_left_m = _facing_m(left), _facing_m(right)
    if kept_left_m == kept_right_m:
        return None
    return "left" if kept_left_m > kept_right_m else "right"


def _facing_m(lines: Iterable[shapely.LineString]) -> float:
    """How much lines run beside opposing ones: over all pairs, the metres by which they are closer than a median."""
    shapes = np.array(list(lines), dtype=object)
    if not len(shapes):
        return 0.0
    middles = shapely.line_interpolate_point(shapes, 0.5, normalized=True)
    one, other = shapely.STRtree(shapes).query(middles, predicate="dwithin", distance=_MEDIAN_M)
    at = shapely.line_locate_point(shapes[other], middles[one], normalized=True)
    along, beside = _directions(shapes[one], np.full(len(one), 0.5)), _directions(shapes[other], at)
    opposed = (along * beside).sum(axis=1) < -0.9 * np.hypot(*along.T) * np.hypot(*beside.T)
    return round(float((_MEDIAN_M - shapely.distance(middles[one], shapes[other]))[opposed].sum()), 3)


def _directions(shapes: NDArray[np.object_], at: Floats) -> Floats:
    """(N, 2) directions of lines at shares of their lengths; how long these are means nothing."""
    ahead = shapely.line_interpolate_point(shapes, np.minimum(at + 0.02, 1.0), normalized=True)
    behind = shapely.line_interpolate_point(shapes, np.maximum(at - 0.02, 0.0), normalized=True)
    return shapely.get_coordinates(ahead) - shapely.get_coordinates(behind)
