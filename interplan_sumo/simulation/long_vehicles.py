"""Long vehicles: their rear cuts the corner, and they wait for whom they would touch there.

SUMO draws a bus along its lane. Its body, trailed by its front bumper, sweeps
far into the lane on the inside of a turn, where for SUMO there is room for others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import atan2, cos, hypot, sin

import numpy as np
import shapely

from interplan_sumo.simulation.agent_kinematics import REAR_AXLE, bodies, rolled_rad
from interplan_sumo.simulation.agent_registry import AgentSnapshot
from interplan_sumo.simulation.lane_polygons import ego_ring
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.simulation.vehicle_types import VehicleType
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import wrap_angle

LONG_M = 6.5
"""Shorter ones stay in their lanes."""
TURNING_RAD = 0.08
"""A body turned this far from its lane is in a turn, or soon will be."""
AHEAD_M = 3.0
"""A turn is seen this far ahead of the front bumper."""
CLEAR_M = 0.5
"""How much farther than it needs to stop a vehicle looks."""
STEP_M = 0.5
"""Between the places at which a body is worked out."""


class LongVehicles:
    """Knows which agents are long, and whom each of them waits for."""

    def __init__(
        self, network: SumoNetwork, drivers: Mapping[str, VehicleType], shape: EgoShape, origin_m: tuple[float, float]
    ) -> None:
        """`drivers` by agent, as they come; `origin_m` is where SUMO's frame lies in the map frame."""
        self._network = network
        self._drivers = drivers
        self._shape = shape
        self._origin = origin_m
        self._names: Sequence[str] = ()
        self._rows: list[int] = []

    def waiting(self, snapshot: AgentSnapshot, ego: EgoState) -> list[int]:
        """Rows of the long vehicles that must brake now to touch nobody."""
        if self._names is not snapshot.names:
            self._names = snapshot.names
            self._rows = [row for row, name in enumerate(self._names) if self._drivers[name].length_m > LONG_M]
        if not self._rows:
            return []
        ego_box = shapely.Polygon(ego_ring(ego, self._shape, self._origin))
        found: dict[int, set[int]] = {}
        names = [self._names[row] for row in self._rows]
        places = zip(self._rows, snapshot.lanes(names), snapshot.positions_m(names), strict=True)
        for row, lane, position_m in places:
            sweep = self._sweep(snapshot, row, lane, position_m) if lane else None
            if sweep is None:
                continue
            met = self._met(snapshot, row, sweep, ego_box)
            met -= {other for other, waits_for in found.items() if row in waits_for}  # one of two goes first
            if met:
                found[row] = met
        return list(found)

    def _sweep(self, snapshot: AgentSnapshot, row: int, lane: str, position_m: float) -> shapely.Geometry | None:
        """What the body will sweep until the vehicle can stand; None where it is in no turn."""
        driver, speed_mps = self._drivers[snapshot.names[row]], float(snapshot.speed_mps[row])
        line, arc_m = self._network.lanes[lane].plain_line, self._network.lanes[lane].arc_of(position_m)
        heading = float(snapshot.heading_rad[row])
        if max(abs(wrap_angle(line.heading_at(arc_m + ahead) - heading)) for ahead in (0.0, AHEAD_M)) < TURNING_RAD:
            return None
        way_m = CLEAR_M + speed_mps**2 / (2.0 * driver.decel_mps2) + 0.1 * speed_mps
        x, y = float(snapshot.front_x[row]), float(snapshot.front_y[row])
        poses: list[tuple[float, float, float]] = []
        for gone_m in np.arange(STEP_M, way_m + STEP_M, STEP_M).tolist():
            there = line.pose_at(min(arc_m + gone_m, line.length_m))
            beyond_m = max(0.0, arc_m + gone_m - line.length_m)
            next_x = there.x_m + beyond_m * cos(there.heading_rad)
            next_y = there.y_m + beyond_m * sin(there.heading_rad)
            went_m = hypot(next_x - x, next_y - y)
            off = atan2(next_y - y, next_x - x) - heading
            heading = rolled_rad(heading, went_m * cos(off), went_m * sin(off), REAR_AXLE * driver.length_m)
            x, y = next_x, next_y
            poses.append((x, y, heading))
        return shapely.union_all(bodies(np.array(poses), driver.length_m, driver.width_m))

    def _met(self, snapshot: AgentSnapshot, row: int, sweep: shapely.Geometry, ego_box: shapely.Polygon) -> set[int]:
        """Rows of those that the swept area touches and the body does not yet; -1 for the ego."""
        x0, y0, x1, y1 = shapely.bounds(sweep)
        reach_m = hypot(x1 - x0, y1 - y0) / 2.0 + 20.0
        away_m = np.hypot(snapshot.front_x - (x0 + x1) / 2.0, snapshot.front_y - (y0 + y1) / 2.0)
        rows = [other for other in np.flatnonzero(away_m < reach_m).tolist() if other != row]
        drivers = [self._drivers[snapshot.names[other]] for other in rows]
        poses = np.stack((snapshot.front_x[rows], snapshot.front_y[rows], snapshot.heading_rad[rows]), axis=1)
        boxes = bodies(poses, [each.length_m for each in drivers], [each.width_m for each in drivers])
        rows, others = [*rows, -1], [*boxes, ego_box]
        me = self._drivers[snapshot.names[row]]
        here = np.array([[snapshot.front_x[row], snapshot.front_y[row], snapshot.heading_rad[row]]])
        (body,) = bodies(here, me.length_m, me.width_m)
        touched = shapely.intersects(sweep, others) & ~shapely.intersects(body, others)
        return {other for other, touches in zip(rows, touched.tolist(), strict=True) if touches}
