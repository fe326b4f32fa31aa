"""The planner: what could be done, how it would go, and which of it costs least."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, hypot, inf, sin

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.neighbours import moved
from interplan_planners.common.occupancy import StripOccupancy
from interplan_planners.common.option_checks import more_than_0
from interplan_planners.common.paths import braking_plan, rear_axle_plan
from interplan_planners.common.steadied import steadied
from interplan_planners.foresight.candidate_paths import RUN_IN_M, Base, CandidatePath
from interplan_planners.foresight.caution import gap_wait_m, red_stops, soonest_stop_m, waiting_m
from interplan_planners.foresight.checking import CHECKED_S, TRACKED_AHEAD_S, checked_costs, finer
from interplan_planners.foresight.costs import speed_costs
from interplan_planners.foresight.foreseen import KEPT_S, Budget, Foreseen
from interplan_planners.foresight.hidden_people import cautious_limits, hiders_near
from interplan_planners.foresight.manoeuvres import NEW_LANE_M, ManoeuvreOption, Manoeuvres
from interplan_planners.foresight.merging import leads_beside, prospects, wished_changes
from interplan_planners.foresight.prediction import MOVING_MPS, STEP_S, Prediction
from interplan_planners.foresight.scene import PlanningScene
from interplan_planners.foresight.speeds import Drafts, drafted
from interplan_planners.foresight.st_obstacles import Stage, occupied_base, staged
from interplan_planners.foresight.static_classification import StandingGroup, Stillness
from interplan_planners.foresight.unseen import HiddenPlaces, hidden_places
from interplan_sumo.dynamics.lqr import GRID_S
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory

FARTHEST_FROM_PLAN_M = 2.2
"""Beyond this the ego has lost its path; a plan along it would be a teleport."""
LOST_BRAKING_MPS2 = 3.0
MOST_CHECKED, MOST_OF_A_COURSE = 7, 2
"""How many drafts get a close look, and how many of one candidate before those of others have had theirs."""
ALIKE_M = 0.2
"""Drafts of one candidate that get no farther apart are the same: one of them is looked at."""
GOING_ON = 0.5
"""What it is worth to go on with the present candidate, in points of progress."""
SETTLED_M = 6.0
"""After a candidate has come back to its base the rest of the car comes back as well."""
PATIENCE_S, WAITING_MPS = 4.0, 1.5
"""How long the ego waits before something for somebody who might come, and what is waiting."""
RESTLESS_PER_S, MOST_RESTLESS, RESTED_M = 0.5, 6.0, 5.0
"""What it is worth to pass something, in points of progress, the longer the ego has waited: no wait is for ever. All of
it counts if the ego comes as far as the last."""
ARRIVED_M = 2.0
"""Who is farther than this beyond the goal, or beyond the end of its way along the route, stops."""
SETS_IN_S = 0.7
"""A drive begins that gently."""
OUT_M = 3.0
"""So far before it is beside all of the offset, the ego is out of its lane: what comes next is the way back."""
TAIL_M = 1.4
"""Who is no farther than this from the line of the ego's lane, and to the side of the ego, follows it."""


@dataclass(frozen=True, slots=True)
class ForesightDecision:
    """What the last round of planning decided."""

    manoeuvre: str
    """keep, change or pass."""
    yields: int
    """To how many the ego gives way."""
    cost: float
    """In points of progress: ten are the way that the limit allows within the horizon."""
    options: tuple[tuple[str, float], ...]
    """The drafts that were looked at closely, cheapest first."""
    waits_for_gap: bool
    """Whether there is a lane that the ego would like to be on."""


