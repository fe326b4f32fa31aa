"""The close look: the best drafts driven with tracker and bicycle, and judged as the benchmark judges drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from interplan_planners.common.forecast import Forecast
from interplan_planners.common.ground import Ground
from interplan_planners.common.paths import center_poses
from interplan_planners.common.scoring import score
from interplan_planners.foresight.costs import HIT, HIT_FADES_S, faded
from interplan_planners.foresight.prediction import STEP_S
from interplan_planners.foresight.scene import PlanningScene
from interplan_planners.foresight.speeds import Drafts
from interplan_planners.foresight.st_obstacles import Stage
from interplan_sumo.dynamics.batch import follow_all
from interplan_sumo.dynamics.lqr import GRID_S
from interplan_sumo.world.geometry import Floats

CHECKED_S = 4.4
"""How much of a draft is driven."""
TRACKED_AHEAD_S = 1.2
"""The tracker looks this far beyond what is driven."""
DANGER, DANGER_FADES_S = 25.0, 3.0
"""For a time to collision that is too short, in points of progress; it fades with the time until then."""
OFF_ROAD, OFF_ROAD_FADES_S = 60.0, 4.0
UNCOMFORTABLE = 5.0
STANDING_MPS, STANDING_SHARE = 0.3, 0.5
"""Who stands when it is hit leaves it to the other to brake: that counts less."""
OVER_EDGE_M = 0.26
"""How far a corner may reach over the edge of the road; nuPlan tolerates 0.3 m."""
MOVING_LONGER_M, MOVING_WIDER_M, STANDING_LARGER_M = 0.5, 0.3, 0.1
"""What is added to boxes, for forecasts are never right."""


def checked_costs(
    scene: PlanningScene, stages: Sequence[Stage], drafts: Drafts, chosen: Sequence[int], ground: Ground
) -> Floats:
    """(C,) what the close look adds to the costs of chosen drafts: contacts, danger, the road's edge, comfort."""
    shape = scene.shape
    states = round(CHECKED_S / GRID_S) + 1
    rows = np.array(chosen)
    arc_m = finer(drafts.arc_m[rows], drafts.speed_mps[rows])[:, : states + round(TRACKED_AHEAD_S / GRID_S)]
    of = drafts.stage_of[rows]
    paths = [stage.candidate.path for stage in stages]
    drives = follow_all(scene.ego, *center_poses(paths, of, arc_m, shape), states - 1, shape)
    scores = score(drives, _wider(scene.traffic.forecast), ground, paths[0], shape)
    off_road = scores.where.farther_off_road(OVER_EDGE_M)
    # where the goal's road ends nobody needs to know what comes after it
    off_road &= arc_m[:, :states] < np.array([_goal_m(stages[p]) for p in of.tolist()])[:, None]
    off_road_s = np.where(off_road.any(axis=1), GRID_S * off_road.argmax(axis=1), np.inf)
    then = np.minimum(scores.collision_s / GRID_S, states - 1).astype(np.int64)
    stands = np.abs(drives.vx_mps[np.arange(len(then)), then]) < STANDING_MPS
    hit = np.where(stands, STANDING_SHARE, 1.0) * faded(HIT, scores.collision_s, HIT_FADES_S)
    added = hit + faded(DANGER, scores.danger_s, DANGER_FADES_S)
    return added + faded(OFF_ROAD, off_road_s, OFF_ROAD_FADES_S) + np.where(scores.comfort < 1.0, UNCOMFORTABLE, 0.0)


def finer(arc_m: Floats, speed_mps: Floats) -> Floats:
    """(N, 2 K + 1) arc lengths every 0.1 s from those every 0.2 s (N, K + 1), with speeds that change evenly."""
    fine = np.empty((len(arc_m), 2 * arc_m.shape[1] - 1))
    fine[:, ::2] = arc_m
    fine[:, 1::2] = arc_m[:, :-1] + 0.5 * STEP_S * (0.75 * speed_mps[:, :-1] + 0.25 * speed_mps[:, 1:])
    return fine


def _goal_m(stage: Stage) -> float:
    """Arc length of a stage's path where the goal is, or where its way leaves the route."""
    base = stage.candidate.base
    here = stage.candidate.path.line.pose_at(stage.arc_m)
    return stage.arc_m + base.ends_m - base.line.project_point(here.x_m, here.y_m)[0]


def _wider(forecast: Forecast) -> Forecast:
    moving = ~forecast.stands
    return replace(
        forecast,
        length_m=forecast.length_m + np.where(moving, MOVING_LONGER_M, STANDING_LARGER_M),
        width_m=forecast.width_m + np.where(moving, MOVING_WIDER_M, STANDING_LARGER_M),
    )
