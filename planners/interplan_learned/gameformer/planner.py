"""GameFormer's planner: the network's plan and predictions, then the refinement, which decides the motion."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from interplan_learned.driving import one_sample, plan_through
from interplan_learned.gameformer.inputs import PLAN_STEP_S, inputs
from interplan_learned.gameformer.occupancy import taken
from interplan_learned.gameformer.reference import ReferencePath, ReferencePaths
from interplan_learned.gameformer.refinement import SpeedTask, refined_speeds
from interplan_learned.network import load_network
from interplan_learned.scene import EGO_CHANNELS
from interplan_planners.common.route_search import lanes_of_route
from interplan_sumo.features.view import Arrays, EgoView
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.ego import EgoShape
from interplan_sumo.world.geometry import Floats, Polyline
from interplan_sumo.world.signals import SignalStatus
from interplan_sumo.world.trajectory import Trajectory

_VX, _AX = EGO_CHANNELS.index("vx"), EGO_CHANNELS.index("ax")


class GameFormerPlanner:
    """A network predicts the ego and the agents around it; the ego's speed on the best path is refined against that."""

    paper: ClassVar[str] = "Huang et al. 2023"

    def __init__(self, weights: str = "gameformer") -> None:
        """`weights` names shipped ones, or is a path to a model card."""
        self._network = load_network("gameformer", weights)

    def start(self, mission: Mission) -> None:
        self._view = EgoView(mission)
        self._references = ReferencePaths(mission)
        self._members = lanes_of_route(mission.roads, mission.route)
        self._steps = self._without_path = 0

    def plan(self, observation: Observation) -> Trajectory:
        given = inputs(one_sample(self._view.arrays(observation)), self._network.card.size)
        outputs = self._network.run(given)
        reference = self._references.at(observation)
        self._steps += 1
        if reference is None:
            self._without_path += 1
            return plan_through(outputs["plan"][0], self._view, observation, PLAN_STEP_S)
        predicted = likeliest(outputs["futures"][0], outputs["scores"][0])
        poses = refined(
            reference, given, outputs["plan"][0], predicted, self._red(observation), self._view.mission.shape
        )
        return plan_through(poses, self._view, observation, PLAN_STEP_S)

    def report(self) -> dict[str, Any]:
        """The network's, and in how many steps there was no reference path, so that its own plan was driven."""
        return {**self._network.about, "steps": self._steps, "without_reference_path": self._without_path}

    def _red(self, observation: Observation) -> list[Polyline]:
        """Centre lines of the route's red connectors, ego frame."""
        frame, roads = self._view.frame(observation), self._view.mission.roads
        shown = sorted(observation.signals.with_status(SignalStatus.RED) & self._members)
        return [Polyline(frame.points(roads[each].centerline.points)) for each in shown]


def likeliest(futures: NDArray[Any], scores: NDArray[Any]) -> NDArray[Any]:
    """(A, T, 2) of each agent's futures (A, M, T, 2) the one with the highest score (A, M)."""
    return np.take_along_axis(futures, scores.argmax(axis=1)[:, None, None, None], axis=1)[:, 0]


def refined(
    reference: ReferencePath,
    given: Arrays,
    plan: NDArray[Any],
    predicted: NDArray[Any],
    red: list[Polyline],
    shape: EgoShape,
) -> Floats:
    """(80, 3) poses on the reference path, ego frame: the network's plan (80, 3) made to fit predictions (A, T, 2)."""
    path = reference.path
    x_m, y_m = plan[:, 0].astype(np.float64), plan[:, 1].astype(np.float64)
    planned_m, _ = path.project(x_m, y_m)
    agents, ego = given["agents"][0, :, -1], given["ego"][0, -1]
    speeds = refined_speeds(
        SpeedTask(
            planned_m=planned_m,
            cap_mps=reference.cap_at(planned_m),
            taken=taken(path, agents[: len(predicted)], predicted, red, shape.width_m),
            speed_mps=float(ego[_VX]),
            acceleration_mps2=float(ego[_AX]),
            front_m=shape.front_m,
        )
    )
    return path.line.poses_at(np.cumsum(speeds * PLAN_STEP_S))
