"""PDM with plenty of proposals, on the lanes beside, too (after Distelzweig et al., 2025).

"Perfect Prediction or Plenty of Proposals? What Matters Most in Planning for Autonomous Driving", arXiv 2510.15505.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from interplan_planners.common.driven_route import DrivenRoute
from interplan_planners.common.forecast import STEP_S, constant_velocity
from interplan_planners.common.gaps import GapRules
from interplan_planners.common.lane_routes import LaneRoute
from interplan_planners.common.mobil_options import ROOM_PER_CHANGE_M, ChangeStyle, Sight, options
from interplan_planners.common.neighbours import stands_for_good
from interplan_planners.common.option_checks import at_least_0, more_than_0
from interplan_planners.common.paths import DrivingPath, lane_change_path, shifted
from interplan_planners.common.pdm import DRIVER, PdmCorridor, PdmDecision, PdmMotion, PdmSettings
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.geometry import Polyline, Pose, wrap_angle
from interplan_sumo.world.trajectory import Trajectory

SHORTEST_SHIFT_M, SHORTEST_CHANGE_M = 8.0, 12.0
"""A move to the side takes at least so much way, within a lane and by a lane."""
ON_LINE_M, ON_LINE_RAD = 0.2, 0.03
"""Nearer than this to a line the ego is on it."""
BEHIND_M, AHEAD_S = 15.0, 16.0
"""So far behind the ego, and so much time ahead of it at the limit, a path is laid."""
KEPT_STEPS = 70
"""So long the path of the last step is gone on with; a drive of 8 s from there ends on it still."""
POLITENESS, CHANGE_HEADWAY_S = 0.5, 0.8
"""Of changes, as `idm_mobil` has them."""


@dataclass(frozen=True, slots=True)
class PdmProposalsSettings:
    """Options."""

    speed_fractions: Sequence[float] = (0.2, 0.4, 0.6, 0.8, 1.0)
    lateral_offsets_m: Sequence[float] = (0.0, -0.75, 0.75, -1.5, 1.5)
    """On the own lane, to the left."""
    change_times_s: Sequence[float] = (2.5, 3.5, 5.0)
    """Of driving at the present speed: how long a move to another lane takes; the first holds for offsets, too."""
    change_worth: float = 0.1
    urgent_worth: float = 0.2
    """What each lane change left to the goal takes from a score of 0 to 1, and how much more as room runs out."""
    resolve_worth: float = 0.03
    """What it adds to go on with the path of the last step."""
    safe_deceleration_mps2: float = 2.0
    """Who follows on another lane must not have to brake harder for a change."""
    fallback_limit_mps: float = 15.0
    """Where the map knows no limit."""

    def __post_init__(self) -> None:
        more_than_0(
            safe_deceleration_mps2=self.safe_deceleration_mps2,
            fallback_limit_mps=self.fallback_limit_mps,
            **{f"change_times_s[{i}]": time_s for i, time_s in enumerate(self.change_times_s)},
        )
        at_least_0(change_worth=self.change_worth, urgent_worth=self.urgent_worth, resolve_worth=self.resolve_worth)
        for name in ("lateral_offsets_m", "change_times_s"):
            if not getattr(self, name):
                raise ValueError(f"{name} must hold a number")


@dataclass(frozen=True, slots=True, eq=False)
class _Proposed:
    """A path, and the way along the route that it leads to."""

    path: DrivingPath
    way: LaneRoute
    worth: float = 0.0
    """Added to the scores of drives on it."""
    steps: int = 0
    """Since it was laid."""


class PdmProposalsPlanner:
    """PDM-Closed with up to sixty proposals instead of fifteen, made anew in every step, and lanes to choose from.

    The idea is SPDM's: what PDM lacks is not a better forecast, but proposals that are
    worth driving. Its simulation, its scoring, its forecast at constant velocity and
    its emergency brake are kept. Of which proposals SPDM's sixty consist we do not know;
    here they are the own lane with five offsets, each lane beside in changes of three
    lengths, and the path of the last step, at five speeds each. SPDM was made for
    followers who brake in any case; here they need not, so a lane beside is proposed
    only if MOBIL's criterion holds it for safe. And since a score says nothing of where the goal
    is, each lane change that is left to it makes a proposal worth less, the more so the
    less room there is.
    """

    paper: ClassVar[str] = "after Distelzweig et al. 2025"

    Settings = PdmProposalsSettings

    def __init__(self, settings: PdmProposalsSettings | None = None) -> None:
        self.settings = given = settings or PdmProposalsSettings()
        self.pdm = PdmSettings(tuple(given.speed_fractions))
        self._style = ChangeStyle(
            replace(DRIVER, headway_s=CHANGE_HEADWAY_S), GapRules(), POLITENESS, given.safe_deceleration_mps2
        )
        self.decision: PdmDecision | None = None

    def start(self, mission: Mission) -> None:
        self._mission = mission
        self._motion = PdmMotion(self.pdm, mission.shape)
        self._route: DrivenRoute | None = None
        self._present: _Proposed | None = None
        self.decision = None

    def plan(self, observation: Observation) -> Trajectory:
        axle = observation.ego.rear_axle(self._mission.shape)
        route = self._route = self._route or DrivenRoute(self._mission, axle, self.settings.fallback_limit_mps)
        _, lane_id = at = route.lane_at(axle)
        own, limit_mps = route.ways.from_lane(*at), route.limit_mps(lane_id)
        proposed = list(self._proposed(observation, route, at))
        corridor = PdmCorridor(
            [each.path for each in proposed], own.path, route.ground, route.red_lights, limit_mps,
            tuple(each.worth for each in proposed),
        )  # fmt: skip
        plan, self.decision = self._motion.plan(observation, corridor)
        decision, speeds = self.decision, len(self.settings.speed_fractions)
        self._present = None if decision is None else proposed[decision.best // speeds]
        return plan

    def _proposed(self, observation: Observation, route: DrivenRoute, at: tuple[int, str]) -> Iterator[_Proposed]:
        """The paths of this step: that of the last one, if it may be driven still, the own lane's, and others'."""
        ego, shape, given = observation.ego, self._mission.shape, self.settings
        (index, lane_id), own = at, route.ways.from_lane(*at)
        axle, ahead_m = ego.rear_axle(shape), AHEAD_S * max(route.limit_mps(lane_id), ego.speed_mps)
        sight = Sight(
            ego, shape, constant_velocity(observation.actors, STEP_S), stands_for_good(observation), route.red_lights,
            route.red_lights.closed(observation.signals, ego, shape),
        )  # fmt: skip
        here = sight.on(own)
        others = options(sight, route.ways, here, index, lane_id, self._style)
        safe = [each.there.way for each in others if each.verdict.safe]
        lanes = {lane_id, *(way.lanes[0] for way in safe)}
        if self._present is not None and self._present.steps < KEPT_STEPS:
            way, steps = self._present.way, self._present.steps + 1
            if (lane := next((lane for lane in way.lanes if lane in lanes), None)) is not None:
                worth = self._worth(route, lane, here.room_m) + given.resolve_worth
                yield replace(self._present, worth=worth, steps=steps)
        worth = self._worth(route, lane_id, here.room_m)
        line = _near(own, axle, ahead_m)
        for offset_m in given.lateral_offsets_m:
            way_m = max(given.change_times_s[0] * ego.speed_mps, SHORTEST_SHIFT_M)
            yield _Proposed(_towards(shifted(line, offset_m) if offset_m else line, axle, way_m), own, worth)
        for way in safe:
            worth = self._worth(route, way.lanes[0], here.room_m)
            line = _near(way, axle, ahead_m)
            for time_s in given.change_times_s:
                way_m = max(time_s * ego.speed_mps, SHORTEST_CHANGE_M)
                yield _Proposed(_towards(line, axle, way_m), way, worth)

    def _worth(self, route: DrivenRoute, lane_id: str, room_m: float) -> float:
        """Of a lane, with so much room left for the changes from it to the goal; 0 on the goal's lane, else less."""
        needed = route.ways.changes_needed.get(lane_id, len(route.blocks))
        urgency = max(0.0, 1.0 - room_m / (ROOM_PER_CHANGE_M * max(needed, 1)))
        return -needed * (self.settings.change_worth + self.settings.urgent_worth * urgency)


def _near(way: LaneRoute, axle: Pose, ahead_m: float) -> Polyline:
    """What of the line of a way lies around the ego, which is on its first lane or beside it.

    Looked for there only: a long way may come back to where the ego is.
    """
    line = way.path.line
    first_m = float(way.starts_m[1]) if len(way.starts_m) > 1 else line.length_m
    arc_m, _ = line.between(0.0, first_m + BEHIND_M).project_point(axle.x_m, axle.y_m)
    return line.between(arc_m - BEHIND_M, arc_m + ahead_m)


def _towards(line: Polyline, axle: Pose, way_m: float) -> DrivingPath:
    """To a line and along it, from a pose beside it."""
    arc_m, left_m = line.project_point(axle.x_m, axle.y_m)
    turned = float(wrap_angle(axle.heading_rad - line.pose_at(arc_m).heading_rad))
    if abs(left_m) < ON_LINE_M and abs(turned) < ON_LINE_RAD:
        return DrivingPath(line)
    return DrivingPath(lane_change_path(line, axle, way_m))
