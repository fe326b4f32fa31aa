"""Obstacles over path and time: a candidate path with all who will be on it, by what can be done about each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.neighbours import together
from interplan_planners.common.occupancy import StripOccupancy, occupancy
from interplan_planners.foresight.candidate_paths import Base, CandidatePath
from interplan_planners.foresight.prediction import MOVING_MPS, STEP_S, PredictedTraffic
from interplan_planners.foresight.scene import PlanningScene
from interplan_planners.foresight.unseen import HiddenPlaces, oncoming_unseen
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import Floats

SIDE_MARGIN_M, PEDESTRIAN_MARGIN_M = 0.15, 0.7
"""Kept to both sides of the ego's box when it is asked who is in the way; the first is less than the clearance with
which things that stand are passed."""
LANE_MARGIN_M = -0.25
"""Who is beside the ego's way along a lane by this much less than its width drives on that lane."""
PEDESTRIAN_GAP_M = 1.5
"""Kept to people besides the usual gap."""
ALONG_COS = 0.6
"""Who moves along the candidate with at least this share of its speed is followed rather than let across."""
ONCOMING_MPS, ONCOMING_MARGIN_M = 1.0, 0.5
"""Who comes towards the ego faster than that; and it brakes for a side that reaches over the middle of the road and is
no farther beside its own."""
BEHIND_M = 45.0
"""Whoever is farther behind in a lane that the ego changes to does not matter."""
ENTRY_STEP_M, NEAR_BORDER_M = 0.25, 0.25
"""How finely it is asked where the ego comes into a lane; and who is so near to its border may be in it for others."""
RELEASE_S = 0.2
"""Kept after somebody has left the candidate before the ego goes on."""
MOST_CONTENDERS = 5


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """One candidate and its actors: B of them at K + 1 instants, by arc length of the candidate's path."""

    candidate: CandidatePath
    arc_m: float
    """Of the ego's rear axle."""
    limit_mps: Floats
    """(S,) for each metre."""
    stops_m: tuple[float, ...]
    """Arc lengths that the front bumper must not pass."""
    near_m: Floats  # (B, K + 1) inf where absent
    far_m: Floats  # (B, K + 1)
    center_m: Floats  # (B, K + 1)
    speed_mps: Floats  # (B, K + 1) along the candidate
    leads: NDArray[np.bool_]  # (B, K + 1) who is followed when ahead
    doubtful: NDArray[np.bool_]  # (B,) who stands and may stay, or go on
    strip: NDArray[np.bool_]  # (B,) who is in the strip that the ego sweeps: can be hit
    walks: NDArray[np.bool_]  # (B,) who is on foot in that strip, and may stop there or go on
    forced: NDArray[np.bool_]  # (B,) who comes towards the ego and brakes where it reaches over the middle of the road
    follower: NDArray[np.bool_]  # (B,) who comes along the lane that the ego changes to
    eager: NDArray[np.bool_]  # (B,) who is forecast to go on accelerating hard
    enters_m: tuple[float, float]
    """Arc lengths from which on the ego is near the border of that lane, and reaches over it; infinite if never."""
    unseen: tuple[Floats, Floats] | None
    """Near and far ends (K + 1,) of those who may come towards the ego from where it cannot see."""
    hidden: HiddenPlaces | None
    """Where somebody may come from behind on the lane that the ego changes to whom others hide."""
    yield_near_m: Floats  # (C, K + 1) contenders: where the ego would wait for them, inf once they are past
    yield_speed_mps: Floats  # (C, K + 1)
    yield_merges: NDArray[np.bool_]  # (C,) who is got behind, rather than let across


@dataclass(frozen=True, slots=True, eq=False)
class _Contender:
    """Somebody to whom the ego may give way."""

    when_s: float
    """It matters from then on: orders contenders."""
    near_m: Floats  # (K + 1,)
    speed_mps: Floats  # (K + 1,)
    merges: bool


def occupied_base(
    base: Base, traffic: PredictedTraffic, shape: EgoShape, stretch: tuple[float, float]
) -> StripOccupancy:
    """Who drives on the line of a base."""
    return occupancy(base.path, 0.5 * shape.width_m + LANE_MARGIN_M, traffic.forecast, stretch)


