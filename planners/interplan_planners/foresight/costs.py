"""Costs of drafts: progress, comfort, and what comes of those who are in the way; in points of progress."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from interplan_planners.foresight.drivers import REACTION_S, answers_mps2, minded
from interplan_planners.foresight.hidden_people import ANSWERED_S
from interplan_planners.foresight.prediction import STEP_S
from interplan_planners.foresight.speeds import Drafts
from interplan_planners.foresight.st_obstacles import Stage
from interplan_planners.foresight.unseen import ONE_IN_M, PLACE_M, HiddenPlaces, comes_next, fronts_then
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import Floats, Ints

PROGRESS = 10.0
"""Points for the distance that the limit allows."""
WHOLE_SHARE, HALF_SHARE = 0.8, 0.4
"""How much of them the whole way counts, and how much the way at half-time: the sooner, the better."""
SLOWEST_REFERENCE_MPS = 3.0
HIT, HIT_FADES_S = 120.0, 6.0
"""For running into somebody, now; it fades with the time until then, for forecasts get worse."""
PAUSES, PAUSE_MPS2, SPARE_M = 20.0, (3.0, 6.0), 0.5
"""Per second in which the ego could not stop for somebody on foot before it who stopped then: this time later and that
far away, it takes no more than the first deceleration, and cannot with more than the second."""
UNSEEN = 16.0
"""For being in the way of somebody who may come from where the ego cannot see."""
CLOSE, CLOSE_FRONT_S, CLOSE_M = 2.5, 0.35, 0.8
"""For coming near somebody, and what is near: a time ahead and a distance on all sides."""
EFFORT = 0.12
"""Per squared acceleration, on average."""
HARD, HARD_MPS2 = 6.0, 3.9
"""For braking harder than passengers accept."""
FORCED = 40.0
"""For making everybody brake hard who could be behind, or whoever comes towards the ego."""
SOON_S = 2.0
"""So long it matters that some drivers accelerate harder than others; and how soon an entry has to be to be asked what
those do who are not seen."""
IN_ALREADY_M = 0.3
"""Who comes into a lane on less than this of its way is in it."""
NOBODY_M = 1e3
"""So far behind is nobody."""
ASTRIDE = 15.0
"""For reaching into a lane and not being in it within the horizon."""
SHORT, TIGHT, TIGHT_M = 5.0, 30.0, 1.6
"""Per metre that the gap ahead falls short when the ego is in the new lane; it should be `GAP_M` and `GAP_S` of the
ego's way. And for one that is less than the last, which leaves no time to give up."""
GAP_M, GAP_S = 1.0, 0.3
TOUCH_M = 0.15


