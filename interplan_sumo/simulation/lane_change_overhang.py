"""Askew bodies: slow cars whose rear still reaches into a lane that they have left for SUMO.

A car that changes lane in slow traffic turns far out of its lane, and its rear
follows only as it drives on. SUMO keeps both lanes taken until the front has
arrived on the new centre line, then gives the old lane free at once; those
behind would drive into the rear. So they are told of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import cos, pi

import numpy as np

from interplan_sumo.simulation.agent_snapshot import AgentSnapshot
from interplan_sumo.simulation.lane_footprint import reached
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.simulation.reactions import LaneCoverage
from interplan_sumo.simulation.vehicle_types import VehicleType
from interplan_sumo.world.geometry import box_polygons, wrap_angle

SLOW_MPS = 7.0
"""At 3.5 m in 3 s across, a car this fast or faster never turns so far that its rear leaves its lane."""
TURNING_RAD = 0.004
"""A car that slides sideways at SUMO's least lateral speed, 0.5 m/s, turns by more than this in a step."""


class LaneChangeOverhang:
    """Knows who is turning, and what the bodies of those cover besides their own lanes."""

    def __init__(self, network: SumoNetwork, drivers: Mapping[str, VehicleType]) -> None:
        self._network = network
        self._drivers = drivers
        self._suspects: set[str] = set()

    def suspects(self, driving: AgentSnapshot) -> list[int]:
        """Rows of agents that may be askew; to be called once per step."""
        if driving.most_turned_rad > TURNING_RAD:
            turned = driving.turned_rad if driving.most_turned_rad < pi else wrap_angle(driving.turned_rad)
            turning = np.abs(turned) > TURNING_RAD
            slow = np.flatnonzero(turning & (driving.speed_mps < SLOW_MPS))
            self._suspects.update(driving.names[int(row)] for row in slow)
        return [row for row, name in enumerate(driving.names) if name in self._suspects] if self._suspects else []

    def covers(
        self, rows: Sequence[int], lanes: Sequence[str], driving: AgentSnapshot
    ) -> list[tuple[str, dict[str, LaneCoverage]]]:
        """Per askew agent what its body covers of lanes that SUMO thinks free, and how fast it moves along them.

        `rows` are suspects, `lanes` where they are; who turns out to stay inside its lanes is one no more.
        """
        found: list[tuple[str, dict[str, LaneCoverage]]] = []
        for row, lane in zip(rows, lanes, strict=True):
            name = driving.names[row]
            driver, heading = self._drivers[name], float(driving.heading_rad[row])
            x = driving.front_x[row] - driver.length_m / 2.0 * np.cos(heading)
            y = driving.front_y[row] - driver.length_m / 2.0 * np.sin(heading)
            (box,) = box_polygons([x], [y], [heading], [driver.length_m], [driver.width_m])
            own = self._network.continuations(lane) if lane else frozenset[str]()
            spans = reached(self._network, box, own)
            if not spans:
                self._suspects.discard(name)
                continue
            found.append((name, self._moving(spans, heading, float(driving.speed_mps[row]))))
        return found

    def _moving(
        self, spans: Mapping[str, tuple[float, float]], heading_rad: float, speed_mps: float
    ) -> dict[str, LaneCoverage]:
        covers: dict[str, LaneCoverage] = {}
        for name, (start_m, end_m) in spans.items():
            lane = self._network.lanes[name]
            along_rad = lane.line.pose_at(lane.arc_of((start_m + end_m) / 2.0)).heading_rad
            covers[name] = LaneCoverage(0.0, start_m, end_m, speed_mps * cos(heading_rad - along_rad))
        return covers

    def forget(self, name: str) -> None:
        """The agent has left."""
        self._suspects.discard(name)