def staged(
    candidate: CandidatePath,
    arc_m: float,
    limit_mps: Floats,
    stops_m: Sequence[float],
    scene: PlanningScene,
    tail: NDArray[np.bool_],
    reach_m: float,
    beside: StripOccupancy | None,
    hidden: HiddenPlaces | None = None,
) -> Stage:
    """A candidate and its actors.

    `tail` (A,) are those who come behind the ego in its own lane: they follow
    it. `beside` are those on the lane that the candidate enters, by the
    candidate's arc lengths, and `hidden` where more may be.
    """
    traffic, shape = scene.traffic, scene.shape
    forecast, actors = traffic.forecast, traffic.actors
    on = _occupied(candidate, arc_m, traffic, tail, shape, reach_m)
    count = len(on.rows)
    if beside is not None:
        # who stands is in the strip or not in the way, and who rides a bicycle is passed while it drives
        rides = (actors.kind == ActorKind.BICYCLE) & np.isin(actors.ids, candidate.around)
        on = together(on, _only(beside, ~(tail | forecast.stands | rides)[beside.rows]))
    strip, towards = np.arange(len(on.rows)) < count, len(on.rows)
    if candidate.over_m < inf:
        on = together(on, _towards(candidate, traffic, shape))
        strip = np.append(strip, np.zeros(len(on.rows) - towards, dtype=np.bool_))
    forced = np.arange(len(on.rows)) >= towards
    present = np.isfinite(on.near_m)
    first = present.argmax(axis=1)
    rows = np.arange(len(on.rows))
    total_mps = np.maximum(np.abs(forecast.speed_mps[on.rows]), 1e-3)
    entering_mps = on.speed_mps[rows, first]
    people = actors.kind[on.rows] == ActorKind.PEDESTRIAN
    along = (entering_mps > ALONG_COS * total_mps[rows, first]) & ~people
    still = forecast.stands[on.rows] | (total_mps.max(axis=1, initial=0.0) < MOVING_MPS)
    unseen = oncoming_unseen(candidate, arc_m, present.shape[1]) if candidate.oncoming else None

    front_m, rear_m = arc_m + shape.front_m, arc_m - (shape.length_m - shape.front_m)
    moving = _Moving(on, present, first, entering_mps, along, still, people, strip)
    found = [*_merging(moving, arc_m, rear_m, shape), *_crossing(moving, candidate, front_m)]
    if unseen is not None and np.isfinite(unseen[0]).any() and unseen[0].min() > front_m - 0.3:
        waits_m = np.full(present.shape[1], unseen[0].min())
        found.append(_Contender(-1.0, waits_m, np.zeros(present.shape[1]), False))
    found = sorted(found, key=lambda contender: contender.when_s)[:MOST_CONTENDERS]
    nobody = [np.zeros((0, present.shape[1]))]
    return Stage(
        candidate, arc_m, limit_mps, tuple(stops_m), on.near_m, on.far_m, on.center_m, on.speed_mps,
        present & (along | still)[:, None], scene.doubtful[on.rows], strip, people & strip & ~still, forced,
        along & ~strip & ~forced,
        traffic.eager[on.rows], _enters_m(candidate, arc_m, shape), unseen, hidden,
        np.concatenate([contender.near_m[None] for contender in found] or nobody),
        np.concatenate([contender.speed_mps[None] for contender in found] or nobody),
        np.array([contender.merges for contender in found], dtype=np.bool_),
    )  # fmt: skip


def _enters_m(candidate: CandidatePath, arc_m: float, shape: EgoShape) -> tuple[float, float]:
    """Where the rear axle is on a candidate when a corner of the ego's front comes to the border of the new lane."""
    new, old = candidate.new, candidate.old or candidate.base
    if new is None:
        return inf, inf
    arcs = np.arange(arc_m, max(candidate.merged_m, arc_m) + ENTRY_STEP_M, ENTRY_STEP_M)
    poses = candidate.path.line.poses_at(arcs)
    cos_h, sin_h, half_m = np.cos(poses[:, 2]), np.sin(poses[:, 2]), 0.5 * shape.width_m
    x_m, y_m = poses[:, 0] + shape.front_m * cos_h, poses[:, 1] + shape.front_m * sin_h
    sides = [new.path.project(x_m - side * sin_h, y_m + side * cos_h)[1] for side in (-half_m, half_m)]
    away_m = np.minimum(np.abs(sides[0]), np.abs(sides[1]))
    here = old.line.pose_at(old.line.project_point(float(x_m[0]), float(y_m[0]))[0])
    apart_m = new.line.project_point(here.x_m, here.y_m)[1] if new is not old else candidate.offset_m
    border_m = 0.5 * abs(apart_m)
    near, over = away_m < border_m + NEAR_BORDER_M, away_m < border_m
    return float(arcs[near.argmax()]) if near.any() else inf, float(arcs[over.argmax()]) if over.any() else inf


