"""Hidden people: where somebody may step out from behind what stands beside the way, and how fast the ego may be there.

From behind whatever stands beside the way people come out at its far end. They are seen once the line of sight past
that corner opens on them; what is left of their way into the ego's is then soon walked. The ego is as fast as lets it
stop for whom it sees then, or be past before they are there, but no slower than it takes to get on at all.
"""

from __future__ import annotations

from math import inf

import numpy as np

from interplan_planners.foresight.candidate_paths import BRAKING_MPS2, CandidatePath
from interplan_planners.foresight.scene import PlanningScene
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


def cautious_limits(candidate: CandidatePath, arc_m: float, scene: PlanningScene) -> Floats:
    """(S,) the limits of a candidate, lowered before where people may step out; the ego's rear axle is at `arc_m`."""
    limit, shape, actors = candidate.limit_mps, scene.shape, scene.traffic.actors
    near = np.hypot(actors.x_m - scene.ego.x_m, actors.y_m - scene.ego.y_m) < SEEN_M
    hides = scene.stays & near & (actors.kind == ActorKind.VEHICLE)
    if candidate.kind == "pass" and (candidate.new is not None or candidate.over_m < inf):
        hides &= ~np.isin(actors.ids, candidate.around)  # to be slow on a lane of others has a price of its own
    rows = np.flatnonzero(hides)
    if not rows.size:
        return limit
    corners = actors.corners[rows]
    s, d = (of.reshape(-1, 4) for of in candidate.path.project(corners[..., 0].ravel(), corners[..., 1].ravel()))
    first_m, last_m, away_m = s.min(axis=1), s.max(axis=1), np.abs(d).min(axis=1)
    # who stands close behind in the same row closes the way out
    left, next_m = d.mean(axis=1) > 0.0, last_m[:, None] + BETWEEN_M
    closed = (left[:, None] == left) & (first_m > first_m[:, None]) & (first_m < next_m) & (last_m > last_m[:, None])
    most_mps = np.maximum(safe_mps(away_m, 0.5 * shape.width_m, shape.front_m), LEAST_MPS)
    matters = (last_m > arc_m) & (last_m - first_m > SHORTEST_M) & ~closed.any(axis=1) & (most_mps < limit.max())
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
