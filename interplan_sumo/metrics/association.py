"""Which lanes hold a point over time: nuPlan's association of the ego's centre and corners with the lane graph.

A place is the tuple of lane or connector ids that hold a point: () off all
lanes, one lane, or one or more connectors that overlap there. What a place is
depends on the places before it, because inside an intersection only the past
tells which of the overlapping connectors is driven.

Rules and the 5 m of `KEPT_CONNECTOR_M` are nuPlan's (devkit 1.2.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads

Place = tuple[str, ...]
"""Ids of the lane, or of the overlapping connectors, that hold a point."""
CornerPlaces = tuple[Place, Place, Place, Place]
"""Places of the corners front left, rear left, rear right, front right."""

KEPT_CONNECTOR_M = 5.0
"""Inside an intersection, connectors of the frame before stay if they are nearer than this."""


@dataclass(frozen=True, eq=False)
class Containment:
    """Which lanes, connectors and intersections contain each of K points; edges are outside."""

    lanes: tuple[Place, ...]
    """Lanes per point, in map order; at most one on a sound map."""
    connectors: tuple[Place, ...]
    """Connectors per point, in map order."""
    in_intersection: NDArray[np.bool_]  # (K,)

    @classmethod
    def of(cls, roads: Roads, xy: Floats) -> Containment:
        """The containment of points (K, 2), all asked in one go."""
        points = np.atleast_1d(np.asarray(shapely.points(xy.reshape(-1, 2)), dtype=object))
        tree = shapely.STRtree(points)
        in_intersection = np.zeros(len(points), dtype=np.bool_)
        areas = [area.polygon for area in roads.intersections]
        if areas:
            in_intersection[tree.query(areas, predicate="contains")[1]] = True
        return cls(
            _holders(tree, tuple(roads.lanes), [lane.polygon for lane in roads.lanes.values()]),
            _holders(tree, tuple(roads.connectors), [c.polygon for c in roads.connectors.values()]),
            in_intersection,
        )

    def holds(self, lane_id: str, point: int) -> bool:
        """Whether a lane or connector contains a point."""
        return lane_id in self.lanes[point] or lane_id in self.connectors[point]

    def found(self, point: int) -> Place:
        """What a search of the map gives, without a past: the lane, else all connectors, else nothing."""
        return self.lanes[point][:1] or self.connectors[point]


def _holders(
    tree: shapely.STRtree, ids: tuple[str, ...], polygons: Sequence[shapely.Polygon]
) -> tuple[tuple[str, ...], ...]:
    """Per point of the tree, the ids whose polygon contains it, in the order of `ids`."""
    holders: list[Place] = [()] * len(tree.geometries)
    if polygons:
        which, points = tree.query(polygons, predicate="contains")
        for polygon, point in sorted(zip(which.tolist(), points.tolist(), strict=True)):
            holders[point] = (*holders[point], ids[polygon])
    return tuple(holders)


def centre_places(roads: Roads, inside: Containment, xy: Floats) -> tuple[Place, ...]:
    """The place of a moving point (N, 2) in each frame; its positions are the first N points of `inside`."""
    places: list[Place] = []
    for frame in range(len(xy)):
        before = places[-1] if places else ()
        place = _continued(roads, inside, before, frame)
        if not place:
            place = inside.found(frame)
            if frame > 1 and before and before[0] in roads.connectors:
                lost = not place and bool(inside.in_intersection[frame])
                if lost or (place and place[0] in roads.connectors):
                    at = shapely.Point(xy[frame])
                    near = (c for c in before if shapely.distance(roads[c].polygon, at) < KEPT_CONNECTOR_M)
                    place = tuple(near) or place
        places.append(place)
    return _resolved(roads, places)


def _continued(roads: Roads, inside: Containment, candidates: Place, point: int) -> Place:
    """The candidates that still hold the point, or the successors of a single candidate that do."""
    kept = tuple(c for c in candidates if inside.holds(c, point))
    if not kept and len(candidates) == 1:
        kept = tuple(c for c in roads.outgoing(candidates[0]) if inside.holds(c, point))
    return kept


def _resolved(roads: Roads, places: list[Place]) -> tuple[Place, ...]:
    """Ambiguous connectors thinned from the end backwards: what comes later tells what was driven."""
    resolved = list(places)
    for earlier in range(len(places) - 2, -1, -1):
        here, later = resolved[earlier], resolved[earlier + 1]
        if len(here) < 2:
            continue
        if len(here) > len(later) and set(later) <= set(here):
            resolved[earlier] = later  # nothing later leaves nothing here: nuPlan's rule, taken literally
        elif later and later[0] in roads.lanes:
            leading = tuple(c for c in here if roads.outgoing(c)[0] == later[0])
            resolved[earlier] = leading or here
    return tuple(resolved)


def corner_places(roads: Roads, inside: Containment, points: Sequence[Sequence[int]]) -> tuple[CornerPlaces, ...]:
    """The places of the four corners in each frame; `points` holds their rows in `inside`, frame by frame.

    A corner may be in anything that held any corner one frame before. On the
    second frame what one corner finds on the map is offered to the next ones
    too, a quirk of nuPlan that decides which overlapping connectors it lists.
    """
    frames: list[CornerPlaces] = []
    for frame, rows in enumerate(points):
        candidates: Place = tuple(dict.fromkeys(c for place in frames[-1] for c in place)) if frames else ()
        corners: list[Place] = []
        for point in rows:
            place = _continued(roads, inside, candidates, point)
            if not place:
                place = inside.found(point)
                if frame == 1:
                    candidates = tuple(dict.fromkeys((*candidates, *place)))
            corners.append(place)
        frames.append((corners[0], corners[1], corners[2], corners[3]))
    return tuple(frames)


def shared_lanes(roads: Roads, corners: CornerPlaces) -> frozenset[str] | None:
    """The lanes that hold the whole body: common to all corners, or joining those of the rear and the front.

    Empty where no corner is in a lane, None where only some are, or where their
    lanes do not continue each other (astride).
    """
    if not any(corners):
        return frozenset()
    if not all(corners):
        return None
    front_left, rear_left, rear_right, front_right = (set(place) for place in corners)
    common = front_left & rear_left & rear_right & front_right
    if common:
        return frozenset(common)
    after_left = rear_left.union(*(roads.outgoing(c) for c in rear_left))
    after_right = rear_right.union(*(roads.outgoing(c) for c in rear_right))
    if not (after_right & rear_left or after_left & rear_right):
        return None
    before_left = front_left.union(*(roads.incoming(c) for c in front_left))
    before_right = front_right.union(*(roads.incoming(c) for c in front_right))
    return frozenset((before_left & after_right) & (before_right & after_left)) or None


def body_lanes(roads: Roads, corners: Sequence[CornerPlaces]) -> tuple[frozenset[str] | None, ...]:
    """`shared_lanes` of every frame; frames with equal corners are worked out once."""
    known: dict[CornerPlaces, frozenset[str] | None] = {}
    for places in corners:
        if places not in known:
            known[places] = shared_lanes(roads, places)
    return tuple(known[places] for places in corners)


def runs(places: Sequence[object]) -> list[tuple[int, int]]:
    """Start and end (exclusive) of each stretch of equal neighbours."""
    if not places:
        return []
    cuts = [0, *(i + 1 for i, (a, b) in enumerate(pairwise(places)) if a != b), len(places)]
    return list(pairwise(cuts))