def _occupied(
    candidate: CandidatePath,
    arc_m: float,
    traffic: PredictedTraffic,
    tail: NDArray[np.bool_],
    shape: EgoShape,
    reach_m: float,
) -> StripOccupancy:
    """Who is in the strip that the ego sweeps; it is wider for people who walk."""
    actors, half_m = traffic.actors, 0.5 * shape.width_m
    stretch = (arc_m - 8.0, arc_m + reach_m)
    walking = (actors.kind == ActorKind.PEDESTRIAN) & (actors.speed_mps > MOVING_MPS)
    # the strip is the rear axle's way; what the front passes before that is off it, the close look judges
    out = tail | np.isin(actors.ids, candidate.around) if candidate.late else tail
    on = occupancy(candidate.path, half_m + SIDE_MARGIN_M, traffic.forecast, stretch, ignore=out | walking)
    if not walking.any():
        return on
    return together(
        on, occupancy(candidate.path, half_m + PEDESTRIAN_MARGIN_M, traffic.forecast, stretch, ignore=out | ~walking)
    )


def _towards(candidate: CandidatePath, traffic: PredictedTraffic, shape: EgoShape) -> StripOccupancy:
    """Who comes towards the ego where it reaches over the middle of the road, and near enough to brake for its side."""
    actors, path = traffic.actors, candidate.path
    s, _ = path.project(actors.x_m, actors.y_m)
    against = np.cos(actors.heading_rad - path.line.poses_at(s)[:, 2]) < -ALONG_COS
    comes = against & (actors.kind == ActorKind.VEHICLE) & (actors.speed_mps > ONCOMING_MPS)
    half_m, over = 0.5 * shape.width_m + ONCOMING_MARGIN_M, (candidate.over_m, candidate.back_m)
    return occupancy(path, half_m, traffic.forecast, over, ignore=~comes)


@dataclass(frozen=True, slots=True, eq=False)
class _Moving:
    """Who is on a candidate, and how; (B,) but for the first two."""

    on: StripOccupancy
    present: NDArray[np.bool_]  # (B, K + 1)
    first: NDArray[np.int64]
    """The instant at which it is there first."""
    entering_mps: Floats
    """Its speed along the candidate then."""
    along: NDArray[np.bool_]
    still: NDArray[np.bool_]
    people: NDArray[np.bool_]
    strip: NDArray[np.bool_]


def _merging(moving: _Moving, arc_m: float, rear_m: float, shape: EgoShape) -> Iterator[_Contender]:
    """Those who come along the candidate, or beside it, and are not ahead yet: the ego may get behind them."""
    on, present = moving.on, moving.present
    time_s = STEP_S * np.arange(present.shape[1])
    alongside = frozenset(on.rows[~moving.strip].tolist())  # it is there that they are met
    for b in np.flatnonzero(moving.along & ~moving.still & present.any(axis=1)).tolist():
        k, in_strip = int(moving.first[b]), bool(moving.strip[b])
        if present[b, 0] and on.center_m[b, 0] > arc_m + 0.5 * shape.length_m:
            continue
        if (in_strip and int(on.rows[b]) in alongside) or (not in_strip and on.far_m[b, 0] < rear_m - BEHIND_M):
            continue
        before = time_s < time_s[k]
        extrapolated_m = on.near_m[b, k] - (time_s[k] - time_s) * moving.entering_mps[b]
        near_m = np.where(before, extrapolated_m, on.near_m[b])
        speed_mps = np.where(present[b], on.speed_mps[b], moving.entering_mps[b])
        # those who enter by the time until then, those who drive beside by how far behind they are
        later = in_strip and k > 0
        when_s = float(time_s[k]) if later else 0.05 * max(rear_m - float(on.far_m[b, k]), 0.0)
        yield _Contender(when_s, near_m, speed_mps, True)


def _crossing(moving: _Moving, candidate: CandidatePath, front_m: float) -> Iterator[_Contender]:
    """Those who cross the candidate or come towards the ego on it: it may wait before their way until they are past."""
    on, present = moving.on, moving.present
    instants = np.arange(present.shape[1])
    for b in np.flatnonzero(~moving.along & ~moving.still & present.any(axis=1)).tolist():
        wait_m = float(on.near_m[b].min())
        if moving.entering_mps[b] < -ONCOMING_MPS:
            # who noses into the oncoming lane stops those whom it waits for
            wait_m = min(wait_m, max(candidate.over_m, front_m + 0.3))
        if wait_m < front_m - 0.3:
            continue
        if moving.people[b]:
            wait_m = max(wait_m - PEDESTRIAN_GAP_M, min(wait_m, front_m + 0.5))
        last = int(np.flatnonzero(present[b])[-1])
        until = instants <= last + round(RELEASE_S / STEP_S)
        when_s = STEP_S * float(moving.first[b])
        yield _Contender(when_s, np.where(until, wait_m, np.inf), np.zeros(len(instants)), False)


def _only(on: StripOccupancy, keep: NDArray[np.bool_]) -> StripOccupancy:
    return StripOccupancy(on.rows[keep], on.near_m[keep], on.far_m[keep], on.center_m[keep], on.speed_mps[keep])
