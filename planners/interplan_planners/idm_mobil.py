"""IDM with lane changes by MOBIL (Kesting, Treiber and Helbing, 2007): own gain weighed against the others'."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from interplan_planners.common.driven_route import DrivenRoute
from interplan_planners.common.forecast import constant_velocity
from interplan_planners.common.gaps import GapRules
from interplan_planners.common.idm_policy import IdmDriver
from interplan_planners.common.lane_routes import LaneRoute
from interplan_planners.common.mobil_options import ChangeStyle, Sight, options, synchronised
from interplan_planners.common.neighbours import moved, stands_for_good, together
from interplan_planners.common.occupancy import occupancy
from interplan_planners.common.option_checks import at_least_0, more_than_0
from interplan_planners.common.paths import DrivingPath, braking_plan, lane_change_path, plan_along
from interplan_planners.common.rollout import ProposalPath, RolloutClock, RolloutStart, roll_out
from interplan_planners.mobil_published import PublishedMobil
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats, wrap_angle
from interplan_sumo.world.trajectory import Trajectory

FARTHEST_FROM_PATH_M = 2.0
"""Beyond this the ego has lost its path; a plan from the path would be a teleport."""
SHORTEST_CHANGE_M = 12.0
"""Below this no car gets over by a lane's width."""
MOST_BEYOND_LANE = 0.4
"""Share of a change that may lie beyond the end of the lane that is left."""
SETTLED_M, SETTLED_RAD = 0.5, 0.1
"""A change is done when the centre is this near to the new lane's line and turned no more (as published)."""
HALF_LANE_M = 1.75
"""While the centre is no farther than this from the old lane's line it can go back there."""
ABORT_BRAKING_MPS2 = 3.5
"""A change is aborted when somebody would have to brake harder than this for it."""
ABORT_GAP_M, ABORT_WITHIN_S = 0.3, 0.5
"""Or when a gap is, or within this time gets, smaller than this."""
EASING_S, EASING_STEP_S = 8.0, 0.15
"""So long after the start of a change the ego follows with the headway that it has plus this, if its own is longer."""
MARGIN_M = 0.15
"""How much farther than the ego's sides the strip reaches in which something leads."""
COOL_DOWN_S = 2.0
"""After an aborted change, before the next is tried."""
STEP_S = 0.2


@dataclass(frozen=True, slots=True)
class MobilDecision:
    """What the last step did."""

    manoeuvre: str
    """keep, change or abort."""
    lane: str
    """Where the way begins that the ego keeps or changes to."""
    waits_for_gap: bool
    """Whether it adapts its speed to a gap beside it."""


@dataclass(frozen=True, slots=True, eq=False)
class _Intent:
    """What the ego is doing: keeping to a way, or changing to one."""

    path: DrivingPath
    way: LaneRoute
    """The way that is kept, or that the path leads to."""
    index: int
    """Of the way's first block on the route."""
    limit_mps: Floats
    """(S,) for each metre of the path."""
    ahead_m: float = 0.0
    """How much larger arc lengths of the path are than those of the way beside it."""
    old: _Intent | None = None
    """What it leaves, while it changes."""
    aborting: bool = False


@dataclass(frozen=True, slots=True)
class IdmMobilSettings:
    """Options."""

    politeness: float = 0.5
    threshold_mps2: float = 0.2
    safe_deceleration_mps2: float = 2.0
    change_time_s: float = 4.0
    change_headway_s: float = 0.8
    """Accepted around a change."""
    fallback_limit_mps: float = 10.0
    """Where the map knows no limit."""
    min_gap_m: float = 2.0
    headway_s: float = 1.5
    max_acceleration_mps2: float = 1.0
    max_deceleration_mps2: float = 3.0
    horizon_s: float = 8.0
    published: bool = False

    def __post_init__(self) -> None:
        more_than_0(
            safe_deceleration_mps2=self.safe_deceleration_mps2,
            change_time_s=self.change_time_s,
            change_headway_s=self.change_headway_s,
            fallback_limit_mps=self.fallback_limit_mps,
            max_acceleration_mps2=self.max_acceleration_mps2,
            max_deceleration_mps2=self.max_deceleration_mps2,
            horizon_s=self.horizon_s,
        )
        at_least_0(
            politeness=self.politeness,
            threshold_mps2=self.threshold_mps2,
            min_gap_m=self.min_gap_m,
            headway_s=self.headway_s,
        )


