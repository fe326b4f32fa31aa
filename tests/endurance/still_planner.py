"""A planner that stands still, whatever there is."""

from __future__ import annotations

import numpy as np

from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.trajectory import Trajectory


class Still:
    """Stays where it is."""

    def start(self, mission: Mission) -> None:
        """Nothing to get ready."""

    def plan(self, observation: Observation) -> Trajectory:
        """Brakes as hard as the tracker allows, and stays."""
        ego = observation.ego
        times = np.array((0.0, 1.0, 8.0)) + ego.time_s
        return Trajectory(times, *(np.full(3, value) for value in (ego.x_m, ego.y_m, ego.heading_rad)))