class ForesightPlanner:
    """Samples manoeuvres and speeds, forecasts the others along their lanes, and drives what costs least.

    Every `replan_s` it lays out candidates: keep the lane, change it to either
    side, pass what stands in the way on either side with an offset and come
    back, or give up what has been begun. Each is combined with some dozen speed
    profiles: the IDM behind whoever leads, capped in several ways, and giving
    way to none, some or all of those who cross, come towards it or drive on the
    lane that it wants. All are rolled out at once over `horizon_s` against a
    forecast of the others along their lanes; progress, effort, contacts, what
    others have to brake and the lane changes left to the goal make the cost. The
    best are driven with tracker and bicycle and judged by the benchmark's own
    terms; the cheapest is driven.

    Who has not moved for 2 s and has no reason to wait is taken to stay; who may
    have one is given room, and who rides a bicycle is passed like what stands. What
    a gap is worth is asked of measured drivers. Before the oncoming lane is
    used, somebody is assumed to come from the end of sight. Where somebody may
    step out from behind what stands beside the way the ego is slow enough to stop.
    """

    def __init__(
        self,
        horizon_s: float = 8.0,
        replan_s: float = 0.2,
        fallback_limit_mps: float = 13.0,
        change_time_s: float = 3.6,
        budget: Budget = "normal",
    ) -> None:
        """`fallback_limit_mps` holds where the map knows no limit; a lane change takes `change_time_s` at speed.

        On the budget `fast` a plan is kept for longer while the world is as it was foreseen.
        """
        more_than_0(replan_s=replan_s, fallback_limit_mps=fallback_limit_mps, change_time_s=change_time_s)
        shortest_s = CHECKED_S + TRACKED_AHEAD_S
        if not horizon_s >= shortest_s:
            raise ValueError(f"horizon_s is {horizon_s}, expected at least {shortest_s:g}")
        self.horizon_s = horizon_s
        self.replan_s = replan_s
        self.fallback_limit_mps = fallback_limit_mps
        self.change_time_s = change_time_s
        self.budget: Budget = budget
        self.decision: ForesightDecision | None = None

    def start(self, mission: Mission) -> None:
        self._mission = mission
        self._prediction = Prediction(mission.roads)
        self._stillness = Stillness()
        self._manoeuvres: Manoeuvres | None = None
        self._candidate: CandidatePath | None = None
        self._plan: Trajectory | None = None
        self._foreseen: Foreseen | None = None
        self._looked_s = -inf
        self._kept_rounds = 0
        self._waited_s = 0.0
        self.decision = None

    def plan(self, observation: Observation) -> Trajectory:
        if self._plan is None or _strayed_m(self._plan, observation.ego) > FARTHEST_FROM_PLAN_M:
            return self._anew(observation)
        if observation.time_s - self._looked_s < self.replan_s - 1e-6:
            return self._plan
        if self._foreseen is None or not self._foreseen.still(observation):
            return self._anew(observation)
        self._kept_rounds += 1
        self._looked_s = observation.time_s
        return self._plan

    def _anew(self, observation: Observation) -> Trajectory:
        """A new plan."""
        observation = steadied(observation)
        self._foreseen = None
        self._plan = self._planned(observation)
        self._looked_s, self._kept_rounds = observation.time_s, 0
        return self._plan

    # --- one round of planning -----------------------------------------------------------------

    def _planned(self, observation: Observation) -> Trajectory:
        ego, shape = observation.ego, self._mission.shape
        if self._manoeuvres is None:
            self._manoeuvres = Manoeuvres(self._mission, ego, self.fallback_limit_mps, self.change_time_s)
        candidate = self._current(self._manoeuvres, ego)
        self._candidate = candidate
        if self._off_m(candidate, ego) > FARTHEST_FROM_PLAN_M:
            self.decision = None
            return braking_plan(ego, LOST_BRAKING_MPS2, self.horizon_s + self.replan_s, STEP_S)
        # a plan is kept until the next round and should still reach as far then
        traffic = self._prediction.traffic(observation, shape, self.horizon_s + self.replan_s)
        scene = PlanningScene(
            observation, shape, traffic, *self._stillness.found(observation, traffic, self._prediction)
        )
        options, blocked = self._manoeuvres.options(scene, candidate)
        # where the ego stands across its lane not every candidate can begin at it
        options = [option for option in options if self._off_m(option.candidate, ego) <= FARTHEST_FROM_PLAN_M]
        return self._best(scene, self._manoeuvres, options, blocked)

    def _current(self, manoeuvres: Manoeuvres, ego: EgoState) -> CandidatePath:
        """The candidate as it stands now: it may be done, or lost."""
        candidate = self._candidate
        if candidate is None or self._off_m(candidate, ego) > FARTHEST_FROM_PLAN_M:
            return manoeuvres.here(ego)
        axle = ego.rear_axle(self._mission.shape)
        arc_m, _ = candidate.path.line.project_point(axle.x_m, axle.y_m)
        if candidate.settles_m > 0.0 and arc_m > candidate.settles_m + SETTLED_M:
            candidate = manoeuvres.kept(candidate.base)
        if candidate is manoeuvres.kept(candidate.base):
            return manoeuvres.kept(manoeuvres.onward(candidate.base, arc_m))
        out = abs(candidate.offset_m) > NEW_LANE_M and arc_m > candidate.beside_m[0] - OUT_M
        if candidate.kind == "pass" and out and candidate.new is not candidate.base:
            return candidate.returning()
        if candidate.kind == "change" and arc_m > candidate.merged_m and ego.speed_mps < WAITING_MPS:
            return manoeuvres.back_to(candidate.base, ego)  # where it may have to wait for the next change
        return candidate

    def _off_m(self, candidate: CandidatePath, ego: EgoState) -> float:
        """How far the centre is from where a plan along a candidate begins: the rear axle on it, turned as it is."""
        shape = self._mission.shape
        axle = ego.rear_axle(shape)
        arc_m, _ = candidate.path.line.project_point(axle.x_m, axle.y_m)
        at = candidate.path.line.pose_at(arc_m)
        ahead_m = shape.rear_axle_to_center_m
        x_m, y_m = at.x_m + ahead_m * cos(at.heading_rad), at.y_m + ahead_m * sin(at.heading_rad)
        return hypot(x_m - ego.x_m, y_m - ego.y_m)

    def _best(
        self,
        scene: PlanningScene,
        manoeuvres: Manoeuvres,
        options: list[ManoeuvreOption],
        blocked: StandingGroup | None,
    ) -> Trajectory:
        """The plan that costs least; its candidate becomes the present one."""
        ego, shape = scene.ego, scene.shape
        base = options[0].candidate.base
        base_m, _ = base.line.project_point(ego.x_m, ego.y_m)
        lawful_mps = float(base.limit_mps[min(int(base_m), len(base.limit_mps) - 1)])
        reach_m = (max(lawful_mps, scene.speed_mps) + 3.0) * self.horizon_s + shape.length_m
        stages = self._stages(scene, [option.candidate for option in options], reach_m, blocked)
        wished = wished_changes(options)
        leads = leads_beside(stages, wished)
        sets_in = ego.time_s - manoeuvres.began_s < SETS_IN_S
        drafts = drafted(stages, ego.speed_mps, ego.ax_mps2, shape, leads, sets_in=sets_in)
        impatience = self._impatience(scene, options[0].candidate, blocked is not None or bool(wished))
        cost = speed_costs(stages, drafts, shape, lawful_mps, impatience)
        cost -= self._worth(options, drafts)
        cost -= np.where(drafts.stage_of == 0, GOING_ON, 0.0) + prospects(drafts, stages, wished, shape)

        chosen = _chosen(cost, drafts)
        total = cost[chosen] + checked_costs(scene, stages, drafts, chosen, manoeuvres.route.ground)
        order = np.argsort(total, kind="stable").tolist()
        best = chosen[order[0]]
        candidate = options[int(drafts.stage_of[best])].candidate
        self._candidate = candidate
        names = tuple((_name(options, drafts, chosen[i]), float(total[i])) for i in order)
        self.decision = ForesightDecision(candidate.kind, len(drafts.yields[best]), names[0][1], names, bool(wished))
        arc_m = finer(drafts.arc_m[best : best + 1], drafts.speed_mps[best : best + 1])[0]
        ahead_s = GRID_S * np.arange(len(arc_m))
        speed_mps = np.interp(ahead_s, STEP_S * np.arange(drafts.arc_m.shape[1]), drafts.speed_mps[best])
        plan = rear_axle_plan(candidate.path.line, ego.time_s + ahead_s, arc_m, speed_mps, shape)
        free_s, busy_s = KEPT_S[self.budget]
        ends = base.ends_m - base_m < ARRIVED_M + free_s * scene.speed_mps
        busy = ends or blocked is not None or bool(wished) or candidate.kind != "keep"
        self._foreseen = Foreseen(scene.seen, scene.traffic.forecast, plan, busy_s if busy else free_s)
        return plan

    def _worth(self, options: Sequence[ManoeuvreOption], drafts: Drafts) -> Floats:
        """(N,) what the options are worth, in points of progress: a change if it is done within the horizon."""
        of, end_m = drafts.stage_of, drafts.arc_m[:, -1]
        worth, begun, merged_m = np.array([(o.worth, o.begun, o.candidate.merged_m) for o in options]).T
        kind = np.array([option.candidate.kind for option in options])[of]
        left = worth[0] if options[0].candidate.old is None else worth.min()
        done = (kind != "change") | (end_m >= merged_m[of])
        restless = min(RESTLESS_PER_S * self._waited_s, MOST_RESTLESS) * np.minimum(
            (end_m - drafts.arc_m[:, 0]) / RESTED_M, 1.0
        )
        return (
            np.where(done, worth[of], np.minimum(worth[of], left)) + begun[of] + np.where(kind == "pass", restless, 0.0)
        )

    def _impatience(self, scene: PlanningScene, present: CandidatePath, waits: bool) -> float:
        """0 to 1: how long the ego has been waiting before what blocks its way, or for a gap.

        For a gap that counts until the change is over. What was to be passed and has gone on is no longer waited for.
        """
        if not waits and present.kind != "change":
            self._waited_s = 0.0
        elif waits and scene.speed_mps < WAITING_MPS:
            self._waited_s += (1 + self._kept_rounds) * self.replan_s
        return min(self._waited_s / PATIENCE_S, 1.0)

    # --- who is in the way ---------------------------------------------------------------------

    def _stages(
        self,
        scene: PlanningScene,
        candidates: Sequence[CandidatePath],
        reach_m: float,
        blocked: StandingGroup | None,
    ) -> list[Stage]:
        """The candidates with everybody who will be on them."""
        shape, axle = scene.shape, scene.axle
        present = candidates[0]
        tail = _tail(scene, present.old if present.old is not None else present.base)
        beside_of: dict[int, tuple[StripOccupancy, HiddenPlaces]] = {}
        hiders, found = hiders_near(scene), list[Stage]()
        for candidate in candidates:
            arc_m, _ = candidate.path.line.project_point(axle.x_m, axle.y_m)
            at_m, _ = candidate.base.line.project_point(axle.x_m, axle.y_m)
            beside, hidden = None, None
            if candidate.new is not None:
                new_m, _ = candidate.new.line.project_point(axle.x_m, axle.y_m)
                if id(candidate.new) not in beside_of:
                    stretch = (new_m - 60.0, new_m + reach_m)
                    seen = occupied_base(candidate.new, scene.traffic, shape, stretch)
                    beside_of[id(candidate.new)] = seen, hidden_places(scene, candidate.new, new_m)
                seen, places = beside_of[id(candidate.new)]
                beside, hidden = moved(seen, arc_m - new_m), places.moved(arc_m - new_m)
            stops_m = red_stops(scene, candidate.base, at_m)
            front_m, move_m = at_m + shape.front_m, max(candidate.merged_m - arc_m, 0.0)
            held_m = gap_wait_m(candidate.base, front_m, move_m, scene.speed_mps)
            if held_m is not None:
                stops_m.append(held_m)
            if at_m > candidate.base.ends_m + ARRIVED_M:
                stops_m.append(soonest_stop_m(front_m, scene.speed_mps))
            if candidate.kind == "keep" and blocked is not None and candidate.base is blocked.base:
                stops_m.append(waiting_m(blocked, front_m, scene.speed_mps, shape))
            limit_mps = cautious_limits(candidate, arc_m, scene, hiders)
            stops_m = [stop_m + arc_m - at_m for stop_m in stops_m]
            found.append(staged(candidate, arc_m, limit_mps, stops_m, scene, tail, reach_m, beside, hidden))
        return found


