"""The strip that a car sweeps along a path, and what stands in it."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.world.geometry import Polyline


class Corridor:
    """A path widened to both sides, indexed for many queries against boxes.

    At its end it reaches half its width farther, as nuPlan's does: a square cap.
    """

    def __init__(self, path: Polyline, half_width_m: float) -> None:
        self.path = path
        self.half_width_m = half_width_m

    @cached_property
    def _pieces(self) -> shapely.STRtree:
        """One quadrilateral per path segment; neighbours share an edge, so that bends leave no gaps."""
        points = self.path.points.copy()
        tangent = np.gradient(points, axis=0)
        tangent /= np.hypot(tangent[:, 0], tangent[:, 1])[:, None]
        points[-1] += self.half_width_m * tangent[-1]
        side = self.half_width_m * np.stack((-tangent[:, 1], tangent[:, 0]), axis=1)
        left, right = points + side, points - side
        corners = np.stack((left[:-1], left[1:], right[1:], right[:-1]), axis=1)
        # A hull is valid even where a kink folds the quadrilateral.
        return shapely.STRtree(np.asarray(shapely.convex_hull(shapely.multipoints(corners))))

    def occupied_m(self, shapes: NDArray[Any]) -> dict[int, tuple[tuple[float, float], ...]]:
        """For each of the shapes (N,) that touches the corridor, by its index: the stretches that it touches.

        A stretch is a start and an end arc length, in driving order; several
        where the path comes by again. Resolution is that of the path's vertices;
        what touches the cap alone is on the last segment.
        """
        arcs = self.path.arc_m
        touched: dict[int, list[int]] = {}
        for row, segment in self._pieces.query(shapes, predicate="intersects").T.tolist():
            touched.setdefault(row, []).append(segment)
        stretches: dict[int, tuple[tuple[float, float], ...]] = {}
        for row, segments in sorted(touched.items()):
            segments.sort()
            firsts = [s for k, s in enumerate(segments) if k == 0 or s != segments[k - 1] + 1]
            lasts = [s for k, s in enumerate(segments) if k == len(segments) - 1 or s != segments[k + 1] - 1]
            stretches[row] = tuple((float(arcs[a]), float(arcs[b + 1])) for a, b in zip(firsts, lasts, strict=True))
        return stretches
