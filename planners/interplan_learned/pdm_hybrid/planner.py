"""PDM-Hybrid's planner: PDM-Closed, and the correction that a network adds."""

from __future__ import annotations

from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.driving import POSES, STEP_S, one_sample, without_leaps
from interplan_learned.network import load_network
from interplan_learned.pdm_open import planner as pdm_open
from interplan_planners.pdm_closed import PdmClosedPlanner
from interplan_sumo.dynamics.rear_axle import rear_axles_of
from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.features.view import Arrays, EgoView
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory

CLOSED_PLAN: Final = "closed_plan"
"""What the network is given beside PDM-Open's inputs: `closed_poses` of PDM-Closed's plan."""
KEPT_S: Final = 2.0
"""So much of PDM-Closed's plan stays as it is (published)."""
KEPT_POSES: Final = round(KEPT_S / STEP_S)


class PdmHybridPlanner:
    """PDM-Closed drives; what it plans for later than 2 s is corrected towards what experts do.

    The network sees what PDM-Open sees, and PDM-Closed's plan. Its correction is
    added whole to poses from 2.5 s on; poses up to 2 s are PDM-Closed's, bit for
    bit, and in between the correction grows linearly. Plans come nearer to
    experts' ones this way, while the drive stays PDM-Closed's: exactly so with a
    tracker that looks no farther than 2 s, within centimetres with nuPlan's,
    which smooths the whole plan before it reads what comes within 1 s.
    """

    paper: ClassVar[str] = "Dauner et al. 2023"

    def __init__(self, weights: str = "pdm_offset") -> None:
        """`weights` names shipped ones, or is a path to a model card."""
        self._network = load_network("pdm_offset", weights, "pdm_hybrid")
        self._history_s = float(self._network.card.options["history_s"])
        self._closed = PdmClosedPlanner()

    def start(self, mission: Mission) -> None:
        self._closed.start(mission)
        self._view = EgoView(mission)

    def plan(self, observation: Observation) -> Trajectory:
        closed, frame, shape = self._closed.plan(observation), self._view.frame(observation), self._view.mission.shape
        arrays = {**self._view.arrays(observation), CLOSED_PLAN: closed_poses(closed, frame, shape)}
        outputs = self._network.run(inputs(one_sample(arrays), self._history_s))
        return corrected(closed, outputs["correction"][0], frame, shape)

    def report(self) -> dict[str, Any]:
        return self._network.about


def inputs(arrays: Arrays, history_s: float = 2.0) -> Arrays:
    """PDM-Open's `ego` and `centerline`, and `closed_plan` (B, POSES, 3), which `arrays` must hold beside the schema's.

    All three are in the ego frame.
    """
    return {**pdm_open.inputs(arrays, history_s), CLOSED_PLAN: arrays[CLOSED_PLAN]}


def closed_poses(plan: Trajectory, frame: EgoFrame, shape: EgoShape) -> NDArray[np.float32]:
    """(POSES, 3) poses of the rear axle in the ego frame, every 0.5 s of a plan, its start not included."""
    times_s = plan.time_s[0] + STEP_S * np.arange(1, POSES + 1)
    x_m, y_m, heading_rad = plan.poses_at(times_s).T
    x_m, y_m = rear_axles_of(x_m, y_m, heading_rad, shape)
    return frame.poses(np.stack((x_m, y_m, heading_rad), axis=1)).astype(np.float32)


def corrected(plan: Trajectory, correction: NDArray[Any], frame: EgoFrame, shape: EgoShape) -> Trajectory:
    """A plan of 8 s with a correction (POSES, 3) of its `closed_poses` added to all that comes after `KEPT_S`."""
    ahead_s = np.round(plan.time_s - plan.time_s[0], 6)
    known_s = STEP_S * np.arange(KEPT_POSES, POSES + 1)
    known = np.concatenate((np.zeros((1, 3)), correction[KEPT_POSES:]))
    later = ahead_s > KEPT_S
    added: Floats = np.stack([np.interp(ahead_s[later], known_s, each) for each in known.T], axis=1)

    rear_x, rear_y = rear_axles_of(plan.x_m[later], plan.y_m[later], plan.heading_rad[later], shape)
    poses = frame.poses(np.stack((rear_x, rear_y, plan.heading_rad[later]), axis=1))
    moved = frame.plan(without_leaps(poses + added, float(plan.time_s[1] - plan.time_s[0])), plan.time_s[later], shape)
    kept = ~later
    x_m, y_m, heading_rad = (
        np.concatenate((getattr(plan, name)[kept], getattr(moved, name))) for name in ("x_m", "y_m", "heading_rad")
    )
    return Trajectory(plan.time_s, x_m, y_m, heading_rad)
