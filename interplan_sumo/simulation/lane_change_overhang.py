"""Overhang: slow cars whose rear still reaches into a lane that, for SUMO, they have left.

A car that changes lane in slow traffic turns far out of its lane, and its rear
follows only as it drives on. SUMO keeps both lanes occupied until the front is
on the new centre line, then frees the old lane at once; those behind would
drive into the rear. So they are told of it. And it must not drive into whom,
for SUMO, it has passed already.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import cos, pi, sin

import numpy as np
import shapely

from interplan_sumo.simulation.agent_kinematics import LONG_M, bodies
from interplan_sumo.simulation.agent_registry import AgentSnapshot
from interplan_sumo.simulation.lane_footprint import keeps_clear, lanes_overlapped
from interplan_sumo.simulation.lane_polygons import Ring, body_ring
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.simulation.reactions import LaneCoverage
from interplan_sumo.simulation.vehicle_types import VehicleType
from interplan_sumo.world.geometry import wrap_angle

SLOW_MPS = 7.0
"""At 3.5 m in 3 s across, a car this fast or faster never turns so far that its rear leaves its lane."""
TOUCH_M = 0.15
"""So near a car may come to another one that, for SUMO, it has passed."""
LONGEST_M = 20.0
"""No vehicle is longer."""
TURNING_RAD = 0.004
"""A car that slides sideways at SUMO's least lateral speed, 0.5 m/s, turns by more than this in a step."""


class LaneChangeOverhang:
    """Knows which cars are turning, and what their bodies cover besides their own lanes."""

    def __init__(self, network: SumoNetwork, drivers: Mapping[str, VehicleType]) -> None:
        self._network = network
        self._drivers = drivers
        self._candidates: set[str] = set()

    def candidates(self, snapshot: AgentSnapshot) -> list[int]:
        """Rows of agents that may overhang a lane; to be called once per step."""
        for row, turned in snapshot.turned_rad.items():
            least = abs(turned) if abs(turned) < pi else abs(wrap_angle(turned))
            if least > TURNING_RAD and snapshot.speed_mps[row] < SLOW_MPS:
                self._candidates.add(snapshot.names[row])
        self._candidates.update([snapshot.names[row] for row in snapshot.displaced])
        return sorted(snapshot.rows[name] for name in self._candidates)

    def coverage(
        self, rows: Sequence[int], lanes: Sequence[str], snapshot: AgentSnapshot
    ) -> list[tuple[str, dict[str, LaneCoverage]]]:
        """Per overhanging agent what its body covers of lanes that SUMO takes for free, and its speed along them.

        `rows` are candidates, `lanes` where they are; one that turns out to stay inside its lanes is dropped.
        """
        found: list[tuple[str, dict[str, LaneCoverage]]] = []
        for row, lane in zip(rows, lanes, strict=True):
            name = snapshot.names[row]
            driver, heading = self._drivers[name], float(snapshot.heading_rad[row])
            front_x, front_y = float(snapshot.front_x[row]), float(snapshot.front_y[row])
            if lane and self._is_inside(lane, driver, front_x, front_y, heading):
                self._candidates.discard(name)
                continue
            long = driver.length_m > LONG_M  # in a turn its rear is not where SUMO has it, in its own lane either
            own = self._network.continuations(lane) if lane and not long else frozenset[str]()
            corners = body_ring(front_x, front_y, heading, driver.length_m, driver.width_m)
            if keeps_clear(self._network, corners, own, in_junctions=long):
                self._candidates.discard(name)
                continue
            (box,) = bodies(np.array([[front_x, front_y, heading]]), driver.length_m, driver.width_m)
            spans = lanes_overlapped(self._network, box, own, in_junctions=long)
            if not spans:
                self._candidates.discard(name)
                continue
            found.append((name, self._moving(spans, heading, float(snapshot.speed_mps[row]))))
        return found

    def _is_inside(self, name: str, driver: VehicleType, front_x: float, front_y: float, heading_rad: float) -> bool:
        """Whether a body lies inside its lane, as far as that is straight; what sweeps the next lanes begins later."""
        lane = self._network.lanes[name]
        if lane.internal:
            return False
        arc_m, left_m = lane.plain_line.project(front_x, front_y)
        turned_rad = lane.plain_line.heading_at(arc_m) - heading_rad
        rear_m = left_m + driver.length_m * sin(turned_rad)
        return max(abs(left_m), abs(rear_m)) + driver.width_m / 2.0 < lane.width_m / 2.0 and cos(turned_rad) > 0.5

    def _moving(
        self, spans: Mapping[str, tuple[float, float]], heading_rad: float, speed_mps: float
    ) -> dict[str, LaneCoverage]:
        coverage: dict[str, LaneCoverage] = {}
        for name, (start_m, end_m) in spans.items():
            lane = self._network.lanes[name]
            along_rad = lane.line.pose_at(lane.arc_of((start_m + end_m) / 2.0)).heading_rad
            coverage[name] = LaneCoverage(0.0, start_m, end_m, speed_mps * cos(heading_rad - along_rad))
        return coverage

    def faces_somebody(self, snapshot: AgentSnapshot, ego: Ring, dt_s: float) -> list[int]:
        """Rows of cars shown elsewhere than where SUMO has them that must brake for whom they stand behind there.

        `ego` are the corners of its box, in SUMO's frame.
        """
        box = shapely.Polygon(ego)
        return [row for row in sorted(snapshot.displaced) if self._faces_somebody(row, snapshot, box, dt_s)]

    def _faces_somebody(self, row: int, snapshot: AgentSnapshot, ego: shapely.Polygon, dt_s: float) -> bool:
        me, heading, speed = self._drivers[snapshot.names[row]], snapshot.heading_rad[row], snapshot.speed_mps[row]
        reach_m = TOUCH_M + float(speed) * dt_s + float(speed) ** 2 / (2.0 * me.emergency_decel_mps2)
        cosine, sine = np.cos(heading), np.sin(heading)
        dx, dy = snapshot.front_x - snapshot.front_x[row], snapshot.front_y - snapshot.front_y[row]
        ahead_m = dx * cosine + dy * sine
        rows = np.flatnonzero((ahead_m > 0.0) & (np.hypot(dx, dy) < reach_m + me.width_m + LONGEST_M))
        x, y = float(snapshot.front_x[row]), float(snapshot.front_y[row])
        (way,) = bodies(np.array([[x + reach_m * cosine, y + reach_m * sine, heading]]), reach_m, me.width_m)
        others = [self._drivers[snapshot.names[i]] for i in rows.tolist()]
        poses = np.stack((snapshot.front_x[rows], snapshot.front_y[rows], snapshot.heading_rad[rows]), axis=1)
        boxes = bodies(poses, [each.length_m for each in others], [each.width_m for each in others])
        return bool(shapely.intersects(way, [ego, *boxes]).any())

    def forget(self, name: str) -> None:
        """The agent has left."""
        self._candidates.discard(name)
