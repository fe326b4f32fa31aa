"""Speeds: many ways to drive each candidate, rolled out at once, and what each of them costs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.ragged import stacked
from interplan_planners.foresight.prediction import MOVING_MPS, STEP_S
from interplan_planners.foresight.st_obstacles import Stage
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import Floats, Ints

# How the ego drives: brisker than the background, within what passengers accept (nuPlan's comfort).
ACCELERATION_MPS2, BRAKING_MPS2, HEADWAY_S, MIN_GAP_M = 1.9, 1.8, 1.25, 4.0
DOUBTFUL_GAP_M = 9.0
"""Kept behind those of whom it cannot be told whether they will go on: enough to pull out."""
MERGE_GAP_M, MERGE_HEADWAY_S = 1.5, 0.4
"""Kept behind those of another lane whom the ego gets behind: the rest of the gap is for whoever follows."""
STOP_GAP_M = 1.0
"""Kept to stop lines and to where others cross."""
SOFTNESS_MPS2 = 2.0 * sqrt(ACCELERATION_MPS2 * BRAKING_MPS2)
COMFORT_BRAKING_MPS2, EMERGENCY_MPS2 = 3.6, 6.5
MERGE_BRAKING_MPS2 = 2.5
"""To get behind somebody who is on another lane still."""
FALL_BACK_MPS, CATCH_UP_MPS, CLOSE_UP_PER_S, SPEED_GAIN_PER_S = 3.0, 6.0, 0.35, 0.9
"""How much slower or faster than it the ego drives meanwhile, how fast the gap is made good, and the speed."""
JERK_UP_MPS3, JERK_DOWN_MPS3, JERK_FIRM_MPS3 = 2.5, 2.3, 4.0
FIRM_MPS2 = -2.0
"""Caps harder than this set in with the larger jerk."""
SETS_IN_MPS3 = 1.0
"""Either way while a drive begins: a tracker without a past sets in with about twice the jerk that is asked of it."""
RELAXED_MPS2 = 1.0
"""Nobody is braked for harder than what the closing speed needs and this on top: a gap that has become short, as after
a lane change, is widened gently (after Kesting, Treiber and Helbing, 2010)."""
NEEDED_GAP_M = 1.2
FREE = 99.0


@dataclass(frozen=True, slots=True)
class Cap:
    """An acceleration that is not exceeded for some time."""

    most_mps2: float
    for_s: float


NO_CAP = Cap(FREE, 0.0)
CAPS = (NO_CAP, Cap(0.0, 2.4), Cap(-1.0, 2.0), Cap(-1.9, 3.0), Cap(-2.2, 2.0), Cap(-3.2, 8.0))
YIELD_CAPS = (NO_CAP, Cap(-1.0, 1.6))
WAIT_CAPS = tuple(Cap(-1.0, wait_s) for wait_s in (0.8, 1.4, 2.6, 3.4, 4.2))
"""Besides, for an ego that stands before it leaves its lane: when to set off."""
GENTLE_CAPS = (Cap(0.8, 3.0), Cap(0.25, 4.4))
"""Besides, for a slow ego: the tracker cuts bends in which it sets off briskly; and close to who stands it may creep,
where every other way to set off comes too near to it, so that to wait a little would always be the best."""
EMERGENCY = Cap(-EMERGENCY_MPS2, 8.0)
SLOW_MPS = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Lead:
    """Somebody to get behind, (K + 1,) each, in arc lengths of the first stage's path."""

    near_m: Floats
    speed_mps: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Drafts:
    """N ways to drive: a stage each and a speed profile."""

    stage_of: Ints  # (N,)
    yields: tuple[tuple[int, ...], ...]
    """To which of the stage's contenders each gives way; numbers beyond them are leads beside."""
    cap: tuple[Cap, ...]
    urgent: NDArray[np.bool_]  # (N,) emergency braking
    arc_m: Floats  # (N, K + 1) of the rear axle on the candidate's path
    speed_mps: Floats  # (N, K + 1)
    acceleration_mps2: Floats  # (N, K)


