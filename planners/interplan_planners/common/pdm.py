"""PDM's motion: propose drives along given paths, simulate them, score them, drive the best (Dauner et al., 2023)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.contacts import touched_now
from interplan_planners.common.forecast import STEP_S, Forecast, constant_velocity, nearest
from interplan_planners.common.ground import Ground
from interplan_planners.common.idm_policy import IdmDriver
from interplan_planners.common.occupancy import Strip, occupancies
from interplan_planners.common.option_checks import more_than_0
from interplan_planners.common.paths import DrivingPath, braking_plan, center_poses, rear_axle_plan
from interplan_planners.common.red_lights import RedLights
from interplan_planners.common.rollout import ProposalPath, Rollout, RolloutClock, RolloutStart, roll_out
from interplan_planners.common.scoring import LOOK_AHEAD_S, Scores, score
from interplan_sumo.dynamics.batch import SimulatedDrives, follow_all
from interplan_sumo.dynamics.lqr import GRID_S
from interplan_sumo.planner import Observation
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory

FARTHEST_FROM_PATH_M = 2.4
"""Where a path would put the ego's centre farther than this from where it is, it is no option but a teleport."""

DRIVER = IdmDriver(
    15.0, min_gap_m=1.0, headway_s=1.5, max_acceleration_mps2=1.5, max_deceleration_mps2=3.0, exponent=10.0
)


@dataclass(frozen=True, slots=True)
class PdmSettings:
    """PDM's numbers; defaults are the published ones."""

    speed_fractions: tuple[float, ...] = (0.2, 0.4, 0.6, 0.8, 1.0)
    """Of the limit: the speeds that are proposed on each path."""
    driver: IdmDriver = DRIVER
    horizon_s: float = 8.0
    proposal_horizon_s: float = 4.0
    emergency_within_s: float = 2.0
    emergency_speed_mps: float = 5.0
    emergency_deceleration_mps2: float = 4.05

    def __post_init__(self) -> None:
        more_than_0(
            proposal_horizon_s=self.proposal_horizon_s,
            emergency_deceleration_mps2=self.emergency_deceleration_mps2,
            **{f"speed_fractions[{i}]": fraction for i, fraction in enumerate(self.speed_fractions)},
        )
        if not self.speed_fractions:
            raise ValueError("speed_fractions must hold a number")
        if self.horizon_s < self.proposal_horizon_s:
            raise ValueError(
                f"horizon_s is {self.horizon_s}, expected at least proposal_horizon_s, {self.proposal_horizon_s}"
            )


@dataclass(frozen=True, slots=True, eq=False)
class PdmDecision:
    """What was proposed at the last step, and what came of it."""

    drives: SimulatedDrives
    """Simulated proposals, in order of paths, then of speed fractions."""
    scores: Scores
    best: int
    braking: bool
    """Whether the emergency brake took over."""


@dataclass(frozen=True, slots=True, eq=False)
class PdmCorridor:
    """Where the ego may drive in this step."""

    paths: Sequence[DrivingPath]
    center: DrivingPath
    """Along which progress is measured."""
    ground: Ground
    red_lights: RedLights
    limit_mps: float
    worth: Sequence[float] = ()
    """Added to the scores, 0 to 1, of drives on each path that score at all (published: nothing)."""


@dataclass(frozen=True, slots=True, eq=False)
class _Traffic:
    """What may lead a proposal."""

    forecast: Forecast
    ignore: NDArray[np.bool_]  # (A,) who touches the ego now
    red_lights: RedLights
    closed: tuple[str, ...]
    """Connectors that the ego must not enter now."""
    reach_m: float
    """As far ahead of its start as a proposal can get."""


