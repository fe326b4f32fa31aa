"""Narrow streets: edges of both directions on the same ground, on which cars wait for each other if SUMO knows."""

from __future__ import annotations

import numpy as np
import shapely

from interplan_sumo.maps.junctions import CAR_CORRIDOR_M
from interplan_sumo.maps.network_plan import NetworkPlan
from interplan_sumo.world.geometry import Floats

_ENDS_M = 5.0
"""The two edges begin and end no further apart than this along the street: SUMO counts positions from the other end."""
_SAMPLES = 9


def narrow_streets(plan: NetworkPlan) -> dict[str, str]:
    """Edge -> the oncoming edge on the same ground, both ways.

    SUMO calls two such edges `bidi`: a car enters one while no other one comes
    towards it on the other, and stops before one that does. Only edges of one
    lane each can be so, whose centre lines lie too close for two cars.
    """
    edges = [(edge.id, plan.points(edge.lanes[0])) for edge in plan.edges if len(edge.lanes) == 1]
    if len(edges) < 2:
        return {}
    lines = np.array([shapely.LineString(points) for _, points in edges])
    one, other = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=CAR_CORRIDOR_M)
    found: dict[str, str] = {}
    near: list[tuple[float, str, str]] = []
    for i, j in zip(one.tolist(), other.tolist(), strict=True):
        if i < j:
            apart_m = _apart_m(edges[i][1], edges[j][1])
            if apart_m < CAR_CORRIDOR_M:
                near.append((apart_m, edges[i][0], edges[j][0]))
    for _, here, there in sorted(near):
        if here not in found and there not in found:
            found[here], found[there] = there, here
    return found


def _apart_m(line: Floats, oncoming: Floats) -> float:
    """How far two lines lie apart in the mean, the second turned; infinite if they do not end at the same places."""
    turned = oncoming[::-1]
    if max(np.hypot(*(line[0] - turned[0])), np.hypot(*(line[-1] - turned[-1]))) > _ENDS_M + CAR_CORRIDOR_M:
        return float("inf")
    shares = np.linspace(0.0, 1.0, _SAMPLES)
    places = shapely.line_interpolate_point(shapely.LineString(line), shares, normalized=True)
    return float(shapely.distance(places, shapely.LineString(turned)).mean())