def drafted(
    stages: Sequence[Stage],
    speed_mps: float,
    acceleration_mps2: float,
    shape: EgoShape,
    leads: Sequence[Lead],
    *,
    sets_in: bool,
) -> Drafts:
    """All ways to drive the stages, from a speed and an acceleration.

    `leads` are those behind whom the ego may get while it drives the first
    stage; emergency braking is thought of on that one only. `sets_in` says
    that the drive has just begun: only emergency braking is sudden then.
    """
    combined = list(_combined(stages, speed_mps, leads))
    of = np.array([stage for stage, _, _ in combined])
    yields = tuple(ones for _, ones, _ in combined)
    caps = tuple(cap for _, _, cap in combined)
    steps = stages[0].near_m.shape[1] - 1
    ahead, waited = _Ahead.of(stages), _Waited.of(stages, of, yields, leads, steps)
    limits = stacked([stage.limit_mps for stage in stages])

    hard = np.array([cap is EMERGENCY for cap in caps])
    cap_mps2 = np.array([cap.most_mps2 for cap in caps])
    cap_steps = np.array([round(cap.for_s / STEP_S) for cap in caps])
    floor = np.where(hard, -EMERGENCY_MPS2, -COMFORT_BRAKING_MPS2)
    firmly = np.where(cap_mps2 <= FIRM_MPS2, JERK_FIRM_MPS3, JERK_DOWN_MPS3)
    # acceleration must not fall faster than this; where it is urgent, at once
    sudden = np.where(hard, np.inf, (SETS_IN_MPS3 if sets_in else firmly) * STEP_S)
    brisk = (SETS_IN_MPS3 if sets_in else JERK_UP_MPS3) * STEP_S
    s = np.array([stage.arc_m for stage in stages])[of]
    v = np.full(len(of), max(speed_mps, 0.0))
    a = np.full(len(of), acceleration_mps2)
    arc, speed, accelerations = (np.empty((count, len(of))) for count in (steps + 1, steps + 1, steps))
    arc[0], speed[0] = s, v
    for k in range(steps):
        limit = limits[of, np.minimum(s.astype(np.int64), limits.shape[1] - 1)]
        free = np.minimum((v / np.maximum(limit, 0.3)) ** 4, 3.5)
        wish = np.minimum(ACCELERATION_MPS2 * (1.0 - free), ahead.behind(of, k, s, v, shape.front_m))
        if waited.any:
            wish = np.minimum(wish, waited.behind(k, s, v, shape.front_m))
        wish = np.maximum(np.where(k < cap_steps, np.minimum(wish, cap_mps2), wish), floor)
        a = np.minimum(np.maximum(wish, a - sudden), a + brisk)
        a = np.where((v <= 0.01) & (a < 0.0), 0.0, a)
        after = np.maximum(v + STEP_S * a, 0.0)
        s = s + 0.5 * STEP_S * (v + after)
        v = after
        arc[k + 1], speed[k + 1], accelerations[k] = s, v, a
    return Drafts(of, yields, caps, hard, arc.T.copy(), speed.T.copy(), accelerations.T.copy())


def _combined(
    stages: Sequence[Stage], speed_mps: float, leads: Sequence[Lead]
) -> Iterator[tuple[int, tuple[int, ...], Cap]]:
    """Every stage with all ways to yield and all caps that go with them."""
    for i, stage in enumerate(stages):
        waits = speed_mps < SLOW_MPS and stage.candidate.kind != "keep"
        slow = speed_mps < SLOW_MPS
        for cap in (*CAPS, *(GENTLE_CAPS if slow else ()), *(WAIT_CAPS if waits else ())):
            yield i, (), cap
        many = len(stage.yield_near_m)
        options = {tuple(range(m)) for m in range(1, many + 1)} | {(m,) for m in range(many)}
        for ones in sorted(options, key=lambda o: (len(o), o)):
            for cap in YIELD_CAPS:
                yield i, ones, cap
    everybody = len(stages[0].yield_near_m)
    for j in range(len(leads)):
        for cap in YIELD_CAPS:
            yield 0, (*range(everybody), everybody + j), cap
    yield 0, (), EMERGENCY


