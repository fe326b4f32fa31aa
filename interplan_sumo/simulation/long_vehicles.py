"""Long vehicles: their rear cuts the corner, and they wait for whom they would touch there.

SUMO draws a bus along its lane. Its body, trailed by its front bumper, sweeps
far into the lane on the inside of a turn, where for SUMO there is room for others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import atan2, cos, hypot, sin

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_sumo.simulation.agent_kinematics import FRONT_AXLE, LONG_M, REAR_AXLE, bodies, rolled_rad
from interplan_sumo.simulation.agent_registry import AgentSnapshot
from interplan_sumo.simulation.network import SumoNetwork
from interplan_sumo.simulation.vehicle_types import VehicleType
from interplan_sumo.world.ego import EgoShape, EgoState
from interplan_sumo.world.geometry import Floats, Polyline, wrap_angle

TURNING_RAD = 0.08
"""A body turned this far from its lane is in a turn, or soon will be."""
AHEAD_M = 3.0
"""A turn is seen at least this far ahead of the front bumper."""
CLEAR_M = 0.5
"""How much farther than it needs to stop a vehicle looks."""
STEP_M = 0.5
"""Between the places at which a body is worked out."""
SLOWEST_MPS = 1.0
"""Who stands is taken to set out with this speed."""
REACH_M = 20.0
"""Nobody farther than this from the swept area is met."""
TOUCH_M = 0.01
"""For the rounding of sums."""

Corridors = Callable[[AgentSnapshot, Sequence[str]], list[tuple[str, dict[str, float]]]]
"""The lane that each of these agents is on, and the lanes that it will drive on with the distance to their starts."""


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
        self._sizes_m: Floats = np.empty(0)

    def waiting(self, snapshot: AgentSnapshot, ego: EgoState, corridors: Corridors) -> list[int]:
        """Rows of the long vehicles that must brake now to touch nobody."""
        if self._names is not snapshot.names:
            self._names = snapshot.names
            self._rows = [row for row, name in enumerate(self._names) if self._drivers[name].length_m > LONG_M]
            drivers = [self._drivers[name] for name in self._names]
            self._sizes_m = np.array([driver.length_m + driver.width_m for driver in drivers])
        if not self._rows:
            return []
        found: dict[int, set[int]] = {}
        for row, way in zip(self._rows, self._ways(snapshot, self._rows, corridors), strict=True):
            sweep = self._sweep(snapshot, row, way) if way is not None else None
            if sweep is None:
                continue
            met = self._met(snapshot, row, sweep, ego, corridors)
            met -= {other for other, waits_for in found.items() if row in waits_for}  # one of two goes first
            if met:
                found[row] = met
        return list(found)

    def _ways(self, snapshot: AgentSnapshot, rows: Sequence[int], corridors: Corridors) -> list[_Way | None]:
        """Where SUMO's fronts will be; None for an agent that is nowhere."""
        names = [self._names[row] for row in rows]
        found: list[_Way | None] = []
        for (lane, ahead), at_m in zip(corridors(snapshot, names), snapshot.positions_m(names), strict=True):
            lines = [(start_m, self._network.lanes[name].line) for name, start_m in ahead.items()]
            found.append(_Way(lines, self._network.lanes[lane].arc_of(at_m)) if lane else None)
        return found

    def _sweep(self, snapshot: AgentSnapshot, row: int, way: _Way) -> Floats | None:
        """(M, 3) where the front bumper will be every half a metre until it can stand; None where it is in no turn."""
        driver, speed_mps = self._drivers[snapshot.names[row]], float(snapshot.speed_mps[row])
        heading = float(snapshot.heading_rad[row])
        way_m = CLEAR_M + speed_mps**2 / (2.0 * driver.decel_mps2) + 0.1 * speed_mps
        if not way.turns(heading, max(AHEAD_M, way_m)):
            return None
        swung_m, axle_m = FRONT_AXLE * driver.length_m, (REAR_AXLE - FRONT_AXLE) * driver.length_m
        x = float(snapshot.front_x[row]) - swung_m * cos(heading)
        y = float(snapshot.front_y[row]) - swung_m * sin(heading)
        path = way.poses(np.arange(0.0, max(AHEAD_M, way_m) + STEP_M, STEP_M))[:, :2]
        poses: list[tuple[float, float, float]] = []
        for next_x, next_y in _resampled(np.concatenate(([(x, y)], path)), way_m):
            went_m = hypot(next_x - x, next_y - y)
            off = atan2(next_y - y, next_x - x) - heading
            heading = rolled_rad(heading, went_m * cos(off), went_m * sin(off), axle_m)
            x, y = next_x, next_y
            poses.append((x + swung_m * cos(heading), y + swung_m * sin(heading), heading))
        return np.array(poses)

    def _met(self, snapshot: AgentSnapshot, row: int, sweep: Floats, ego: EgoState, corridors: Corridors) -> set[int]:
        """Rows of those that the body will touch and does not yet, if all go on as they do; -1 for the ego."""
        x, y = sweep[len(sweep) // 2, :2]
        me, speed_mps = self._drivers[snapshot.names[row]], float(snapshot.speed_mps[row])
        at_s: Floats = STEP_M * np.arange(len(sweep) + 1, dtype=np.float64) / max(speed_mps, SLOWEST_MPS)
        here = np.array([[snapshot.front_x[row], snapshot.front_y[row], snapshot.heading_rad[row]]])
        mine = bodies(np.concatenate((here, sweep)), me.length_m, me.width_m)
        reach_m = STEP_M * len(sweep) / 2.0 + REACH_M
        driven_m = snapshot.speed_mps * at_s[-1]
        away_m = np.hypot(snapshot.front_x - x, snapshot.front_y - y) - driven_m
        within = (away_m < reach_m) & (self._gaps_m(snapshot, mine) < driven_m + TOUCH_M)
        rows = [other for other in np.flatnonzero(within).tolist() if other != row]
        found: set[int] = set()
        for other, way in zip(rows, self._ways(snapshot, rows, corridors), strict=True):
            driver = self._drivers[snapshot.names[other]]
            poses = np.array([[snapshot.front_x[other], snapshot.front_y[other], snapshot.heading_rad[other]]])
            if way is not None and snapshot.speed_mps[other] > 0.0:
                going = way.poses(at_s * float(snapshot.speed_mps[other]))
                poses = poses + going - going[0]
            if _meet(mine, bodies(poses, driver.length_m, driver.width_m)):
                found.add(other)
        ego_pose = np.array([[ego.x_m - self._origin[0], ego.y_m - self._origin[1], ego.heading_rad]])
        front_m = ego.speed_mps * at_s + self._shape.length_m / 2.0
        along = np.array([[cos(ego.heading_rad), sin(ego.heading_rad), 0.0]])
        if _meet(mine, bodies(ego_pose + front_m[:, None] * along, self._shape.length_m, self._shape.width_m)):
            found.add(-1)
        return found

    def _gaps_m(self, snapshot: AgentSnapshot, boxes: NDArray[np.object_]) -> Floats:
        """(N,) how far from the upright rectangle around some boxes an agent is at least."""
        low_x, low_y, high_x, high_y = shapely.total_bounds(boxes)
        off_x = np.maximum(np.maximum(low_x - snapshot.front_x, snapshot.front_x - high_x), 0.0)
        off_y = np.maximum(np.maximum(low_y - snapshot.front_y, snapshot.front_y - high_y), 0.0)
        return np.hypot(off_x, off_y) - self._sizes_m


class _Way:
    """Lanes one after the other, from a place on the first of them on."""

    def __init__(self, lines: list[tuple[float, Polyline]], arc_m: float) -> None:
        """`lines` come with the distances to their starts, `arc_m` is where on the first of them it begins."""
        self._lines = lines
        self._arc_m = arc_m

    def turns(self, heading_rad: float, way_m: float) -> bool:
        """Whether it leaves a heading within so many metres."""
        near = [line for start_m, line in self._lines if start_m < self._arc_m + way_m]
        return any((np.abs(wrap_angle(line.segment_heading_rad - heading_rad)) >= TURNING_RAD).any() for line in near)

    def poses(self, along_m: Floats) -> Floats:
        """(M, 3) x, y, heading at (M,) distances; behind its end it goes straight on."""
        at_m = self._arc_m + along_m
        starts_m = np.array([start_m for start_m, _ in self._lines])
        rows = np.maximum(starts_m.searchsorted(at_m, side="right") - 1, 0)
        found = np.empty((len(at_m), 3))
        for row, (start_m, line) in enumerate(self._lines):
            mine = rows == row
            if mine.any():
                found[mine] = _poses(line, at_m[mine] - start_m)
        return found


def _poses(line: Polyline, arc_m: Floats) -> Floats:
    """(M, 3) x, y, heading at (M,) arc lengths; behind the end of the line it goes straight on."""
    at_m = np.clip(arc_m, 0.0, line.length_m)
    i = np.clip(line.arc_m.searchsorted(at_m, side="right") - 1, 0, len(line.points) - 2)
    share = (at_m - line.arc_m[i]) / (line.arc_m[i + 1] - line.arc_m[i])
    first, last = line.vertex_heading_rad[i], line.vertex_heading_rad[i + 1]
    heading = wrap_angle(first + share * (last - first))
    xy = line.points[i] + share[:, None] * (line.points[i + 1] - line.points[i])
    poses = np.column_stack((xy, heading))
    for row in np.flatnonzero(arc_m > line.length_m).tolist():
        beyond_m, rad = arc_m[row] - line.length_m, float(heading[row])
        poses[row, :2] += (beyond_m * cos(rad), beyond_m * sin(rad))
    return poses


def _meet(mine: NDArray[np.object_], theirs: NDArray[np.object_]) -> bool:
    """Whether two touch at one of the times after the first, and not at the first; one box is one that stands."""
    touched = shapely.intersects(mine, theirs)
    return bool(touched[1:].any() and not touched[0])


def _resampled(path: Floats, way_m: float) -> list[tuple[float, float]]:
    """Points every half a metre along a path of (N, 2) points, from the first one after its start on until `way_m`."""
    along_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))))
    at_m = np.arange(STEP_M, way_m + STEP_M, STEP_M)
    x_m, y_m = (np.interp(at_m, along_m, column) for column in path.T)
    return list(zip(x_m.tolist(), y_m.tolist(), strict=True))
