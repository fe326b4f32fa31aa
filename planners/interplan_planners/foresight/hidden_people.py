"""Hidden people: where somebody may step out from behind what stands beside the way, and how fast the ego may be there.

From behind whatever stands beside the way people come out at its far end. They are seen once the line of sight past
that corner opens on them; what is left of their way into the ego's is then soon walked. The ego is as fast as lets it
stop for whom it sees then, or be past before they are there, but no slower than it takes to get on at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from interplan_planners.foresight.candidate_paths import BRAKING_MPS2, CandidatePath
from interplan_planners.foresight.scene import PlanningScene, corners_along
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats

SEEN_M = 80.0
"""What stands farther away is not thought of yet."""
WALK_MPS, BODY_M = 1.5, 0.3
"""How fast people step out, and half of their width."""
STEPS_OUT_M = 0.75
"""So far beyond the end of what hides them they walk."""
BETWEEN_M = 0.7
"""Through a narrower gap between what stands in a row nobody comes."""
ANSWERED_S, STOPPING_MPS2 = 0.3, 4.0
"""How the ego stops for them."""
LEAST_MPS, SPARE_M = 4.6, 2.5
"""It is never slower than that for people whom nobody has seen, and so slow this far before it need be."""
SHORTEST_M = 1.0
"""What is shorter hides nobody."""
ALONG_COS, STOPS_MPS2 = 0.5, 2.0
"""Of those who balk the ones that drive as the ego does count; and how they brake at least until they stand."""


@dataclass(frozen=True, slots=True, eq=False)
class Hiders:
    """Boxes that hide people, or will where they come to stand."""

    corners: Floats
    """(n, 4, 2) now."""
    goes_on_m: Floats
    """(n,) how far they go on until then."""
    stays: NDArray[np.bool_]
    """(n,) who stands there for good."""


def hiders_near(scene: PlanningScene) -> Hiders:
    """Vehicles near the ego that stay where they are, or balk: who brakes for nobody that is seen sees somebody."""
    actors, ego = scene.traffic.actors, scene.ego
    near = np.hypot(actors.x_m - ego.x_m, actors.y_m - ego.y_m) < SEEN_M
    with_ego = np.cos(actors.heading_rad - ego.heading_rad) > ALONG_COS
    rows = np.flatnonzero(near & (actors.kind == ActorKind.VEHICLE) & (scene.stays | (scene.balks & with_ego)))
    speed_mps, braking_mps2 = actors.speed_mps[rows], np.maximum(-scene.traffic.changes_mps2[rows], STOPS_MPS2)
    return Hiders(actors.corners[rows], speed_mps**2 / (2.0 * braking_mps2), scene.stays[rows])


def cautious_limits(candidate: CandidatePath, arc_m: float, scene: PlanningScene, hiders: Hiders) -> Floats:
    """(S,) the limits of a candidate, lowered before where people may step out; the ego's rear axle is at `arc_m`."""
    limit, shape = candidate.limit_mps, scene.shape
    if not len(hiders.corners):
        return limit
    s, d = corners_along(candidate.path, hiders.corners)
    first_m, last_m, away_m = s.min(axis=1), s.max(axis=1) + hiders.goes_on_m, np.abs(d).min(axis=1)
    # who stands close behind in the same row closes the way out
    left, next_m = d.mean(axis=1) > 0.0, last_m[:, None] + BETWEEN_M
    closed = (left[:, None] == left) & (first_m > first_m[:, None]) & (first_m < next_m) & (last_m > last_m[:, None])
    most_mps = np.maximum(safe_mps(away_m, 0.5 * shape.width_m, shape.front_m), LEAST_MPS)
    matters = (last_m > arc_m) & (last_m - first_m > SHORTEST_M) & ~closed.any(axis=1) & (most_mps < limit.max())
    matters &= hiders.stays | (away_m > 0.5 * shape.width_m)  # behind who drives before the ego nobody comes out
    if candidate.kind == "pass" and (candidate.new is not None or candidate.over_m < inf):
        # to be slow on a lane of others has a price of its own
        matters &= (last_m < candidate.leaves_m) | (last_m > candidate.settles_m)
    if not matters.any():
        return limit
    last_m, most_mps = last_m[matters, None], most_mps[matters, None]
    # arc lengths of the rear axle with the front bumper before the way out
    slow_m = last_m + STEPS_OUT_M - shape.front_m - stopping_m(most_mps) - SPARE_M
    metres = np.arange(len(limit))
    slow = np.sqrt(most_mps**2 + 2.0 * BRAKING_MPS2 * np.maximum(slow_m - metres, 0.0))
    return np.minimum(limit, np.where(metres < last_m - shape.front_m, slow, np.inf).min(axis=0))


def safe_mps(away_m: Floats, half_width_m: float, front_m: float) -> Floats:
    """(K,) up to which speed nobody is met who comes out beside something that is so far away from the candidate.

    People need a time t from where sight opens on them to the ego's way, and the ego r to answer before it brakes with
    b: up to 2 b (t - r) there is no place from which it can neither stop for them nor be past before them. Negative
    where they are there sooner than it can answer.
    """
    sight_m = stopping_m(LEAST_MPS) + front_m  # from the eye to the corner, about
    seen_m = away_m * (1.0 + STEPS_OUT_M / sight_m)
    walks_s = np.maximum(seen_m - half_width_m - BODY_M, 0.0) / WALK_MPS
    return 2.0 * STOPPING_MPS2 * (walks_s - ANSWERED_S)


def stopping_m(speed_mps: Floats | float) -> Floats | float:
    """The way to a stop."""
    return speed_mps * ANSWERED_S + speed_mps * speed_mps / (2.0 * STOPPING_MPS2)