@dataclass(frozen=True, slots=True, eq=False)
class _Ahead:
    """Who is followed when ahead, and where to stop: P stages, B of each."""

    near_m: Floats  # (P, K + 1, B)
    center_m: Floats  # (P, K + 1, B)
    speed_mps: Floats  # (P, K + 1, B)
    gap_m: Floats  # (P, B)
    headway_s: Floats  # (P, B)

    @classmethod
    def of(cls, stages: Sequence[Stage]) -> _Ahead:
        instants = stages[0].near_m.shape[1]
        most = max(1, *(len(stage.near_m) + len(stage.stops_m) for stage in stages))
        shape = (len(stages), instants, most)
        near, center, speed = np.full(shape, np.inf), np.full(shape, -np.inf), np.zeros(shape)
        gap, headway = np.full((len(stages), most), MIN_GAP_M), np.full((len(stages), most), HEADWAY_S)
        for p, stage in enumerate(stages):
            count = len(stage.near_m)
            near[p, :, :count] = np.where(stage.leads, stage.near_m, np.inf).T
            center[p, :, :count] = np.where(stage.leads, stage.center_m, -np.inf).T
            speed[p, :, :count] = np.where(stage.leads, np.maximum(stage.speed_mps, 0.0), 0.0).T
            merges = stage.follower | (stage.candidate.kind == "change")
            least_m = np.where(merges & (stage.speed_mps.max(axis=1, initial=0.0) > MOVING_MPS), MERGE_GAP_M, MIN_GAP_M)
            gap[p, :count] = np.where(stage.doubtful, DOUBTFUL_GAP_M, least_m)
            headway[p, :count] = np.where(merges, MERGE_HEADWAY_S, HEADWAY_S)
            for j, stop_m in enumerate(stage.stops_m, start=count):
                near[p, :, j], center[p, :, j], gap[p, j] = stop_m, np.inf, STOP_GAP_M
        return cls(near, center, speed, gap, headway)

    def behind(self, of: Ints, k: int, s: Floats, v: Floats, front_m: float) -> Floats:
        """(N,) accelerations behind the one for whom one has to brake hardest."""
        ahead = self.center_m[of, k] > s[:, None] + 0.5
        gap = np.where(ahead, self.near_m[of, k], np.inf) - (s + front_m)[:, None]
        return _following(v[:, None], gap, self.speed_mps[of, k], self.gap_m[of], self.headway_s[of]).min(axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class _Waited:
    """To whom each of N drafts gives way: C at most."""

    near_m: Floats  # (N, K + 1, C)
    speed_mps: Floats  # (N, K + 1, C)
    gap_m: Floats  # (N, C)
    headway_s: Floats  # (N, C)
    any: bool

    @classmethod
    def of(
        cls,
        stages: Sequence[Stage],
        of: Ints,
        yields: Sequence[tuple[int, ...]],
        leads: Sequence[Lead],
        steps: int,
    ) -> _Waited:
        most = max(1, *map(len, yields))
        shape = (len(of), steps + 1, most)
        near, speed = np.full(shape, np.inf), np.zeros(shape)
        gap, headway = np.full((len(of), most), STOP_GAP_M), np.zeros((len(of), most))
        for n, ones in enumerate(yields):
            stage = stages[int(of[n])]
            for place, j in enumerate(ones):
                beside = j - len(stage.yield_near_m)
                if beside >= 0:
                    near[n, :, place], speed[n, :, place] = leads[beside].near_m, leads[beside].speed_mps
                else:
                    near[n, :, place], speed[n, :, place] = stage.yield_near_m[j], stage.yield_speed_mps[j]
                if beside >= 0 or stage.yield_merges[j]:
                    gap[n, place], headway[n, place] = MERGE_GAP_M, MERGE_HEADWAY_S
        return cls(near, speed, gap, headway, any(yields))

    def behind(self, k: int, s: Floats, v: Floats, front_m: float) -> Floats:
        """(N,) accelerations; behind those who merge the ego falls back gently, however near they are."""
        v = v[:, None]
        gap, lead_mps = self.near_m[:, k] - (s + front_m)[:, None], self.speed_mps[:, k]
        wish = _following(v, gap, lead_mps, self.gap_m, self.headway_s)
        lacking_m = np.minimum(gap, 1e3) - self.gap_m - v * self.headway_s
        wanted_mps = lead_mps + np.minimum(np.maximum(CLOSE_UP_PER_S * lacking_m, -FALL_BACK_MPS), CATCH_UP_MPS)
        falling_back = np.maximum(SPEED_GAIN_PER_S * (wanted_mps - v), -MERGE_BRAKING_MPS2)
        return np.where(self.headway_s > 0.0, falling_back, wish).min(axis=1)


def _following(v: Floats, gap_m: Floats, lead_mps: Floats, least_gap_m: Floats, headway_s: Floats) -> Floats:
    """The IDM's accelerations, but never harder than what the closing speed needs and `RELAXED_MPS2` on top."""
    wanted = np.maximum(least_gap_m + v * headway_s + v * (v - lead_mps) / SOFTNESS_MPS2, least_gap_m)
    ratio = wanted / np.maximum(gap_m, 0.4)
    closing = np.maximum(v - lead_mps, 0.0)
    needed = -(closing * closing) / (2.0 * np.maximum(gap_m - NEEDED_GAP_M, 0.3))
    return np.maximum(ACCELERATION_MPS2 * (1.0 - ratio * ratio), needed - RELAXED_MPS2)
