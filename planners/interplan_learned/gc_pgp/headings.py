"""Headings: where a car points on its way through points, and when it stands."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.world.geometry import Floats

LEAST_END_M: Final = 0.2
"""A plan that ends less far ahead stands (PGP's)."""
LEAST_STEP_M: Final = 0.5
"""Points closer than this to the last one that counted say nothing of a heading (PGP's)."""


def with_headings(points: NDArray[Any]) -> Floats:
    """(N, 3) poses from points (N, 2) ahead of an ego at 0, 0 with heading 0; all 0 if it hardly moves."""
    path: Floats = np.concatenate((np.zeros((1, 2)), points.astype(np.float64)))
    knots = [0]
    for row in range(1, len(path)):
        if np.hypot(*(path[row] - path[knots[-1]])) >= LEAST_STEP_M:
            knots.append(row)
    if path[-1, 0] < LEAST_END_M or len(knots) < 2:
        return np.zeros((len(points), 3))
    from scipy.interpolate import CubicSpline  # a third of a second that only those who drive should wait

    held = path[knots]
    arc_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(held, axis=0).T))))
    ends: Any = ((1, (1.0, 0.0)), "not-a-knot")  # it begins straight ahead
    spline = CubicSpline(arc_m, held, bc_type=ends)
    tangents = spline(arc_m, 1)
    headings = np.arctan2(tangents[:, 1], tangents[:, 0])
    last = np.searchsorted(knots, np.arange(len(path)), side="right") - 1
    return np.concatenate((path, headings[last, None]), axis=1)[1:]