def _strayed_m(plan: Trajectory, ego: EgoState) -> float:
    """How far the ego is from where a plan has it now."""
    x_m, y_m = np.interp(ego.time_s, plan.time_s, plan.x_m), np.interp(ego.time_s, plan.time_s, plan.y_m)
    return hypot(x_m - ego.x_m, y_m - ego.y_m)


def _tail(scene: PlanningScene, base: Base) -> NDArray[np.bool_]:
    """(A,) who comes behind the ego on the lane of a base: they follow it, unless it is beside that lane."""
    ego, actors, traffic = scene.ego, scene.traffic.actors, scene.traffic
    base_m, left_m = base.line.project_point(ego.x_m, ego.y_m)
    s, d = base.path.project(actors.x_m, actors.y_m)
    lanes = frozenset(base.way.lanes)
    own = np.array([lane in lanes for lane in traffic.lane_of], dtype=np.bool_) | (s <= RUN_IN_M)
    moves = (actors.kind == ActorKind.VEHICLE) & (actors.speed_mps > MOVING_MPS)
    return moves & own & (np.abs(d) < TAIL_M) & (np.abs(d - left_m) < TAIL_M) & (s < base_m - 1.0)


def _chosen(cost: Floats, drafts: Drafts) -> list[int]:
    """The drafts to look at closely: the cheapest that differ, at first few of a candidate, and the emergency brake."""
    of, left = drafts.stage_of, np.ones(len(cost), dtype=np.bool_)
    taken = np.zeros(int(of.max()) + 1, dtype=np.int64)
    chosen: list[int] = []
    for most in (MOST_OF_A_COURSE, MOST_CHECKED):
        while len(chosen) < MOST_CHECKED and (free := left & (taken[of] < most)).any():
            best = int(np.where(free, cost, inf).argmin())
            chosen.append(best)
            taken[of[best]] += 1
            mates = np.flatnonzero(of == of[best])
            left[mates[np.abs(drafts.arc_m[mates] - drafts.arc_m[best]).max(axis=1) < ALIKE_M]] = False
    hard = int(np.flatnonzero(drafts.urgent)[0])
    return chosen if hard in chosen else [*chosen, hard]


def _name(options: Sequence[ManoeuvreOption], drafts: Drafts, n: int) -> str:
    """A draft in words."""
    candidate = options[int(drafts.stage_of[n])].candidate
    words: list[str] = [candidate.kind]
    if candidate.kind == "change":
        words.append(f"to {candidate.base.way.lanes[0]}")
    if candidate.kind == "pass":
        words.append(f"{candidate.offset_m:+.1f} m")
    if drafts.yields[n]:
        words.append("yield to " + " ".join(map(str, drafts.yields[n])))
    if drafts.cap[n].for_s:
        words.append(f"at most {drafts.cap[n].most_mps2:g} m/s2 for {drafts.cap[n].for_s:g} s")
    return ", ".join(words)
