"""Smooth centre lines: the kinks of a file's polylines, spread so that a car can follow."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded

from interplan_sumo.maps.importers.cross_sections import SPACING_M
from interplan_sumo.world.geometry import Floats, Polyline

FARTHEST_M = 0.18
"""No vertex is moved further than this: the line stays in the middle of its lane."""
FARTHEST_IN_JUNCTION_M = 0.8
"""Ways through intersections have more room, and begin and end with the sharpest kinks."""
STIFFNESS = 100.0
"""What a second difference costs against a displacement (Whittaker's smoothing, 1923). With vertices 0.9 m apart, waves
of 18 m are halved, longer ones pass, and a bend of 8 m radius narrows by 0.13 m."""
_PINNED = 1e9
_ROUNDS = 6
"""How often vertices that would move too far are held more firmly before they are simply held back."""
_LEAD = 3  # vertices of a neighbour that tell its direction


def smoothed(
    line: Polyline, before: Polyline | None = None, after: Polyline | None = None, farthest_m: float = FARTHEST_M
) -> Polyline:
    """The line without kinks, between the same ends.

    With `before` or `after` it leaves and arrives in their direction. Vertices
    should be evenly spaced, about 0.9 m apart, and move by `farthest_m` at most.
    """
    lead, tail = _near(before, at_end=True), _near(after, at_end=False)
    points = np.concatenate((lead, line.points, tail))
    inner = slice(len(lead) + 1, len(points) - len(tail) - 1)
    if len(points) < 4 or inner.start >= inner.stop:
        return line
    weight = np.full(len(points), _PINNED)
    weight[inner] = 1.0
    origin = points[0]
    by = np.zeros_like(points)
    away_m = np.zeros(len(points))
    for _ in range(_ROUNDS):
        moved = solveh_banded(_bands(weight), weight[:, None] * (points - origin), lower=True) + origin
        by[inner] = (moved - points)[inner]
        away_m = np.hypot(*by.T)
        if away_m.max() <= farthest_m:
            break
        weight[inner] *= np.maximum(1.0, away_m[inner] / farthest_m) ** 2
    by *= np.minimum(1.0, farthest_m / np.maximum(away_m, 1e-9))[:, None]
    return Polyline((points + by)[len(lead) : len(points) - len(tail)])


def _bands(weight: Floats) -> Floats:
    """(3, N) the lower bands of the normal equations: weights and second differences."""
    count = len(weight)
    bands = np.zeros((3, count))
    bands[0] = weight
    for k, (diagonal, beside) in enumerate(((1.0, -2.0), (4.0, -2.0), (1.0, 0.0))):
        bands[0, k : count - 2 + k] += STIFFNESS * diagonal
        bands[1, k : count - 2 + k] += STIFFNESS * beside
    bands[2, : count - 2] += STIFFNESS
    return bands


def _near(line: Polyline | None, *, at_end: bool) -> Floats:
    """(N, 2) points of a neighbour near the joint, in its order, without the joint itself."""
    if line is None:
        return np.zeros((0, 2))
    step_m = min(SPACING_M, line.length_m / _LEAD)
    arcs = step_m * np.arange(1, _LEAD + 1)
    return line.poses_at(line.length_m - arcs[::-1] if at_end else arcs)[:, :2]
