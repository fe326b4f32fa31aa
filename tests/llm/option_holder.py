"""A planner that only holds its options: what becomes of the name of a model on its way through a planner's spec."""

from __future__ import annotations

from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.trajectory import Trajectory


class OptionHolder:
    def __init__(self, model: str = "", store: str = "") -> None:
        self.model = model
        self.store = store

    def start(self, mission: Mission) -> None: ...

    def plan(self, observation: Observation) -> Trajectory:
        raise NotImplementedError
