"""The planner: the scene encoded once, the branches of both stages scored, the best one driven; alike for held-out
samples.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from interplan_learned.card import Size
from interplan_learned.driving import one_sample, plan_through
from interplan_learned.dtpp.inputs import kept, scene_of, shown, start_of
from interplan_learned.dtpp.sizes import SIZES
from interplan_learned.dtpp.tree import POSE, STEP_S, TreeStart, best_parents, first_stage, second_stage
from interplan_learned.network import load_network
from interplan_sumo.features.view import Arrays, EgoView
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory


class DtppPlanner:
    """A tree of trajectories in two stages, scored by how others are predicted to answer; stops where it finds none."""

    paper: ClassVar[str] = "Huang et al. 2024"

    def __init__(self, weights: str = "dtpp") -> None:
        """`weights` names shipped ones, or is a path to a model card."""
        self._network = load_network("dtpp", weights)

    def start(self, mission: Mission) -> None:
        self._view = EgoView(mission)
        self._steps = self._stops = 0

    def plan(self, observation: Observation) -> Trajectory:
        size = self._network.card.size
        arrays = kept(one_sample(self._view.arrays(observation)), size)
        start = start_of(arrays)
        self._steps += 1
        self._stops += not start.paths_valid.any()
        scene = scene_of(arrays, size)
        encoded = {**self._network.run(scene, "encoder"), "agents": scene["agents"]}

        def decode(branches: Arrays) -> NDArray[Any]:
            return self._network.run({**encoded, **branches}, "decoder")["scores"]

        return plan_through(plans(start, decode, size)[0], self._view, observation, STEP_S)

    def report(self) -> dict[str, Any]:
        """The network's, and in how many steps there was no reference path, so that the plan was to stop."""
        return {**self._network.about, "steps": self._steps, "without_reference_path": self._stops}


Decode = Callable[[Arrays], NDArray[Any]]
"""Scores (B, M) of branches as `inputs.shown` gives them; higher is better."""


def plans(start: TreeStart, decode: Decode, size: Size) -> Floats:
    """(B, 80, 3) poses 0.1 s apart: the child with the best sum of its own and its parent's score.

    All zeros, which is to stop, where there is no path.
    """
    tree = SIZES[size].tree
    first = first_stage(start, tree)
    scores = decode(shown(first, start, size))
    second = second_stage(start, first, best_parents(scores, first.valid, tree.parents), tree)
    sums = decode(shown(second, start, size)) + np.take_along_axis(scores, second.parent, axis=1)
    best = best_parents(sums, second.valid, 1)
    chosen = np.take_along_axis(second.motion, np.maximum(best, 0)[..., None, None], axis=1)[:, 0, :, POSE]
    return chosen * (best[..., None] >= 0)