class PdmMotion:
    """Proposals are the IDM at fractions of the limit on each of the paths, behind leads that keep their velocity.

    The rear axle is put on the path, as published. Actors that touch the ego
    now are ignored, red connectors stand in the way. Each proposal is driven with tracker
    and bicycle and scored with nuPlan's metrics. If the best one still hits
    something by its own fault within 2 s, and the ego is no faster than 5 m/s,
    it brakes with what comfort allows; so it does, harder, where it is too far from all paths.
    """

    def __init__(self, settings: PdmSettings, shape: EgoShape) -> None:
        self._settings = settings
        self._shape = shape

    def plan(self, observation: Observation, corridor: PdmCorridor) -> tuple[Trajectory, PdmDecision | None]:
        """The plan, and how it was chosen; None where no path was near enough to propose anything."""
        settings, ego, shape = self._settings, observation.ego, self._shape
        paths, axle = corridor.paths, ego.rear_axle(shape)
        starts_m = np.array([path.line.project_point(axle.x_m, axle.y_m)[0] for path in paths])
        forecast = constant_velocity(
            nearest(observation.actors, ego.x_m, ego.y_m), settings.horizon_s + LOOK_AHEAD_S[-1]
        )
        ignore = touched_now(ego, forecast, shape)
        path_of = np.repeat(np.arange(len(paths)), len(settings.speed_fractions))
        targets_mps = np.tile(corridor.limit_mps * np.array(settings.speed_fractions), len(paths))
        closed = corridor.red_lights.closed(observation.signals, ego, shape)
        traffic = _Traffic(forecast, ignore, corridor.red_lights, closed, float(targets_mps.max()) * settings.horizon_s)
        tracks = self._tracks(paths, starts_m, traffic, (0.0, settings.proposal_horizon_s))
        start = RolloutStart(path_of, starts_m[path_of], ego.speed_mps)
        rolled = self._roll_out(tracks, start, targets_mps, settings.proposal_horizon_s)
        x_m, y_m, heading_rad = center_poses(paths, path_of, rolled.progress_m, shape)
        far_off = np.hypot(x_m[:, 0] - ego.x_m, y_m[:, 0] - ego.y_m) > FARTHEST_FROM_PATH_M
        if far_off.all():
            return braking_plan(ego, settings.driver.max_deceleration_mps2, settings.horizon_s, GRID_S), None

        drives = follow_all(ego, x_m, y_m, heading_rad, shape=shape)
        scores = score(drives, forecast, corridor.ground, corridor.center, shape, ignore=ignore)
        worth = np.array(corridor.worth)[path_of] if corridor.worth else 0.0
        value = scores.total + np.where(scores.total > 0.0, worth, 0.0)
        best = int(np.where(far_off, -1.0, value).argmax())
        braking = (
            float(scores.collision_s[best]) <= settings.emergency_within_s
            and abs(ego.speed_mps) <= settings.emergency_speed_mps
        )
        decision = PdmDecision(drives, scores, best, braking)
        if braking:
            # the tracker answers with 10/11 of the change of speed that a plan asks for within the next second
            return braking_plan(ego, 1.1 * settings.emergency_deceleration_mps2, settings.horizon_s, GRID_S), decision
        path = paths[int(path_of[best])]
        progress_m, speed_mps = rolled.progress_m[best], rolled.speed_mps[best]
        return self._extended(ego, path, progress_m, speed_mps, targets_mps[best : best + 1], traffic), decision

    def _tracks(
        self, paths: Sequence[DrivingPath], starts_m: Floats, traffic: _Traffic, span_s: tuple[float, float]
    ) -> list[ProposalPath]:
        """Paths from arc lengths (P,) on, and all that may lead on them within a span of time from now."""
        half_width_m = self._shape.width_m / 2
        strips = [
            # square caps, as published
            Strip(
                path, half_width_m, (start_m - half_width_m, start_m + traffic.reach_m + half_width_m), traffic.ignore
            )
            for path, start_m in zip(paths, starts_m.tolist(), strict=True)
        ]
        return [
            ProposalPath(path.length_m, occupied, traffic.red_lights.on_path(path, traffic.closed))
            for path, occupied in zip(paths, occupancies(strips, traffic.forecast.between(*span_s)), strict=True)
        ]

    def _roll_out(
        self, tracks: list[ProposalPath], start: RolloutStart, targets_mps: Floats, duration_s: float
    ) -> Rollout:
        shape, steps = self._shape, round(duration_s / GRID_S)
        instants = np.floor(GRID_S * np.arange(steps + 1) / STEP_S + 1e-6).astype(np.int64)
        bumpers_m = (shape.front_m, shape.length_m - shape.front_m)
        return roll_out(tracks, start, targets_mps, self._settings.driver, bumpers_m, RolloutClock(instants))

    def _extended(
        self,
        ego: EgoState,
        path: DrivingPath,
        progress_m: Floats,
        speed_mps: Floats,
        target_mps: Floats,
        traffic: _Traffic,
    ) -> Trajectory:
        """The best proposal, progress and speed (T + 1,), driven on to the full horizon."""
        settings = self._settings
        if settings.horizon_s > settings.proposal_horizon_s:
            span_s = (settings.proposal_horizon_s, settings.horizon_s)
            tracks = self._tracks([path], progress_m[:1], traffic, span_s)
            start = RolloutStart(np.zeros(1, dtype=np.int64), progress_m[-1:], speed_mps[-1])
            more = self._roll_out(tracks, start, target_mps, settings.horizon_s - settings.proposal_horizon_s)
            progress_m = np.concatenate((progress_m, more.progress_m[0, 1:]))
            speed_mps = np.concatenate((speed_mps, more.speed_mps[0, 1:]))
        time_s = ego.time_s + GRID_S * np.arange(len(progress_m))
        return rear_axle_plan(path.line, time_s, progress_m, speed_mps, self._shape)
