"""The footprint of a lane: the band that a car on its centre line sweeps, and what stands in it."""

from __future__ import annotations

from collections.abc import Container

import numpy as np
import shapely

from interplan_sumo.simulation.lane_polygons import ClipArea, Ring
from interplan_sumo.simulation.network import HALF_FOOTPRINT_M, SumoNetwork

_TOUCH_M2 = 1e-6  # smaller areas are rounding
_CLEAR_M = HALF_FOOTPRINT_M + 0.05
"""So far from its line no footprint reaches: GEOS is off by a hundredth of the width at most."""


def keeps_clear(network: SumoNetwork, box: Ring, besides: Container[str], *, in_junctions: bool) -> bool:
    """Whether `lanes_overlapped` surely finds nothing: the quick way for most boxes, by distances alone."""
    return all(
        (piece.lane.internal and not in_junctions)
        or piece.lane.id in besides
        or piece.plain_line.keeps_off(box, _CLEAR_M)
        for piece in network.pieces_near(ClipArea.of(box))
    )


def lanes_overlapped(
    network: SumoNetwork,
    box: shapely.Polygon,
    besides: Container[str] = frozenset(),
    *,
    in_junctions: bool = False,
    to_the_edge: bool = False,
) -> dict[str, tuple[float, float]]:
    """Lanes whose footprint a box in SUMO's frame reaches into, `besides` and, usually, those in junctions left out.

    With SUMO's lane positions from where to where; sorted by place in the network file. `to_the_edge` takes the whole
    width of the lanes for their footprints.
    """
    pieces, tree = network.pieces
    found: dict[str, tuple[float, float]] = {}
    for hit in np.sort(tree.query(box, predicate="intersects")):
        piece = pieces[int(hit)]
        lane = piece.lane
        if (lane.internal and not in_junctions) or lane.id in besides:
            continue
        part = shapely.intersection(piece.polygon if to_the_edge else network.footprints[int(hit)], box)
        if shapely.area(part) < _TOUCH_M2:
            continue
        arcs, _ = piece.line.project(shapely.get_coordinates(part))
        start_m = lane.position_of(piece.start_m + float(arcs.min()))
        end_m = lane.position_of(piece.start_m + float(arcs.max()))
        before = found.get(lane.id, (start_m, end_m))
        found[lane.id] = (min(before[0], start_m), max(before[1], end_m))
    return found
