"""PDM-Closed: propose, simulate, score, drive the best (Dauner et al., CoRL 2023), with nuPlan's numbers.

"Parting with Misconceptions about Learning-based Vehicle Motion Planning", arXiv 2306.07962.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from interplan_planners.common.driven_route import DrivenRoute
from interplan_planners.common.idm_policy import IdmDriver
from interplan_planners.common.option_checks import at_least_0, more_than_0
from interplan_planners.common.paths import DrivingPath, centerline, shifted
from interplan_planners.common.pdm import PdmCorridor, PdmDecision, PdmMotion, PdmSettings
from interplan_planners.common.route_correction import DEPTH_FORWARD
from interplan_planners.common.route_search import lane_chain
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.geometry import Pose
from interplan_sumo.world.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class PdmClosedSettings:
    """Options, by default the published ones."""

    speed_fractions: Sequence[float] = (0.2, 0.4, 0.6, 0.8, 1.0)
    lateral_offsets_m: Sequence[float] = (0.0, -1.0, 1.0)
    """To the left."""
    fallback_limit_mps: float = 15.0
    """Where the map knows no limit."""
    min_gap_m: float = 1.0
    headway_s: float = 1.5
    max_acceleration_mps2: float = 1.5
    max_deceleration_mps2: float = 3.0
    exponent: float = 10.0
    horizon_s: float = 8.0
    proposal_horizon_s: float = 4.0
    emergency_within_s: float = 2.0
    emergency_speed_mps: float = 5.0
    emergency_deceleration_mps2: float = 4.05
    rebuild: bool = False
    """Make new paths at every step (PDM++)."""

    def __post_init__(self) -> None:
        more_than_0(
            fallback_limit_mps=self.fallback_limit_mps,
            max_acceleration_mps2=self.max_acceleration_mps2,
            max_deceleration_mps2=self.max_deceleration_mps2,
            exponent=self.exponent,
        )
        at_least_0(
            min_gap_m=self.min_gap_m,
            headway_s=self.headway_s,
            emergency_within_s=self.emergency_within_s,
            emergency_speed_mps=self.emergency_speed_mps,
        )
        if not self.lateral_offsets_m:
            raise ValueError("lateral_offsets_m must hold a number")


class PdmClosedPlanner:
    """Fifteen IDM drives along the centre line and beside it; the one that scores best is driven.

    At the first step the route is corrected and a shortest-way search over its
    lanes fixes the centre line for the episode, without lane changes. Proposals
    are the IDM at fractions of the speed limit on the centre line and on lines
    parallel to it, behind leads that go on at constant velocity; actors that
    touch the ego now are ignored, red connectors of the route stand in the way.
    Each proposal is driven with tracker and bicycle and scored with nuPlan's
    metrics. If the best one still hits something by its own fault within 2 s,
    and the ego is no faster than 5 m/s, it brakes with what comfort allows.

    As published, the rear axle is put on the path. Other than there a lead is
    sought from the first step on (the released code brakes during the first
    0.1 s of every proposal, for its table of leads starts empty), gaps are
    measured along the path instead of box to box, everyone who is seen counts
    (the released code drops who is more than 50 m away), who is ahead in the time to
    collision is asked at the ego's place instead of the place of contact, and an ego that is more than
    2.4 m from all paths brakes straight ahead instead of jumping back.
    """

    paper: ClassVar[str] = "Dauner et al. 2023"

    Settings = PdmClosedSettings

    def __init__(self, settings: PdmClosedSettings | None = None) -> None:
        self.settings = given = settings or PdmClosedSettings()
        driver = IdmDriver(
            given.fallback_limit_mps, given.min_gap_m, given.headway_s, given.max_acceleration_mps2,
            given.max_deceleration_mps2, given.exponent,
        )  # fmt: skip
        self.pdm = PdmSettings(
            tuple(given.speed_fractions),
            driver,
            given.horizon_s,
            given.proposal_horizon_s,
            given.emergency_within_s,
            given.emergency_speed_mps,
            given.emergency_deceleration_mps2,
        )
        self.decision: PdmDecision | None = None

    def start(self, mission: Mission) -> None:
        self._mission = mission
        self._motion = PdmMotion(self.pdm, mission.shape)
        self._route: DrivenRoute | None = None
        self.decision = None

    def plan(self, observation: Observation) -> Trajectory:
        axle = observation.ego.rear_axle(self._mission.shape)
        route = self._route
        if route is None:
            route = self._route = DrivenRoute(self._mission, axle, self.settings.fallback_limit_mps)
            self._lay_paths(route, axle)
        elif self.settings.rebuild:
            self._lay_paths(route, axle)
        _, lane_id = route.lane_at(axle)
        corridor = PdmCorridor(self._paths, self._center, route.ground, route.red_lights, route.limit_mps(lane_id))
        plan, self.decision = self._motion.plan(observation, corridor)
        return plan

    def _lay_paths(self, route: DrivenRoute, axle: Pose) -> None:
        """The centre line from the ego's lane on, and the lines beside it."""
        roads, (index, lane_id) = self._mission.roads, route.lane_at(axle)
        line = centerline(roads, lane_chain(roads, route.blocks, index, lane_id, shortest=True, depth=DEPTH_FORWARD))
        self._center = DrivingPath(line)
        self._paths = [
            DrivingPath(shifted(line, left_m)) if left_m else self._center for left_m in self.settings.lateral_offsets_m
        ]
