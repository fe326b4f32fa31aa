"""Unseen: who may come from where the ego cannot see, towards it on the oncoming lane or behind it on the one beside.

Who drives behind others on the lane that the ego wants is seen late. Whether somebody does, nobody knows: so each place
that is hidden may have a car in it, as likely as in traffic that flows, and what it costs to enter before it is what
measured drivers would have to do there, times how likely that is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from interplan_planners.foresight.candidate_paths import Base, CandidatePath
from interplan_planners.foresight.prediction import STEP_S
from interplan_planners.foresight.scene import PlanningScene
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import Floats, wrap_angle

SIGHT_M = 97.0
"""From the rear axle: planners see 100 m around the ego's centre."""
UNSEEN_SHARE = 0.8
"""Of the limit: how fast somebody may come towards the ego who is not seen yet."""
PLACE_M, LOOKED_M = 5.0, 90.0
"""How finely it is asked behind the ego where somebody may be hidden, and as far as where."""
CAR_LENGTH_M, CAR_WIDTH_M = 4.6, 1.8
ONE_IN_M = 60.0
"""Of what is hidden of the lane each stretch as long as this has a car on it."""
HIDDEN_SHARE = 0.9
"""Of the limit: how fast it drives."""
CLEAR_M = 2.0
"""From who is seen on the lane, bumper to bumper: nobody is hidden nearer to them."""
_AHEAD, _LEFT = np.array((0.0, 0.5, 0.5, -0.5, -0.5)), np.array((0.0, 0.5, -0.5, -0.5, 0.5))


@dataclass(frozen=True, slots=True, eq=False)
class HiddenPlaces:
    """Where cars may be hidden that come from behind on a lane, by arc lengths of a path."""

    front_m: Floats
    """(P,) of their front bumpers now."""
    speed_mps: float

    def moved(self, by_m: float) -> HiddenPlaces:
        """The same by arc lengths of another path, on which they are so much farther."""
        return HiddenPlaces(self.front_m + by_m, self.speed_mps)


def oncoming_unseen(candidate: CandidatePath, arc_m: float, instants: int) -> tuple[Floats, Floats]:
    """Those who may come from the end of sight, the first of them at the speed limit: what they need of a candidate.

    Near and far ends (K + 1,) of it.
    """
    limit_mps = float(candidate.base.limit_mps[min(int(arc_m), len(candidate.base.limit_mps) - 1)])
    near_m = arc_m + SIGHT_M - UNSEEN_SHARE * limit_mps * STEP_S * np.arange(instants)
    comes = near_m < candidate.back_m  # and after the first there may be others
    return np.where(comes, np.maximum(near_m, candidate.over_m), np.inf), np.where(comes, candidate.back_m, -np.inf)


def hidden_places(scene: PlanningScene, base: Base, axle_m: float) -> HiddenPlaces:
    """Where on a base, behind a rear axle at an arc length of it, others would hide a car from the ego's centre."""
    shape, actors = scene.shape, scene.traffic.actors
    rear_m = axle_m - (shape.length_m - shape.front_m)
    front_m = np.arange(rear_m, max(rear_m - LOOKED_M, CAR_LENGTH_M), -PLACE_M)
    poses = base.line.poses_at(front_m - 0.5 * CAR_LENGTH_M)
    cosine, sine = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    x_m = poses[:, 0, None] + CAR_LENGTH_M * _AHEAD * cosine - CAR_WIDTH_M * _LEFT * sine
    y_m = poses[:, 1, None] + CAR_LENGTH_M * _AHEAD * sine + CAR_WIDTH_M * _LEFT * cosine
    out = behind_others(actors, x_m - scene.ego.x_m, y_m - scene.ego.y_m, (scene.ego.x_m, scene.ego.y_m)).all(axis=1)
    if out.any():
        s, d = base.path.project(actors.x_m, actors.y_m)
        on = np.abs(d) < 0.5 * (CAR_WIDTH_M + actors.width_m)
        reach_m = 0.5 * (CAR_LENGTH_M + actors.length_m[on]) + CLEAR_M
        out &= (np.abs(front_m[:, None] - 0.5 * CAR_LENGTH_M - s[on]) > reach_m).all(axis=1)
    limit_mps = float(base.limit_mps[min(max(int(rear_m), 0), len(base.limit_mps) - 1)])
    return HiddenPlaces(front_m[out], HIDDEN_SHARE * limit_mps)


def behind_others(actors: Actors, x_m: Floats, y_m: Floats, eye: tuple[float, float]) -> NDArray[np.bool_]:
    """(P, 5) which points (P, 5), relative to the eye, lie behind vehicles, by their bearings and how far they are."""
    rows = np.flatnonzero(actors.kind == ActorKind.VEHICLE)
    found = np.zeros(x_m.shape, dtype=np.bool_)
    if not rows.size or not x_m.size:
        return found
    to_x, to_y = actors.corners[rows, :, 0] - eye[0], actors.corners[rows, :, 1] - eye[1]  # (B, 4)
    center_x, center_y = actors.x_m[rows] - eye[0], actors.y_m[rows] - eye[1]
    away_m = np.hypot(center_x, center_y)
    clear = away_m > 0.5 * np.hypot(actors.length_m[rows], actors.width_m[rows])  # who overlaps the eye hides nobody
    towards = np.arctan2(center_y, center_x)
    edges = wrap_angle(np.arctan2(to_y, to_x) - towards[:, None])
    bearing = wrap_angle(np.arctan2(y_m, x_m)[..., None] - towards)  # (P, 5, B)
    within = (bearing > edges.min(axis=1)) & (bearing < edges.max(axis=1)) & clear
    return np.any(within & (np.hypot(x_m, y_m)[..., None] > np.hypot(to_x, to_y).max(axis=1)), axis=-1)


def fronts_then(
    places: HiddenPlaces, at: NDArray[np.int64], seen_near_m: Floats, seen_center_m: Floats, seen_mps: Floats
) -> tuple[Floats, Floats, Floats]:
    """Fronts and speeds (n, P) of hidden cars at instants (n,), and (n, P) the centre of whoever is seen ahead of each.

    Those who are seen on the lane are (b, K + 1); hidden ones stay behind them. Infinite where nobody is seen ahead.
    """
    front_m = places.front_m + places.speed_mps * STEP_S * at[:, None]
    speed_mps = np.full(front_m.shape, places.speed_mps)
    before_m = np.full(front_m.shape, np.inf)
    if len(seen_near_m):
        ahead = seen_center_m[:, :1] > places.front_m  # (b, P)
        first = np.where(ahead, seen_center_m[:, :1], np.inf).argmin(axis=0)
        any_ahead = ahead.any(axis=0)
        near_m, then_mps = seen_near_m[first][:, at].T - CLEAR_M, seen_mps[first][:, at].T
        before_m = np.where(any_ahead, seen_center_m[first][:, at].T, np.inf)
        held = any_ahead & (near_m < front_m)
        front_m, speed_mps = np.where(held, near_m, front_m), np.where(held, np.maximum(then_mps, 0.0), speed_mps)
    return front_m, speed_mps, before_m


def comes_next(front_m: Floats, before_m: Floats, rear_m: Floats, shape: EgoShape) -> NDArray[np.bool_]:
    """(n, P) whether a hidden car is next behind the ego, whose rear is at (n,): nobody who is seen is between them."""
    middle_m = rear_m[:, None] + 0.5 * shape.length_m
    return (front_m < middle_m) & (before_m > middle_m)
