"""Costs of drafts: progress, comfort, and what comes of those who are in the way; in points of progress."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from interplan_planners.foresight.prediction import STEP_S
from interplan_planners.foresight.speeds import Drafts
from interplan_planners.foresight.st_obstacles import Stage
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import Floats

PROGRESS = 10.0
"""Points for the distance that the limit allows."""
WHOLE_SHARE, HALF_SHARE = 0.8, 0.4
"""How much of them the whole way counts, and how much the way at half-time: the sooner, the better."""
SLOWEST_REFERENCE_MPS = 3.0
HIT, HIT_FADES_S = 120.0, 6.0
"""For running into somebody, now; it fades with the time until then, for forecasts get worse."""
UNSEEN = 16.0
"""For being in the way of somebody who may come from where the ego cannot see."""
CLOSE, CLOSE_FRONT_S, CLOSE_M = 2.5, 0.35, 0.8
"""For coming near somebody, and what is near: a time ahead and a distance on all sides."""
EFFORT = 0.12
"""Per squared acceleration, on average."""
HARD, HARD_MPS2 = 6.0, 3.9
"""For braking harder than passengers accept."""
COURTESY = 0.5
"""Per m/s2 that somebody has to brake for the ego."""
FORCED, FORCED_MPS2 = 40.0, 2.2
"""For making somebody brake harder than this."""
SHORT, TIGHT, TIGHT_M = 5.0, 30.0, 1.6
"""Per metre that a gap falls short when the ego is in it; gaps should be `GAP_M` and `GAP_S` of the follower's way.
And for one that is less than the last, which leaves no time to give up."""
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
        first = np.where(struck, time_s[any_hit.argmax(axis=1)], np.inf)
        cost[rows] += np.where(struck, HIT * np.exp(-np.minimum(first, 60.0) / HIT_FADES_S), 0.0)
        near = np.any(_hits(stage, front + CLOSE_FRONT_S * v, rear, settled, CLOSE_M, CLOSE_M), axis=2)
        cost[rows] += CLOSE * near.mean(axis=1) * np.where(struck, 0.0, 1.0)
        if stage.unseen is not None:
            near, far = stage.unseen
            met = (front > near) & (rear < far)
            cost[rows] += np.where(met.any(axis=1), (1.0 - impatience) * UNSEEN, 0.0)
        if stage.follower.any() and stage.candidate.new is not None:
            cost[rows] += _imposed(stage, front, rear, v, settled)
    return cost


def _hits(
    stage: Stage, front: Floats, rear: Floats, settled: NDArray[np.bool_], ahead_m: float, back_m: float
) -> NDArray[np.bool_]:
    """(n, K + 1, B) whether the ego's stretch of the candidate meets another's."""
    mine = (front[:, :, None] + ahead_m > stage.near_m.T) & (rear[:, :, None] - back_m < stage.far_m.T)
    mine &= stage.strip
    # who comes from behind, once the ego is in the lane, keeps its distance itself
    mid = 0.5 * (front + rear)
    from_behind = (stage.speed_mps.T > 0.5) & (np.nan_to_num(stage.center_m.T, nan=-np.inf) < mid[:, :, None])
    return mine & ~(from_behind & settled[:, :, None])


def _imposed(stage: Stage, front: Floats, rear: Floats, v: Floats, settled: NDArray[np.bool_]) -> Floats:
    """(n,) what drivers of the new lane have to do for the ego: at the moment when it is in their lane."""
    lane = np.flatnonzero(stage.follower)
    near, far, speed = stage.near_m[lane], stage.far_m[lane], np.maximum(stage.speed_mps[lane], 0.0)
    last = settled.shape[1] - 1
    at = np.where(settled.any(axis=1), settled.argmax(axis=1), last)
    rows = np.arange(len(at))
    mid = 0.5 * (front + rear)[rows, at]
    center = np.nan_to_num(stage.center_m[lane][:, at].T, nan=-np.inf)  # (n, b)
    behind = np.isfinite(center) & (center < mid[:, None])
    gap = np.where(behind, rear[rows, at][:, None] - far[:, at].T, np.inf)
    closing = np.maximum(speed[:, at].T - v[rows, at][:, None], 0.0)
    need = np.where(behind, closing**2 / (2.0 * np.maximum(gap - GAP_M, 0.3)), 0.0)
    short = np.where(behind, np.maximum(GAP_M + GAP_S * speed[:, at].T - gap, 0.0), 0.0)
    ahead = np.isfinite(center) & ~behind
    front_gap = np.where(ahead, near[:, at].T - front[rows, at][:, None], np.inf)
    front_short = np.maximum(GAP_M + GAP_S * v[rows, at][:, None] - front_gap, 0.0)
    most = need.max(axis=1, initial=0.0)
    cost = COURTESY * most + np.where(most > FORCED_MPS2, FORCED, 0.0)
    tight = (gap.min(axis=1, initial=np.inf) < TIGHT_M) | (front_gap.min(axis=1, initial=np.inf) < TIGHT_M)
    cost = cost + np.where(tight, TIGHT, 0.0)
    return cost + SHORT * (short.max(axis=1, initial=0.0) + front_short.max(axis=1, initial=0.0))
