"""The planner: a network at the wheel, with traversals of the lane graph between its two graphs."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from interplan_learned.driving import one_sample, plan_through
from interplan_learned.gc_pgp.inputs import POLICY_INPUTS, inputs, kept
from interplan_learned.gc_pgp.local_graph import nodes_of
from interplan_learned.gc_pgp.plans import plans
from interplan_learned.gc_pgp.sizes import SIZES
from interplan_learned.network import load_network
from interplan_sumo.features.view import EgoView
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.trajectory import Trajectory


class GcPgpPlanner:
    """Traversals of the lane graph along the route, decoded, clustered; the mean of the best cluster is driven."""

    paper: ClassVar[str] = "Hallgarten et al. 2023"

    def __init__(self, weights: str = "gc_pgp") -> None:
        """`weights` names shipped ones, or is a path to a model card."""
        self._network = load_network("gc_pgp", weights)
        self._size = SIZES[self._network.card.size]

    def start(self, mission: Mission) -> None:
        self._view = EgoView(mission)
        self._nodes = nodes_of(mission.roads, self._size.points)

    def plan(self, observation: Observation) -> Trajectory:
        given = inputs(kept(one_sample(self._view.arrays(observation)), [self._nodes], self._size))
        policy = self._network.run({name: given[name] for name in POLICY_INPUTS}, "policy")

        def decoded(paths: NDArray[np.int64], noise: NDArray[np.float32]) -> NDArray[Any]:
            encoded = {"ego_code": policy["ego_code"], "node_codes": policy["node_codes"]}
            return self._network.run({"paths": paths, "noise": noise, **encoded}, "decoder")["trajectories"]

        return plan_through(plans(given, policy["scores"], decoded, self._size)[0], self._view, observation)

    def report(self) -> dict[str, Any]:
        return self._network.about