class IdmMobilPlanner:
    """Keeps its lane by IDM and changes it by MOBIL, towards the goal lane when it can, away when its own is blocked.

    A neighbour lane is weighed by MOBIL's incentive (own gain in acceleration
    plus `politeness` times that of the old and the new follower), a bonus for
    getting nearer to the goal lane that grows as the room for it shrinks, and a
    safety criterion for the new follower and for itself. Changes away from the
    goal lane are considered only when something stands for good ahead. If a
    change is needed and none is possible, a gap is sought ahead and behind and
    the speed adapted to it; near the last place for the change the ego slows
    down. A change follows a quintic over `change_time_s` of travel; it is
    aborted, and the ego returns, if the gap closes before its centre is on the
    new lane. Around a change a shorter headway is accepted than when following,
    and opened up again gently. Others are taken to go on at constant velocity.

    `published` gives the variant of the interPlan paper instead, as its code
    has it and with its numbers, whatever the other options say; see
    `PublishedMobil` for what it does wrong. Of those numbers this one keeps
    politeness, threshold and the IDM's but for the minimum gap, which is the
    2 m of the model's authors: the tracker does not stop within 1 m.
    """

    paper: ClassVar[str] = "Kesting, Treiber, Helbing 2007; published=true: Hallgarten et al. 2024"

    Settings = IdmMobilSettings

    def __init__(self, settings: IdmMobilSettings | None = None) -> None:
        self.settings = given = settings or IdmMobilSettings()
        self.driver = IdmDriver(
            given.fallback_limit_mps, given.min_gap_m, given.headway_s, given.max_acceleration_mps2,
            given.max_deceleration_mps2,
        )  # fmt: skip
        gaps = GapRules(acceleration_mps2=given.max_acceleration_mps2)
        hurried = replace(
            self.driver,
            headway_s=min(given.headway_s, given.change_headway_s),
            min_gap_m=min(given.min_gap_m, gaps.min_gap_m),
        )
        self._style = ChangeStyle(hurried, gaps, given.politeness, given.safe_deceleration_mps2)
        self.published = PublishedMobil() if given.published else None
        self.decision: MobilDecision | None = None

    def start(self, mission: Mission) -> None:
        self._mission = mission
        self._intent: _Intent | None = None
        self._calm_until_s = -np.inf
        self._eases_until_s = -np.inf
        self.decision = None
        if self.published is not None:
            self.published.start(mission)

    def plan(self, observation: Observation) -> Trajectory:
        if self.published is not None:
            return self.published.plan(observation)
        ego, shape = observation.ego, self._mission.shape
        intent = self._begun(ego) if self._intent is None else self._current(ego, self._intent)
        forecast = constant_velocity(observation.actors, self.settings.horizon_s, STEP_S)
        closed = self._route.red_lights.closed(observation.signals, ego, shape)
        sight = Sight(ego, shape, forecast, stands_for_good(observation), self._route.red_lights, closed)
        cap: tuple[Floats, float] | None = None
        if intent.old is None:
            intent, cap = self._decided(sight, intent)
        elif not intent.aborting and self._threatened(sight, intent, intent.old):
            self._calm_until_s = ego.time_s + COOL_DOWN_S
            way_m = max(0.75 * self.settings.change_time_s * ego.speed_mps, SHORTEST_CHANGE_M)
            intent = self._changing(intent, intent.old.way, intent.old.index, ego, way_m, aborting=True)
        self._intent = intent
        manoeuvre = "keep" if intent.old is None else "abort" if intent.aborting else "change"
        self.decision = MobilDecision(manoeuvre, intent.way.lanes[0], cap is not None)
        if _off_m(intent.path, ego) > FARTHEST_FROM_PATH_M:
            return braking_plan(ego, self.driver.max_deceleration_mps2, self.settings.horizon_s, STEP_S)
        return self._driven(sight, intent, cap)

    # --- what to do ----------------------------------------------------------------------------

    def _begun(self, ego: EgoState) -> _Intent:
        self._route = DrivenRoute(self._mission, ego.pose, self.settings.fallback_limit_mps)
        return self._kept(*self._route.lane_at(ego.pose))

    def _kept(self, index: int, lane_id: str) -> _Intent:
        way = self._route.ways.from_lane(index, lane_id)
        return _Intent(way.path, way, index, way.limit_mps)

    def _current(self, ego: EgoState, intent: _Intent) -> _Intent:
        """The intent as it stands now: a change may be done, or the path lost."""
        if intent.old is not None:
            arc_m, left_m = intent.way.path.line.project_point(ego.x_m, ego.y_m)
            turned = wrap_angle(ego.heading_rad - intent.way.path.line.pose_at(arc_m).heading_rad)
            if abs(left_m) <= SETTLED_M and abs(turned) <= SETTLED_RAD:
                return self._kept(intent.index, intent.way.lanes[0])
        if _off_m(intent.path, ego) > FARTHEST_FROM_PATH_M:
            return self._kept(*self._route.lane_at(ego.pose))
        return intent

    def _decided(self, sight: Sight, intent: _Intent) -> tuple[_Intent, tuple[Floats, float] | None]:
        """Keep the lane or begin a change; and caps on acceleration and speed, if a gap is waited for."""
        ego = sight.ego
        arc_m, _ = intent.path.line.project_point(ego.x_m, ego.y_m)
        place = int(np.searchsorted(intent.way.starts_m, arc_m, side="right")) - 1
        index, lane_id = intent.index + place, intent.way.lanes[place]
        if not self._route.ways.beside(lane_id) or ego.time_s < self._calm_until_s:
            return intent, None
        here = sight.on(intent.way)
        found = options(sight, self._route.ways, here, index, lane_id, self._style)
        good = [o for o in found if o.verdict.safe and o.incentive_mps2 >= self.settings.threshold_mps2]
        if good:
            best = max(good, key=lambda option: option.incentive_mps2)
            starts_m = intent.way.starts_m
            lane_end_m = float(starts_m[place + 1]) if place + 1 < len(starts_m) else intent.path.length_m
            way_m = max(self.settings.change_time_s * ego.speed_mps, SHORTEST_CHANGE_M)
            longest_m = (lane_end_m - arc_m) / (1.0 - MOST_BEYOND_LANE)
            if longest_m >= SHORTEST_CHANGE_M:
                return self._changing(intent, best.there.way, best.index, ego, min(way_m, longest_m)), None
        wished = max((o for o in found if o.wished), key=lambda option: option.incentive_mps2, default=None)
        if wished is None:
            return intent, None
        needed = self._route.ways.changes_needed.get(lane_id, 1)
        return intent, synchronised(sight, here, wished, needed, self._steps, STEP_S)

    def _changing(
        self, intent: _Intent, way: LaneRoute, index: int, ego: EgoState, way_m: float, aborting: bool = False
    ) -> _Intent:
        """An intent from the ego's pose to another way, over a length of it."""
        self._eases_until_s = ego.time_s + EASING_S
        path = DrivingPath(lane_change_path(way.path.line, ego.pose, way_m))
        ahead_m = path.line.project_point(ego.x_m, ego.y_m)[0] - way.path.line.project_point(ego.x_m, ego.y_m)[0]
        metres = np.arange(int(path.length_m) + 1) - round(ahead_m)
        limit_mps = way.limit_mps[np.clip(metres, 0, len(way.limit_mps) - 1)]
        return _Intent(path, way, index, limit_mps, ahead_m, old=intent, aborting=aborting)

    def _threatened(self, sight: Sight, intent: _Intent, old: _Intent) -> bool:
        """Whether the gap closes while the ego can still go back, and there is a place to go back to."""
        back = sight.on(old.way)
        if abs(back.left_m) > HALF_LANE_M:
            return False
        speed_mps = max(sight.ego.speed_mps, 0.0)
        closes = sight.on(intent.way).side.closes(speed_mps, ABORT_BRAKING_MPS2, ABORT_GAP_M, ABORT_WITHIN_S)
        return closes and min(back.side.gap_m, back.side.follower_gap_m) >= ABORT_GAP_M

    # --- how to drive it -----------------------------------------------------------------------

    @property
    def _steps(self) -> int:
        return round(self.settings.horizon_s / STEP_S)

    def _driven(self, sight: Sight, intent: _Intent, cap: tuple[Floats, float] | None) -> Trajectory:
        """IDM along the intent's path behind whoever is on it, and on the way that it leads to."""
        ego, shape, path = sight.ego, sight.shape, intent.path
        arc_m, _ = path.line.project_point(ego.x_m, ego.y_m)
        half_width_m = shape.width_m / 2 + MARGIN_M
        stretch = (
            arc_m - shape.length_m,
            arc_m + float(intent.limit_mps.max()) * self.settings.horizon_s + shape.length_m,
        )
        occupied = occupancy(path, half_width_m, sight.forecast, stretch)
        if intent.old is not None:
            shifted_by = intent.ahead_m
            beside = occupancy(
                intent.way.path, half_width_m, sight.forecast, (stretch[0] - shifted_by, stretch[1] - shifted_by)
            )
            occupied = together(occupied, moved(beside, shifted_by))
        track = ProposalPath(path.length_m, occupied, sight.red_lights.on_path(path, sight.closed), intent.limit_mps)
        most_mps2, most_mps = cap if cap is not None else (None, np.inf)
        half_m = shape.length_m / 2
        driver = self._eased(ego, track, arc_m + half_m)
        start = RolloutStart(np.zeros(1, dtype=np.int64), np.array([arc_m]), ego.speed_mps)
        clock = RolloutClock(np.arange(self._steps + 1), STEP_S, lead_every=1)
        rolled = roll_out([track], start, np.array([most_mps]), driver, (half_m, half_m), clock, most_mps2)
        time_s = ego.time_s + STEP_S * np.arange(self._steps + 1)
        return plan_along(path.line, time_s, rolled.progress_m[0], rolled.speed_mps[0])

    def _eased(self, ego: EgoState, track: ProposalPath, front_m: float) -> IdmDriver:
        """The driver, who after a change does not brake to make up for a headway that is short but not closing."""
        if ego.time_s > self._eases_until_s:
            return self.driver
        near_m = track.occupied.near_m[:, 0]
        gap_m = float(np.min(near_m[near_m > front_m] - front_m, initial=np.inf))
        has_s = (gap_m - self.driver.min_gap_m) / max(ego.speed_mps, 1.0)
        shortest_s = min(self.settings.change_headway_s, self.driver.headway_s)
        return replace(self.driver, headway_s=min(max(has_s + EASING_STEP_S, shortest_s), self.driver.headway_s))


def _off_m(path: DrivingPath, ego: EgoState) -> float:
    """How far the ego is from a path; beyond its ends, from them."""
    return abs(path.line.project_point(ego.x_m, ego.y_m)[1])
