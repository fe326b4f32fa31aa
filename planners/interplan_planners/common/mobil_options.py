"""Which of the neighbour lanes to change to, from what there is to see: MOBIL's verdict, weighed with the way to the
goal.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.forecast import Forecast
from interplan_planners.common.gaps import Ego, GapRules, best_gap
from interplan_planners.common.idm_policy import IdmDriver
from interplan_planners.common.lane_routes import LaneRoute, Ways
from interplan_planners.common.mobil import MobilVerdict, Side, judge, side_of
from interplan_planners.common.neighbours import LaneQueue, queue_on
from interplan_planners.common.paths import DrivingPath
from interplan_planners.common.red_lights import RedLights
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats

BLOCKED_AHEAD_M = 100.0
"""Something that stands for good this near ahead is a reason to leave the lane, even away from the goal."""
FREER_BY_M = 20.0
"""Another lane is a way round only if it is blocked this much farther ahead, if at all."""
ROOM_PER_CHANGE_M = 200.0
"""With less room than this for each change that is needed, the need grows urgent."""
LEAST_ROOM_M = 60.0
"""For each change that a detour would add."""
NAVIGATION_MPS2, URGENCY_MPS2 = 2.0, 3.0
"""What a change towards the goal is worth from the start, and what comes on top when it is urgent."""
URGENT_BRAKING_MPS2 = 1.0
"""What an urgent change may ask of the new follower on top of what is safe."""
URGENT_HEADWAY = 0.5
"""Share of the headways that an urgent change does without."""
CHANGE_WAY_S = 2.0
"""The time at present speed that the room must leave for crossing over, once a gap is reached."""
HOLD_S = 2.0
"""So long the speed is held once the ego is beside the gap."""
WAITING_SPEED_MPS, ROOM_PER_SPEED_S = 3.0, 4.0
"""Where the room for a needed change runs out, the ego slows to what covers it in this time, but not below this."""
SLOWER_THAN_FLOW_MPS, FLOW_WITHIN_M = 1.0, 40.0
"""Nor, while it waits, more than this below the mean speed of those near it on the other lane: no gap would fit."""


@dataclass(frozen=True, slots=True, eq=False)
class LaneOption:
    """A neighbour lane that might be changed to."""

    there: OnWay
    index: int
    """Of the lane's block on the route."""
    wished: bool
    """Whether it leads towards the goal lane, or round something."""
    room_m: float
    """How far the ego can go before it is too late for it."""
    rules: GapRules
    """What counts as a gap, urgent as it is."""
    verdict: MobilVerdict
    incentive_mps2: float
    """MOBIL's, and what the way to the goal adds."""


@dataclass(frozen=True, slots=True)
class ChangeStyle:
    """How somebody changes lanes."""

    driver: IdmDriver
    """Who follows with the headway and the gap that are accepted around a change."""
    rules: GapRules
    politeness: float
    safe_deceleration_mps2: float


def options(sight: Sight, ways: Ways, here: OnWay, index: int, lane_id: str, style: ChangeStyle) -> list[LaneOption]:
    """The neighbours of a lane of block `index` that are worth a thought, left before right, safe or not.

    Away from the goal lane they are so only if the own lane is blocked ahead,
    the other is not, and there is room to come back; towards it or neither
    only if the other lane is not blocked nearer than the own. The more urgent
    a change is, the more of it counts as safe.
    """
    found: list[LaneOption] = []
    needed = ways.changes_needed.get(lane_id, 1)
    for neighbour, spared in ways.beside(lane_id):
        there = sight.on(ways.from_lane(index, neighbour.id))
        blocked = here.blocked_m <= BLOCKED_AHEAD_M and there.blocked_m >= here.blocked_m + FREER_BY_M
        if spared < 0 and (not blocked or there.room_m < LEAST_ROOM_M * (needed - spared)):
            continue
        if there.blocked_m < min(BLOCKED_AHEAD_M, here.blocked_m):
            continue
        room_m = min(here.room_m, here.blocked_m) if blocked else here.room_m
        urgency = max(0.0, 1.0 - room_m / (ROOM_PER_CHANGE_M * max(needed, 1)))
        wished = spared > 0 or blocked
        bonus = NAVIGATION_MPS2 + URGENCY_MPS2 * urgency if wished else 0.0
        hurry = urgency if wished else 0.0
        relaxed = relaxed_rules(style.rules, hurry)
        verdict = judge(
            here.side, there.side, max(sight.ego.speed_mps, 0.0), sight.shape.length_m,
            replace(style.driver, headway_s=style.driver.headway_s * (1.0 - URGENT_HEADWAY * hurry)), relaxed,
            style.politeness, style.safe_deceleration_mps2 + URGENT_BRAKING_MPS2 * hurry,
        )  # fmt: skip
        found.append(LaneOption(there, index, wished, room_m, relaxed, verdict, verdict.incentive_mps2 + bonus))
    return found


