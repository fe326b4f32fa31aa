"""Merging: whom to get behind while the ego waits for a gap, and what the prospect of a gap is worth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.gaps import GapRules, gap_ahead_m
from interplan_planners.foresight.drivers import needed_gap_m
from interplan_planners.foresight.manoeuvres import ManoeuvreOption
from interplan_planners.foresight.prediction import STEP_S
from interplan_planners.foresight.speeds import Drafts, Lead
from interplan_planners.foresight.st_obstacles import Stage
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import Floats

RULES = GapRules(min_gap_m=1.0, headway_s=0.35, braking_mps2=2.0)
HELD_S = 1.2
"""A gap must last so long to count."""
BEHIND_M, AHEAD_M, MOST_LEADS = 30.0, 25.0, 4
"""Whom the ego may get behind: this far behind and ahead of it, and so many."""
PROSPECT_SHARE, PROSPECT_FADES_S = 0.8, 8.0
"""A gap that comes is worth this share of one that is there, less the later it comes."""
WORTHWHILE = 0.2


def wished_changes(options: Sequence[ManoeuvreOption]) -> list[tuple[int, float]]:
    """The stages that enter another lane of the same direction and are worth more than staying, and by how much."""
    own = options[0]
    if own.candidate.kind != "keep":
        return []
    gains = [(i, option.worth - own.worth) for i, option in enumerate(options) if option.candidate.new is not None]
    return [(i, gain) for i, gain in gains if gain > WORTHWHILE]


def leads_beside(stages: Sequence[Stage], wished: Sequence[tuple[int, float]]) -> list[Lead]:
    """Who drives on the wished lanes near the ego, in the arc lengths of the first stage, which keeps its lane."""
    found: list[Lead] = []
    for i, _ in wished:
        stage = stages[i]
        ahead_m = np.where(stage.follower, stage.center_m[:, 0], np.nan) - stage.arc_m
        near = np.flatnonzero((ahead_m > -BEHIND_M) & (ahead_m < AHEAD_M))
        near = near[np.argsort(np.abs(ahead_m[near]), kind="stable")][:MOST_LEADS]
        shift_m = stages[0].arc_m - stage.arc_m
        found += [Lead(stage.near_m[j] + shift_m, np.maximum(stage.speed_mps[j], 0.0)) for j in near.tolist()]
    return found


def prospects(drafts: Drafts, stages: Sequence[Stage], wished: Sequence[tuple[int, float]], shape: EgoShape) -> Floats:
    """(N,) what the prospect of a gap is worth to the drafts of the first stage; 0 for the others."""
    worth = np.zeros(len(drafts.stage_of))
    rows = np.flatnonzero(drafts.stage_of == 0)
    for i, gain in wished:
        stage = stages[i]
        lane = np.flatnonzero(stage.follower)
        shift_m = stages[0].arc_m - stage.arc_m
        when_s = gap_times_s(
            drafts.arc_m[rows], drafts.speed_mps[rows], stage.near_m[lane] + shift_m, stage.far_m[lane] + shift_m,
            stage.center_m[lane] + shift_m, stage.speed_mps[lane], shape,
        )  # fmt: skip
        worth[rows] += PROSPECT_SHARE * gain * np.maximum(1.0 - np.minimum(when_s, 60.0) / PROSPECT_FADES_S, 0.0)
    return worth


def gap_times_s(
    arc_m: Floats,
    speed_mps: Floats,
    near_m: Floats,
    far_m: Floats,
    center_m: Floats,
    others_mps: Floats,
    shape: EgoShape,
) -> Floats:
    """(n,) first time from which on for a while there is a gap beside that is large enough; inf if there is none.

    The ego's rear axle is at arc lengths (n, K + 1), the others are (b, K + 1).
    """
    steps = speed_mps.shape[1]
    if not len(near_m):
        return np.zeros(len(speed_mps))
    front, rear = arc_m + shape.front_m, arc_m - (shape.length_m - shape.front_m)
    middle = 0.5 * (front + rear)
    others = np.maximum(others_mps.T[None], 0.0)
    before = gap_ahead_m(RULES, speed_mps[:, :, None], others)
    behind = needed_gap_m(others, speed_mps[:, :, None])
    ahead = center_m.T[None] >= middle[:, :, None]
    gap_ahead, gap_behind = near_m.T[None] - front[:, :, None], rear[:, :, None] - far_m.T[None]
    bad = np.isfinite(near_m).T[None] & np.where(ahead, gap_ahead < before, gap_behind < behind)
    good: NDArray[np.bool_] = ~np.any(bad, axis=2)
    held = good.copy()
    for k in range(1, max(1, round(HELD_S / STEP_S))):
        held[:, : steps - k] &= good[:, k:]
        held[:, steps - k :] &= good[:, -1:]
    return np.where(held.any(axis=1), STEP_S * held.argmax(axis=1), np.inf)