def speed_costs(
    stages: Sequence[Stage], drafts: Drafts, shape: EgoShape, reference_mps: float, impatience: float
) -> Floats:
    """(N,) cost of each draft, in points of progress.

    `impatience`, 0 to 1, takes away from the caution for those who are not seen.
    """
    steps = drafts.arc_m.shape[1] - 1
    horizon_s = steps * STEP_S
    way_m = drafts.arc_m[:, -1] - drafts.arc_m[:, 0]
    early_m = drafts.arc_m[:, steps // 2] - drafts.arc_m[:, 0]
    reference_m = max(reference_mps, SLOWEST_REFERENCE_MPS) * horizon_s
    cost = PROGRESS * (1.0 - (WHOLE_SHARE * way_m + HALF_SHARE * early_m) / reference_m)
    cost = cost + EFFORT * (drafts.acceleration_mps2**2).mean(axis=1) * horizon_s / 2.0
    cost = cost + np.where((drafts.acceleration_mps2 < -HARD_MPS2).any(axis=1), HARD, 0.0)
    time_s = STEP_S * np.arange(steps + 1)
    behind_m = shape.length_m - shape.front_m
    for p, stage in enumerate(stages):
        rows = np.flatnonzero(drafts.stage_of == p)
        if not rows.size:
            continue
        s, v = drafts.arc_m[rows], drafts.speed_mps[rows]
        front, rear = s + shape.front_m, s - behind_m
        settled = np.asarray(
            s >= (stage.candidate.settles_m if stage.candidate.new is None else stage.candidate.merged_m)
        )
        any_hit = np.any(_hits(stage, front, rear, settled, 0.0, TOUCH_M), axis=2)
        struck = any_hit.any(axis=1)
        cost[rows] += faded(HIT, np.where(struck, time_s[any_hit.argmax(axis=1)], np.inf), HIT_FADES_S)
        near = np.any(_hits(stage, front + CLOSE_FRONT_S * v, rear, settled, CLOSE_M, CLOSE_M), axis=2)
        cost[rows] += CLOSE * near.mean(axis=1) * np.where(struck, 0.0, 1.0)
        if stage.forced.any():
            near, far = stage.near_m[stage.forced].T, stage.far_m[stage.forced].T
            met = np.any((front[:, :, None] > near) & (rear[:, :, None] < far), axis=2)
            when_s = np.where(met.any(axis=1), time_s[met.argmax(axis=1)], np.inf)
            cost[rows] += np.where(struck, 0.0, faded(FORCED, when_s, HIT_FADES_S))
        if stage.walks.any():
            cost[rows] += PAUSES * _cannot_stop_s(stage, front, v)
        if stage.unseen is not None:
            near, far = stage.unseen
            met = (front > near) & (rear < far)
            cost[rows] += np.where(met.any(axis=1), (1.0 - impatience) * UNSEEN, 0.0)
        if stage.follower.any() and stage.candidate.new is not None:
            cost[rows] += _answered(stage, s, v, shape) + _short(stage, front, rear, v, settled)
        if stage.hidden is not None and len(stage.hidden.front_m):
            cost[rows] += (1.0 - impatience) * _answered_unseen(stage, stage.hidden, s, v, shape)
    return cost


def faded(cost: float, when_s: Floats, fades_s: float) -> Floats:
    """(N,) of what happens at some time from now, infinite for never."""
    return cost * np.exp(-when_s / fades_s)


def _hits(
    stage: Stage, front: Floats, rear: Floats, settled: NDArray[np.bool_], ahead_m: float, back_m: float
) -> NDArray[np.bool_]:
    """(n, K + 1, B) whether the ego's stretch of the candidate meets another's."""
    mine = (front[:, :, None] + ahead_m > stage.near_m.T) & (rear[:, :, None] - back_m < stage.far_m.T)
    mine &= stage.strip
    # who comes up from behind, once the ego is in the lane, keeps its distance itself; forecasts drive it through the
    # ego. Who gets beside it from another lane, or the ego beside them, is met
    center = stage.center_m.T
    onset, here = mine.copy(), np.isfinite(center)
    onset[:, 1:] &= ~mine[:, :-1] & here[:-1]
    mid = 0.5 * (front + rear)
    onset &= (stage.speed_mps.T > 0.5) & (np.where(here, center, -np.inf) < mid[:, :, None]) & settled[:, :, None]
    return mine & ~np.logical_or.accumulate(onset & stage.leads.T, axis=1)


def _cannot_stop_s(stage: Stage, front: Floats, v: Floats) -> Floats:
    """(n,) for how long the ego could not stop for those on foot before it if they did; in part where it hardly can."""
    near = stage.near_m[stage.walks].T
    gap = np.where(np.isfinite(near), near, np.inf) - front[:, :, None]
    room = np.maximum(gap - ANSWERED_S * v[:, :, None] - SPARE_M, 0.05)
    needed = np.where(gap > 0.0, v[:, :, None] ** 2 / (2.0 * room), 0.0)
    mild, hard = PAUSE_MPS2
    return STEP_S * np.clip((needed - mild) / (hard - mild), 0.0, 1.0).max(axis=2).sum(axis=1)


def _answered(stage: Stage, s: Floats, v: Floats, shape: EgoShape) -> Floats:
    """(n,) for those behind who have to brake, a reaction time after the ego comes into their lane, or nearly does."""
    last, late = s.shape[1] - 1, round(REACTION_S / STEP_S)
    rows, cost = np.arange(len(s)), np.zeros(len(s))
    for enters_m in stage.enters_m:
        inside = s >= enters_m
        at = np.where(inside.any(axis=1), np.minimum(inside.argmax(axis=1) + late, last), last)
        rear_m = s[rows, at] - (shape.length_m - shape.front_m)
        answers = _answers_mps2(stage, at, rear_m, v[rows, at], shape.length_m)
        cost = np.maximum(cost, FORCED * minded(answers).max(axis=1, initial=0.0))
    # whoever comes past with its front beside the ego when that reaches over brakes at once
    over = (s >= stage.enters_m[1]).argmax(axis=1)
    front_m, their_m = s[rows, over] + shape.front_m, stage.far_m[stage.follower][:, over]
    beside = (their_m < front_m) & (their_m > front_m - shape.length_m)
    squeezed = (beside & (stage.speed_mps[stage.follower][:, over] > v[rows, over])).any(axis=0) & (over > 0)
    cost = np.maximum(cost, np.where(squeezed, FORCED, 0.0))
    astride = s[:, -1] < stage.candidate.merged_m
    return np.where(s[:, -1] >= stage.enters_m[0], cost + np.where(astride, ASTRIDE, 0.0), 0.0)


def _answered_unseen(stage: Stage, hidden: HiddenPlaces, s: Floats, v: Floats, shape: EgoShape) -> Floats:
    """(n,) for those who may be hidden by others and would have to brake.

    An entry counts if it is near, for who waits will see more, and not over yet, for to stop half-way helps nobody.
    """
    last, late = s.shape[1] - 1, round(REACTION_S / STEP_S)
    lane = np.flatnonzero(stage.follower)
    center_m = np.where(np.isfinite(stage.near_m[lane]), stage.center_m[lane], -np.inf)
    rows, cost = np.arange(len(s)), np.zeros(len(s))
    for enters_m in stage.enters_m:
        inside = s >= enters_m
        enters = inside.argmax(axis=1)
        counts = inside.any(axis=1) & (enters * STEP_S <= SOON_S) & (enters_m > stage.arc_m + IN_ALREADY_M)
        at = np.minimum(enters + late, last)
        rear_m = s[rows, at] - (shape.length_m - shape.front_m)
        front_m, speed_mps, before_m = fronts_then(hidden, at, stage.near_m[lane], center_m, stage.speed_mps[lane])
        answers = answers_mps2(rear_m[:, None] - front_m, speed_mps, v[rows, at][:, None])
        met = comes_next(front_m, before_m, rear_m, shape)
        share = np.minimum(np.where(met, minded(answers), 0.0).sum(axis=1) * PLACE_M / ONE_IN_M, 1.0)
        cost = np.maximum(cost, np.where(counts, FORCED * share, 0.0))
    return cost


def _answers_mps2(stage: Stage, at: Ints, rear_m: Floats, ego_mps: Floats, length_m: float) -> Floats:
    """(n, b, T) how hard each kind of driver brakes where each of the stage's followers is at instants `at` (n,).

    `rear_m` and `ego_mps` (n,) are the ego's then.
    """
    lane = np.flatnonzero(stage.follower)
    known = np.isfinite(stage.far_m[lane])
    far_m, mps = np.where(known, stage.far_m[lane], 0.0), np.maximum(stage.speed_mps[lane], 0.0)
    center_m = np.nan_to_num(stage.center_m[lane], nan=-np.inf)
    behind = (rear_m[:, None] + 0.5 * length_m > center_m[:, at].T) & known[:, at].T
    # what those who accelerate have gained until then; of what comes later more will be known. Of those who are seen to
    # accelerate harder the forecast has it
    soon = np.minimum(at, round(SOON_S / STEP_S))
    seen = behind & (known[:, 0] & ~stage.eager[lane]) & known[:, soon].T
    faster_mps = np.where(seen, np.maximum(mps[:, soon].T - mps[:, 0], 0.0), 0.0)
    farther_m = np.where(seen, far_m[:, soon].T - far_m[:, 0] - mps[:, 0] * (STEP_S * soon)[:, None], 0.0)
    gap_m = np.where(behind, rear_m[:, None] - far_m[:, at].T, NOBODY_M)
    speed_mps = np.where(behind, mps[:, at].T, 0.0)
    return answers_mps2(gap_m, speed_mps, ego_mps[:, None], faster_mps, np.maximum(farther_m, 0.0))


def _short(stage: Stage, front: Floats, rear: Floats, v: Floats, settled: NDArray[np.bool_]) -> Floats:
    """(n,) for a short gap ahead at the moment when all of the ego is in the lane."""
    lane = np.flatnonzero(stage.follower)
    at = np.where(settled.any(axis=1), settled.argmax(axis=1), settled.shape[1] - 1)
    rows = np.arange(len(at))
    mid = 0.5 * (front + rear)[rows, at]
    near, center = stage.near_m[lane][:, at].T, np.nan_to_num(stage.center_m[lane][:, at].T, nan=-np.inf)  # (n, b)
    gap = np.where(np.isfinite(center) & (center >= mid[:, None]), near - front[rows, at][:, None], np.inf)
    short = np.maximum(GAP_M + GAP_S * v[rows, at][:, None] - gap, 0.0)
    return SHORT * short.max(axis=1, initial=0.0) + np.where(gap.min(axis=1, initial=np.inf) < TIGHT_M, TIGHT, 0.0)