def relaxed_rules(rules: GapRules, urgency: float) -> GapRules:
    """What counts as a gap for a change of some urgency, 0 to 1."""
    return replace(
        rules,
        headway_s=rules.headway_s * (1.0 - URGENT_HEADWAY * urgency),
        braking_mps2=rules.braking_mps2 + URGENT_BRAKING_MPS2 * urgency,
    )


def synchronised(
    sight: Sight, here: OnWay, option: LaneOption, needed: int, steps: int, step_s: float
) -> tuple[Floats, float]:
    """What must not be exceeded to get beside a gap of the other lane: accelerations (steps,) and a speed.

    Without a gap within the rules only the speed is capped, by the room that
    is left for the changes that are needed.
    """
    speed_mps = max(sight.ego.speed_mps, 0.0)
    there = option.there
    middle_m = 0.5 * (there.queue.rear_m + there.queue.front_m)
    around = there.queue.speed_mps[np.abs(middle_m - there.arc_m) < FLOW_WITHIN_M]
    slow_mps = max(WAITING_SPEED_MPS, float(around.mean()) - SLOWER_THAN_FLOW_MPS if around.size else 0.0)
    most_mps = max(slow_mps, option.room_m / ROOM_PER_SPEED_S)
    crossing_m = CHANGE_WAY_S * speed_mps
    choice = best_gap(
        Ego(there.arc_m, speed_mps, sight.shape.length_m), there.queue, option.rules, there.side.limit_mps,
        (here.side.gap_m, here.side.lead_mps), max(option.room_m / max(needed, 1) - crossing_m, 0.0),
    )  # fmt: skip
    most_mps2 = np.full(steps, np.inf)
    if choice is not None and choice.acceleration_mps2 <= 0.0:
        wait = max(1, round(choice.wait_s / step_s))
        most_mps2[:wait] = choice.acceleration_mps2
        # the tracker aims at the speed a second ahead: no pushing on before the change has begun
        most_mps2[wait : wait + round(HOLD_S / step_s)] = 0.0
    return most_mps2, most_mps


LOOK_BEHIND_M, LOOK_AHEAD_M = 60.0, 100.0
"""Along a way, from the ego's middle."""


@dataclass(frozen=True, slots=True, eq=False)
class OnWay:
    """The ego's place along a way and who else is on it."""

    way: LaneRoute
    arc_m: float
    """Of the ego's middle."""
    left_m: float
    """How far the ego is left of the way's line."""
    queue: LaneQueue
    side: Side
    blocked_m: float
    """From the ego's front bumper to the first that stands for good; infinite if none does."""

    @property
    def room_m(self) -> float:
        """How far the ego can still go before it is too late to change lane for the goal."""
        return self.way.room_m - self.arc_m


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What there is to see in one step."""

    ego: EgoState
    shape: EgoShape
    forecast: Forecast
    stands: NDArray[np.bool_]
    """(A,) who stands for good."""
    red_lights: RedLights
    closed: tuple[str, ...]
    """Connectors that show red."""

    def on(self, way: LaneRoute) -> OnWay:
        """The ego and the others along a way."""
        arc_m, left_m = way.path.line.project_point(self.ego.x_m, self.ego.y_m)
        stretch = (arc_m - LOOK_BEHIND_M, arc_m + LOOK_AHEAD_M)
        queue = queue_on(way.path, self.shape.width_m / 2, self.forecast, stretch)
        limit_mps = float(way.limit_mps[min(int(arc_m), len(way.limit_mps) - 1)])
        half_m = self.shape.length_m / 2
        side = side_of(queue, arc_m, half_m, self._end_m(way.path, arc_m), limit_mps)
        standing = queue.rear_m[self.stands[queue.rows] & (queue.front_m > arc_m)]
        blocked_m = float(standing.min()) - arc_m - half_m if standing.size else float("inf")
        return OnWay(way, arc_m, left_m, queue, side, blocked_m)

    def _end_m(self, path: DrivingPath, arc_m: float) -> float:
        """Where the path ends or the next red light closes it."""
        reds: Iterable[tuple[float, float]] = self.red_lights.on_path(path, self.closed)
        return min((start for start, end in reds if 0.5 * (start + end) > arc_m), default=path.length_m)
