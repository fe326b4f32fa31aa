"""Drivable area: did every corner of the ego stay on the road?"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.metrics.circumstances import ego_doing
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult, metric
from interplan_sumo.world.geometry import Floats

TOLERANCE_M = 0.3
"""nuPlan's: at this distance or more a corner has left the drivable area."""
CORNERS = ("front left", "rear left", "rear right", "front right")


def first_frame_off(_: Facts, result: MetricResult) -> int:
    """Where a corner is off the drivable area for the first time."""
    return int(np.argmax(result.series["outside_m"] >= TOLERANCE_M))


@metric(failure="drivable area left", lost_at=first_frame_off)
def drivable_area(facts: Facts) -> MetricResult:
    """1 if no corner is ever `TOLERANCE_M` or more outside, else 0.

    Inside is whoever is in a lane or connector, a road segment, an
    intersection, a car park or another drivable area. The distance is that to the lane of
    the ego's centre or to the nearest drivable polygon, whichever is less.
    """
    outside = corners_outside(facts)
    distance = np.zeros(outside.shape)
    distance[outside] = distance_outside_m(facts, outside)
    far = distance >= TOLERANCE_M
    score = 0.0 if far.any() else 1.0
    reason = None
    if far.any():
        frame = int(np.flatnonzero(far.any(axis=1))[0])
        corner = int(np.argmax(distance[frame]))
        farthest = distance[frame, corner]
        how_far = f"{farthest:.2f} m" if np.isfinite(farthest) else "far"
        where = f"{CORNERS[corner]} corner {how_far} off the drivable area at {facts.time_s[frame]:.1f} s"
        reason = f"{where}; the ego was {ego_doing(facts, frame)}"
    detail = {
        "all_corners_inside": not outside.any(),
        "frames_outside": int(far.any(axis=1).sum()),
        "farthest_m": float(distance.max(initial=0.0)),
    }
    inside: NDArray[np.bool_] = ~np.any(outside, axis=1)
    series = {"corners_inside": inside, "outside_m": distance.max(axis=1, initial=0.0)}
    return MetricResult(score, detail, series, reason)


def corners_outside(facts: Facts) -> NDArray[np.bool_]:
    """(N, 4) corners in no lane or connector and in no drivable polygon."""
    outside = np.array([[not place for place in corners] for corners in facts.corner_places], dtype=np.bool_)
    outside = outside.reshape(-1, 4)
    if outside.any():
        outside[outside] = ~facts.roads.drivable(facts.corners[outside])
    return outside


def distance_outside_m(facts: Facts, outside: NDArray[np.bool_]) -> Floats:
    """(K,) distance of the corners marked in `outside` (N, 4) to the drivable area or to the centre's lane."""
    if not outside.any():
        return np.zeros(0)
    xy = facts.corners[outside]
    distance = facts.roads.distance_to_drivable_m(xy)
    points = np.asarray(shapely.points(xy))
    places = [facts.places[frame] for frame in np.nonzero(outside)[0].tolist()]
    for lane_id in {lane_id for place in places for lane_id in place}:
        rows = np.array([lane_id in place for place in places], dtype=np.bool_)
        to_lane = shapely.distance(points[rows], facts.roads[lane_id].polygon)
        distance[rows] = np.minimum(distance[rows], to_lane)
    return distance
