"""PDM-Closed: propose, simulate, score, drive the best (Dauner et al., CoRL 2023), with nuPlan's numbers.

"Parting with Misconceptions about Learning-based Vehicle Motion Planning", arXiv 2306.07962.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from interplan_planners.common.contacts import touched_now
from interplan_planners.common.forecast import STEP_S, Forecast, constant_velocity, nearest
from interplan_planners.common.ground import Ground
from interplan_planners.common.idm_policy import IdmDriver
from interplan_planners.common.occupancy import occupancy
from interplan_planners.common.paths import (
    Path,
    braking_plan,
    center_poses,
    centerline,
    rear_axle_plan,
    shifted,
)
from interplan_planners.common.red_lights import RedLights
from interplan_planners.common.rollout import Rollout, Track, roll_out
from interplan_planners.common.route_correction import DEPTH_FORWARD, corrected_route
from interplan_planners.common.route_search import LaneFinder, lane_chain, lanes_of_route
from interplan_planners.common.scoring import LOOK_AHEAD_S, Scores, score
from interplan_sumo.dynamics.batch import Drives, follow_all
from interplan_sumo.dynamics.lqr import GRID_S
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Floats, Ints, Pose
from interplan_sumo.world.trajectory import Trajectory

FARTHEST_FROM_PATH_M = 2.4
"""Where a path would put the ego's centre farther than this from where it is, it is no option but a teleport."""


