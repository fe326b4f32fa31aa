"""Braking cut-ins: who follows a car that brakes hard while it is still changing into its lane brakes in time.

Drivers of SUMO's EIDM soften their braking by what their leader does, and take for that leader whose front is in their
lane: somebody who reaches in from the next lane seems to keep its speed, however hard it brakes, until it is over.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import cos, inf, sin

import numpy as np

from interplan_sumo.simulation.agent_registry import AgentSnapshot
from interplan_sumo.simulation.start_speed import ERRING_MODEL
from interplan_sumo.simulation.sumo import DT_S, sumo
from interplan_sumo.simulation.vehicle_types import VehicleType
from interplan_sumo.world.geometry import Floats

HARD_MPS2 = 4.5
"""Who brakes harder than that, SUMO's usual `decel` of cars, may surprise those behind."""
LEFT_FOLLOWERS, RIGHT_FOLLOWERS = 0, 1
"""Modes of SUMO's `getNeighbors`."""
LEAST_GAP_M = 0.3
"""Who is surprised means to stop so far behind."""


class BrakingCutIns:
    """Knows who brakes in front of whom."""

    def __init__(self, drivers: Mapping[str, VehicleType]) -> None:
        """`drivers` by agent, as they come."""
        self._drivers = drivers
        self._names: Sequence[str] = ()
        self._speeds_mps: Floats = np.zeros(0)
        self._ahead: dict[str, str] = {}  # whom each of those surprised keeps behind

    def most_mps(self, agents: AgentSnapshot) -> dict[str, float]:
        """How fast those surprised may be after the next step, inf: as they like again; to be called once per step."""
        if self._names is agents.names:
            braked = self._speeds_mps - agents.speed_mps > HARD_MPS2 * DT_S
            for row in braked.nonzero()[0].tolist() if braked.any() else ():
                self._surprise(row, agents)
        self._names, self._speeds_mps = agents.names, agents.speed_mps
        if not self._ahead:
            return {}
        found = {name: self._kept_mps(name, leader, agents) for name, leader in self._ahead.items()}
        self._ahead = {name: leader for name, leader in self._ahead.items() if found[name] < inf}
        return {name: most_mps for name, most_mps in found.items() if name in agents.rows}

    def _surprise(self, row: int, agents: AgentSnapshot) -> None:
        """Who is next behind a hard-braking car in a lane that it reaches into has to brake if it hardly can."""
        leader = agents.names[row]
        lane = sumo.vehicle.getLaneID(leader)
        left_m = sumo.vehicle.getLateralLanePosition(leader) if lane else 0.0
        if not lane or abs(left_m) + self._drivers[leader].width_m / 2.0 <= sumo.lane.getWidth(lane) / 2.0:
            return
        for name, _ in sumo.vehicle.getNeighbors(leader, LEFT_FOLLOWERS if left_m > 0.0 else RIGHT_FOLLOWERS):
            driver = self._drivers.get(name)
            if driver is None or driver.car_following_model != ERRING_MODEL or name not in agents.rows:
                continue
            speed_mps = float(agents.speed_mps[agents.rows[name]])
            if speed_mps * DT_S + speed_mps**2 / (2.0 * driver.emergency_decel_mps2) > self._room_m(name, row, agents):
                self._ahead.setdefault(name, leader)

    def _room_m(self, name: str, leader_row: int, agents: AgentSnapshot) -> float:
        """Within how many metres an agent must be able to stop, should its leader brake as hard as it can."""
        row, leader = agents.rows[name], self._drivers[agents.names[leader_row]]
        heading_rad, leader_mps = float(agents.heading_rad[row]), float(agents.speed_mps[leader_row])
        dx = float(agents.front_x[leader_row] - agents.front_x[row])
        dy = float(agents.front_y[leader_row] - agents.front_y[row])
        gap_m = dx * cos(heading_rad) + dy * sin(heading_rad) - leader.length_m
        return gap_m - LEAST_GAP_M + leader_mps**2 / (2.0 * leader.emergency_decel_mps2)

    def _kept_mps(self, name: str, leader: str, agents: AgentSnapshot) -> float:
        """With what an agent stops evenly behind its leader; inf once it is no faster than that."""
        row, leader_row = agents.rows.get(name), agents.rows.get(leader)
        if row is None or leader_row is None or agents.speed_mps[row] <= agents.speed_mps[leader_row]:
            return inf
        speed_mps, brakes_mps2 = float(agents.speed_mps[row]), self._drivers[name].emergency_decel_mps2
        even_m = self._room_m(name, leader_row, agents) - speed_mps * DT_S
        wanted_mps2 = speed_mps**2 / (2.0 * even_m) if even_m > 0.0 else inf
        return max(0.0, speed_mps - min(wanted_mps2, brakes_mps2) * DT_S)
