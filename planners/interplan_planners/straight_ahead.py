"""The floor of the benchmark: a planner that is blind to everything."""

from __future__ import annotations

from math import cos, sin

import numpy as np

from interplan_planners.common.option_checks import more_than_0
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.trajectory import Trajectory


class StraightAhead:
    """Hold heading and speed."""

    def __init__(self, horizon_s: float = 8.0) -> None:
        more_than_0(horizon_s=horizon_s)
        self.horizon_s = horizon_s

    def start(self, mission: Mission) -> None:
        self._ahead_s = np.linspace(0.0, self.horizon_s, round(self.horizon_s / mission.dt_s) + 1)
        self._ones = np.ones_like(self._ahead_s)

    def plan(self, observation: Observation) -> Trajectory:
        ego = observation.ego
        travelled_m = ego.speed_mps * self._ahead_s
        return Trajectory(
            time_s=ego.time_s + self._ahead_s,
            x_m=ego.x_m + travelled_m * cos(ego.heading_rad),
            y_m=ego.y_m + travelled_m * sin(ego.heading_rad),
            heading_rad=ego.heading_rad * self._ones,
            speed_mps=ego.speed_mps * self._ones,
        )
