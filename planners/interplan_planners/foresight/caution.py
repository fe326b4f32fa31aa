"""Caution: where lights hold the ego, and where it waits for a gap or before what blocks its way."""

from __future__ import annotations

from interplan_planners.foresight.candidate_paths import DRAWN_M, RUN_IN_M, Base, shortest_m
from interplan_planners.foresight.scene import PlanningScene
from interplan_planners.foresight.static_classification import StandingGroup
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.signals import SignalStatus

BESIDE_M = 2.2
"""The drawn point is beside when it is this far before what it passes: the front is 1.5 m before it."""
RUN_UP_M = 7.0
"""Kept before an oncoming lane is used, to be rolling when it gets free."""
SWING_SHARE = 1.9
"""Of the shortest move to the side: what the ego keeps to move out gently."""
LEAST_WAITING_GAP_M = 1.5
WAITING_BRAKING_MPS2 = 2.5
YELLOW_BRAKING_MPS2 = 3.0
"""At yellow the ego stops if this is enough for it."""
LATE_M = 2.0
"""Who is farther than this beyond where it should have waited for a gap drives on."""
HELD_BRAKING_MPS2, HELD_SPARE_M = 1.8, 8.0
"""With what the ego brakes to wait there, and what it keeps besides: gaps are easier to reach at speed."""
PASSED_LINE_M = 1.0
"""Who is farther than this beyond a stop line goes on."""


def red_stops(scene: PlanningScene, base: Base, at_m: float) -> list[float]:
    """Arc lengths of a base at which lights hold an ego whose rear axle is at `at_m`."""
    signals = scene.seen.signals
    if not len(signals):
        return []
    status = dict(zip(signals.connector_ids, signals.status.tolist(), strict=True))
    front_m = at_m + scene.shape.front_m
    stopping_m = scene.speed_mps**2 / (2.0 * YELLOW_BRAKING_MPS2)
    found: list[float] = []
    way = zip(base.way.lanes, (base.way.starts_m + RUN_IN_M).tolist(), strict=True)
    for lane_id, start_m in (*way, *base.beyond):
        shows = status.get(lane_id)
        if start_m < front_m - PASSED_LINE_M:
            continue
        if shows == SignalStatus.RED or (shows == SignalStatus.YELLOW and start_m - front_m > stopping_m):
            found.append(start_m)
    return found


def soonest_stop_m(front_m: float, speed_mps: float) -> float:
    """Where a front bumper can be stopped without haste."""
    return front_m + speed_mps * speed_mps / (2.0 * WAITING_BRAKING_MPS2) + 0.2


def gap_wait_m(base: Base, front_m: float, move_m: float, speed_mps: float) -> float | None:
    """Where the front waits for a gap before a lane leaves the route; None while that is far, and if it is too late.

    `move_m` is what is left of a lane change on to that lane, which is finished in any case.
    """
    far_m = speed_mps * speed_mps / (2.0 * HELD_BRAKING_MPS2) + HELD_SPARE_M
    if base.held_m - front_m > far_m or front_m + move_m > base.held_m + LATE_M:
        return None
    return max(base.held_m, soonest_stop_m(front_m, speed_mps))


def waiting_m(blocked: StandingGroup, front_m: float, speed_mps: float, shape: EgoShape) -> float:
    """Where the front bumper waits before a blockage: far enough away to get round it from a standstill."""
    swing_m = LEAST_WAITING_GAP_M
    if blocked.passages:
        widest_m = max(abs(passage.offset_m) for passage in blocked.passages)
        swing_m = max(BESIDE_M + SWING_SHARE * shortest_m(widest_m) + DRAWN_M - shape.front_m, swing_m)
        if any(passage.oncoming for passage in blocked.passages):
            swing_m += RUN_UP_M
    # what it is too late for is not made worse
    return max(blocked.start_m - swing_m, min(soonest_stop_m(front_m, speed_mps), blocked.start_m - 1.0))
