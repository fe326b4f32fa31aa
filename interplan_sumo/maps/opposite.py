"""Two-way roads: which inner lanes run beside the inner lane of the other direction."""

from __future__ import annotations

import numpy as np
import shapely

from interplan_sumo.maps.network_plan import NetworkPlan

_BESIDE_M = 4.5
"""Inner lanes further apart than this have a median or a turn lane between them."""
_LENGTH_SHARE = 0.02
"""SUMO counts positions on the other lane from its far end: edges that differ by more stay strangers."""
_END_M = 2.0


def opposite_lanes(plan: NetworkPlan) -> dict[str, str]:
    """SUMO lane -> the lane of the oncoming direction beside it, both ways.

    Only where the two edges cover the same stretch of road from end to end.
    """
    inner = [(f"{edge.id}_{len(edge.lanes) - 1}", edge, plan.points(edge.lanes[-1])) for edge in plan.edges]
    inner = [item for item in inner if item[1].lanes[-1].length_m > 4 * _END_M]
    if not inner:
        return {}
    middles = np.array([shapely.LineString(points).interpolate(0.5, normalized=True) for _, _, points in inner])
    tree = shapely.STRtree([shapely.LineString(points) for _, _, points in inner])
    found: dict[str, str] = {}
    for i, j in zip(*tree.query(middles, predicate="dwithin", distance=_BESIDE_M), strict=True):
        a, b = inner[int(i)], inner[int(j)]
        if i < j and a[0] not in found and b[0] not in found:
            lengths = a[1].lanes[-1].length_m, b[1].lanes[-1].length_m
            if abs(lengths[0] - lengths[1]) > _LENGTH_SHARE * min(lengths):
                continue
            ends = (a[2][0] - b[2][-1], a[2][-1] - b[2][0])
            along = a[2][-1] - a[2][0]
            if all(np.hypot(*end) < _BESIDE_M + _END_M for end in ends) and float(along @ (b[2][-1] - b[2][0])) < 0.0:
                found[a[0]], found[b[0]] = b[0], a[0]
    return found
