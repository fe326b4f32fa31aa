"""PDM's motion: propose drives along given paths, simulate them, score them, drive the best (Dauner et al., 2023)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from interplan_planners.common.contacts import touched_now
from interplan_planners.common.forecast import STEP_S, Forecast, constant_velocity, nearest
from interplan_planners.common.ground import Ground
from interplan_planners.common.idm_policy import IdmDriver
from interplan_planners.common.occupancy import occupancy
from interplan_planners.common.paths import DrivingPath, braking_plan, center_poses, rear_axle_plan
from interplan_planners.common.red_lights import RedLights
from interplan_planners.common.rollout import ProposalPath, Rollout, roll_out
from interplan_planners.common.scoring import LOOK_AHEAD_S, Scores, score
from interplan_sumo.dynamics.batch import SimulatedDrives, follow_all
from interplan_sumo.dynamics.lqr import GRID_S
from interplan_sumo.planner import Observation
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, Ints
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
    first_path_bonus: float = 0.0
    """What a drive on the first path may score less than another, 0 to 1, and still be taken (published: nothing).
    Without it a car beside the centre line stays there, for the way back costs a hair of progress."""

    def __post_init__(self) -> None:
        positive = {
            "proposal_horizon_s": self.proposal_horizon_s,
            "emergency_deceleration_mps2": self.emergency_deceleration_mps2,
            **{f"speed_fractions[{i}]": fraction for i, fraction in enumerate(self.speed_fractions)},
        }
        for name, value in positive.items():
            if not value > 0:
                raise ValueError(f"{name} is {value}, expected more than 0")
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

    def plan(self, observation: Observation, course: PdmCorridor) -> tuple[Trajectory, PdmDecision | None]:
        """The plan, and how it was chosen; None where no path was near enough to propose anything."""
        settings, ego, shape = self._settings, observation.ego, self._shape
        paths, axle = course.paths, ego.rear_axle(shape)
        starts_m = np.array([path.line.project_point(axle.x_m, axle.y_m)[0] for path in paths])
        far_off = self._jumps_m(ego, paths, starts_m) > FARTHEST_FROM_PATH_M
        if far_off.all():
            return braking_plan(ego, settings.driver.max_deceleration_mps2, settings.horizon_s, GRID_S), None

        forecast = constant_velocity(
            nearest(observation.actors, ego.x_m, ego.y_m), settings.horizon_s + LOOK_AHEAD_S[-1]
        )
        ignore = touched_now(ego, forecast, shape)
        closed = course.red_lights.closed(observation.signals, ego, shape)
        path_of = np.repeat(np.arange(len(paths)), len(settings.speed_fractions))
        targets_mps = np.tile(course.limit_mps * np.array(settings.speed_fractions), len(paths))
        reach_m = float(targets_mps.max()) * settings.horizon_s
        tracks = [
            self._track(
                path, course.red_lights, arc_m, reach_m, forecast.between(0.0, settings.proposal_horizon_s), ignore,
                closed,
            )
            for path, arc_m in zip(paths, starts_m.tolist(), strict=True)
        ]  # fmt: skip
        progress_m = starts_m[path_of]
        rolled = self._roll_out(
            tracks, path_of, progress_m, ego.speed_mps, targets_mps, 0.0, settings.proposal_horizon_s
        )
        drives = follow_all(ego, *center_poses(paths, path_of, rolled.progress_m, shape), shape=shape)
        scores = score(drives, forecast, course.ground, course.center, shape, ignore=ignore)
        value = scores.total + np.where(path_of == 0, settings.first_path_bonus, 0.0) * (scores.total > 0.0)
        best = int(np.where(far_off[path_of], -1.0, value).argmax())
        braking = (
            float(scores.collision_s[best]) <= settings.emergency_within_s
            and abs(ego.speed_mps) <= settings.emergency_speed_mps
        )
        decision = PdmDecision(drives, scores, best, braking)
        if braking:
            # the tracker answers with 10/11 of the change of speed that a plan asks for within the next second
            return braking_plan(ego, 1.1 * settings.emergency_deceleration_mps2, settings.horizon_s, GRID_S), decision
        path = paths[int(path_of[best])]
        return self._extended(
            ego, best, path, course.red_lights, rolled, targets_mps, forecast, ignore, closed, reach_m
        ), decision

    def _jumps_m(self, ego: EgoState, paths: Sequence[DrivingPath], starts_m: Floats) -> Floats:
        """(P,) how far from the ego's centre each path would put it, with the rear axle at arc lengths (P,)."""
        rows = np.arange(len(paths))
        x_m, y_m, _ = center_poses(paths, rows, starts_m[:, None], self._shape)
        return np.hypot(x_m[:, 0] - ego.x_m, y_m[:, 0] - ego.y_m)

    def _track(
        self,
        path: DrivingPath,
        red_lights: RedLights,
        start_m: float,
        reach_m: float,
        forecast: Forecast,
        ignore: NDArray[np.bool_],
        closed: tuple[str, ...],
    ) -> ProposalPath:
        """One of the paths and all that may lead on it."""
        half_width_m = self._shape.width_m / 2
        stretch = (start_m - half_width_m, start_m + reach_m + half_width_m)  # square caps, as published
        occupied = occupancy(path, half_width_m, forecast, stretch, ignore)
        return ProposalPath(path.length_m, occupied, red_lights.on_path(path, closed))

    def _roll_out(
        self,
        tracks: list[ProposalPath],
        path_of: Ints,
        progress_m: Floats,
        speed_mps: ArrayLike,
        targets_mps: Floats,
        start_s: float,
        end_s: float,
    ) -> Rollout:
        shape, steps = self._shape, round((end_s - start_s) / GRID_S)
        rear_m = shape.length_m - shape.front_m
        instants = np.floor(GRID_S * np.arange(steps + 1) / STEP_S + 1e-6).astype(np.int64)
        return roll_out(
            tracks, path_of, progress_m, speed_mps, targets_mps, self._settings.driver, shape.front_m, rear_m, steps,
            instants,
        )  # fmt: skip

    def _extended(
        self,
        ego: EgoState,
        best: int,
        path: DrivingPath,
        red_lights: RedLights,
        rolled: Rollout,
        targets_mps: Floats,
        forecast: Forecast,
        ignore: NDArray[np.bool_],
        closed: tuple[str, ...],
        reach_m: float,
    ) -> Trajectory:
        """The best proposal, driven on to the full horizon."""
        settings = self._settings
        progress_m, speed_mps = rolled.progress_m[best], rolled.speed_mps[best]
        if settings.horizon_s > settings.proposal_horizon_s:
            later = forecast.between(settings.proposal_horizon_s, settings.horizon_s)
            track = self._track(path, red_lights, float(progress_m[0]), reach_m, later, ignore, closed)
            more = self._roll_out(
                [track], np.zeros(1, dtype=np.int64), progress_m[-1:], speed_mps[-1], targets_mps[best : best + 1],
                settings.proposal_horizon_s, settings.horizon_s,
            )  # fmt: skip
            progress_m = np.concatenate((progress_m, more.progress_m[0, 1:]))
            speed_mps = np.concatenate((speed_mps, more.speed_mps[0, 1:]))
        time_s = ego.time_s + GRID_S * np.arange(len(progress_m))
        return rear_axle_plan(path.line, time_s, progress_m, speed_mps, self._shape)