@dataclass(frozen=True, slots=True, eq=False)
class PdmDecision:
    """What was proposed at the last step, and what came of it."""

    drives: Drives
    """Simulated proposals, in order of offsets, then of speed fractions."""
    scores: Scores
    best: int
    braking: bool
    """Whether the emergency brake took over."""


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
    measured along the path instead of box to box, and an ego that is more than
    2.4 m from all paths brakes straight ahead instead of jumping back.
    """

    paper: ClassVar[str] = "Dauner et al. 2023"

    def __init__(
        self,
        speed_fractions: Sequence[float] = (0.2, 0.4, 0.6, 0.8, 1.0),
        lateral_offsets_m: Sequence[float] = (0.0, -1.0, 1.0),
        fallback_limit_mps: float = 15.0,
        min_gap_m: float = 1.0,
        headway_s: float = 1.5,
        max_acceleration_mps2: float = 1.5,
        max_deceleration_mps2: float = 3.0,
        exponent: float = 10.0,
        horizon_s: float = 8.0,
        proposal_horizon_s: float = 4.0,
        emergency_within_s: float = 2.0,
        emergency_speed_mps: float = 5.0,
        emergency_deceleration_mps2: float = 4.05,
        rebuild: bool = False,
    ) -> None:
        """Defaults are the published ones; offsets are to the left. `rebuild` makes new paths at every step (PDM++).

        `fallback_limit_mps` holds where the map knows no limit.
        """
        positive = {
            "fallback_limit_mps": fallback_limit_mps,
            "max_acceleration_mps2": max_acceleration_mps2,
            "max_deceleration_mps2": max_deceleration_mps2,
            "proposal_horizon_s": proposal_horizon_s,
            "emergency_deceleration_mps2": emergency_deceleration_mps2,
            **{f"speed_fractions[{i}]": fraction for i, fraction in enumerate(speed_fractions)},
        }
        for name, value in positive.items():
            if not value > 0:
                raise ValueError(f"{name} is {value}, expected more than 0")
        if not speed_fractions or not lateral_offsets_m:
            raise ValueError("speed_fractions and lateral_offsets_m must each hold a number")
        if horizon_s < proposal_horizon_s:
            raise ValueError(f"horizon_s is {horizon_s}, expected at least proposal_horizon_s, {proposal_horizon_s}")
        self.speed_fractions = tuple(speed_fractions)
        self.lateral_offsets_m = tuple(lateral_offsets_m)
        self.fallback_limit_mps = fallback_limit_mps
        self.driver = IdmDriver(
            fallback_limit_mps, min_gap_m, headway_s, max_acceleration_mps2, max_deceleration_mps2, exponent
        )
        self.horizon_s = horizon_s
        self.proposal_horizon_s = proposal_horizon_s
        self.emergency_within_s = emergency_within_s
        self.emergency_speed_mps = emergency_speed_mps
        self.emergency_deceleration_mps2 = emergency_deceleration_mps2
        self.rebuild = rebuild
        self.decision: PdmDecision | None = None

    def start(self, mission: Mission) -> None:
        self._mission = mission
        self._route: tuple[str, ...] = ()
        self.decision = None

    def plan(self, seen: Observation) -> Trajectory:
        ego, shape = seen.ego, self._mission.shape
        axle = ego.rear_axle(shape)
        if not self._route:
            self._begin(axle)
            self._lay_paths(axle)
        elif self.rebuild:
            self._lay_paths(axle)
        _, lane_id = self._lanes.at(axle.x_m, axle.y_m, axle.heading_rad)
        limit_mps = self._mission.roads[lane_id].speed_limit_mps or self.fallback_limit_mps

        starts_m = np.array([path.line.project_point(axle.x_m, axle.y_m)[0] for path in self._paths])
        far_off = self._jumps_m(ego, starts_m) > FARTHEST_FROM_PATH_M
        if far_off.all():
            self.decision = None
            return braking_plan(ego, self.driver.max_deceleration_mps2, self.horizon_s, GRID_S)

        forecast = constant_velocity(nearest(seen.actors, ego.x_m, ego.y_m), self.horizon_s + LOOK_AHEAD_S[-1])
        ignore = touched_now(ego, forecast, shape)
        closed = self._red_lights.closed(seen.signals, ego, shape)
        fractions = len(self.speed_fractions)
        path_of = np.repeat(np.arange(len(self._paths)), fractions)
        targets_mps = np.tile(limit_mps * np.array(self.speed_fractions), len(self._paths))
        reach_m = float(targets_mps.max()) * self.horizon_s
        tracks = [
            self._track(i, arc_m, reach_m, forecast.between(0.0, self.proposal_horizon_s), ignore, closed)
            for i, arc_m in enumerate(starts_m.tolist())
        ]
        progress_m = starts_m[path_of]
        rolled = self._roll_out(tracks, path_of, progress_m, ego.speed_mps, targets_mps, 0.0, self.proposal_horizon_s)
        drives = follow_all(ego, *center_poses(self._paths, path_of, rolled.progress_m, shape), shape=shape)
        scores = score(drives, forecast, self._ground, self._center, shape, ignore=ignore)
        best = int(np.where(far_off[path_of], -1.0, scores.total).argmax())
        braking = (
            float(scores.collision_s[best]) <= self.emergency_within_s
            and abs(ego.speed_mps) <= self.emergency_speed_mps
        )
        self.decision = PdmDecision(drives, scores, best, braking)
        if braking:
            # the tracker answers with 10/11 of the change of speed that a plan asks for within the next second
            return braking_plan(ego, 1.1 * self.emergency_deceleration_mps2, self.horizon_s, GRID_S)
        return self._extended(ego, best, int(path_of[best]), rolled, targets_mps, forecast, ignore, closed, reach_m)

    def _begin(self, axle: Pose) -> None:
        """Correct the route for the episode."""
        roads = self._mission.roads
        self._route = corrected_route(roads, self._mission.route, axle)
        self._lanes = LaneFinder(roads, self._route)
        self._ground = Ground(roads, lanes_of_route(roads, self._route))

    def _lay_paths(self, axle: Pose) -> None:
        """The centre line from the ego's lane on, and the lines beside it."""
        roads, shape = self._mission.roads, self._mission.shape
        index, lane_id = self._lanes.at(axle.x_m, axle.y_m, axle.heading_rad)
        line = centerline(roads, lane_chain(roads, self._route, index, lane_id, shortest=True, depth=DEPTH_FORWARD))
        self._center = Path(line)
        self._paths = [Path(shifted(line, left_m)) if left_m else self._center for left_m in self.lateral_offsets_m]
        self._red_lights = RedLights(roads, lanes_of_route(roads, self._route), shape.width_m / 2)

    def _jumps_m(self, ego: EgoState, starts_m: Floats) -> Floats:
        """(P,) how far from the ego's centre each path would put it, with the rear axle at arc lengths (P,)."""
        rows = np.arange(len(self._paths))
        x_m, y_m, _ = center_poses(self._paths, rows, starts_m[:, None], self._mission.shape)
        return np.hypot(x_m[:, 0] - ego.x_m, y_m[:, 0] - ego.y_m)

    def _track(
        self,
        i: int,
        start_m: float,
        reach_m: float,
        forecast: Forecast,
        ignore: NDArray[np.bool_],
        closed: tuple[str, ...],
    ) -> Track:
        """One of the paths and all that may lead on it."""
        path = self._paths[i]
        half_width_m = self._mission.shape.width_m / 2
        stretch = (start_m - half_width_m, start_m + reach_m + half_width_m)  # square caps, as published
        occupied = occupancy(path, half_width_m, forecast, stretch, ignore)
        return Track(path.length_m, occupied, self._red_lights.on_path(path, closed))

    def _roll_out(
        self,
        tracks: list[Track],
        path_of: Ints,
        progress_m: Floats,
        speed_mps: ArrayLike,
        targets_mps: Floats,
        start_s: float,
        end_s: float,
    ) -> Rollout:
        shape, steps = self._mission.shape, round((end_s - start_s) / GRID_S)
        rear_m = shape.length_m - shape.front_m
        instants = np.floor(GRID_S * np.arange(steps + 1) / STEP_S + 1e-6).astype(np.int64)
        return roll_out(
            tracks, path_of, progress_m, speed_mps, targets_mps, self.driver, shape.front_m, rear_m, steps, instants
        )

    def _extended(
        self,
        ego: EgoState,
        best: int,
        path: int,
        rolled: Rollout,
        targets_mps: Floats,
        forecast: Forecast,
        ignore: NDArray[np.bool_],
        closed: tuple[str, ...],
        reach_m: float,
    ) -> Trajectory:
        """The best proposal, driven on to the full horizon."""
        progress_m, speed_mps = rolled.progress_m[best], rolled.speed_mps[best]
        if self.horizon_s > self.proposal_horizon_s:
            later = forecast.between(self.proposal_horizon_s, self.horizon_s)
            track = self._track(path, float(progress_m[0]), reach_m, later, ignore, closed)
            more = self._roll_out(
                [track], np.zeros(1, dtype=np.int64), progress_m[-1:], speed_mps[-1], targets_mps[best : best + 1],
                self.proposal_horizon_s, self.horizon_s,
            )  # fmt: skip
            progress_m = np.concatenate((progress_m, more.progress_m[0, 1:]))
            speed_mps = np.concatenate((speed_mps, more.speed_mps[0, 1:]))
        time_s = ego.time_s + GRID_S * np.arange(len(progress_m))
        return rear_axle_plan(self._paths[path].line, time_s, progress_m, speed_mps, self._mission.shape)
