"""One step as lane-change decisions see it: who is on which way, before and behind, and what blocks it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.forecast import Forecast
from interplan_planners.common.lane_routes import LaneRoute
from interplan_planners.common.mobil import Side, side_of
from interplan_planners.common.neighbours import LaneQueue, queue_on
from interplan_planners.common.paths import DrivingPath
from interplan_planners.common.red_lights import RedLights
from interplan_sumo.world.ego import EgoShape, EgoState

LOOK_BEHIND_M, LOOK_AHEAD_M = 60.0, 100.0
"""Along a way, from the ego's middle."""


@dataclass(frozen=True, slots=True, eq=False)
class OnWay:
    """The ego's place along a way and who else is on it."""

    way: LaneRoute
    arc_m: float
    """Of the ego's middle."""
    left_m: float
    """How far the ego is left of the way's line."""
    queue: LaneQueue
    side: Side
    blocked_m: float
    """From the ego's front bumper to the first that stands for good; infinite if none does."""

    @property
    def room_m(self) -> float:
        """How far the ego can still go before it is too late to change lane for the goal."""
        return self.way.room_m - self.arc_m


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What there is to see in one step."""

    ego: EgoState
    shape: EgoShape
    forecast: Forecast
    stands: NDArray[np.bool_]
    """(A,) who stands for good."""
    red_lights: RedLights
    closed: tuple[str, ...]
    """Connectors that show red."""

    def on(self, way: LaneRoute) -> OnWay:
        """The ego and the others along a way."""
        arc_m, left_m = way.path.line.project_point(self.ego.x_m, self.ego.y_m)
        stretch = (arc_m - LOOK_BEHIND_M, arc_m + LOOK_AHEAD_M)
        queue = queue_on(way.path, self.shape.width_m / 2, self.forecast, stretch)
        limit_mps = float(way.limit_mps[min(int(arc_m), len(way.limit_mps) - 1)])
        half_m = self.shape.length_m / 2
        side = side_of(queue, arc_m, half_m, self._end_m(way.path, arc_m), limit_mps)
        standing = queue.rear_m[self.stands[queue.rows] & (queue.front_m > arc_m)]
        blocked_m = float(standing.min()) - arc_m - half_m if standing.size else float("inf")
        return OnWay(way, arc_m, left_m, queue, side, blocked_m)

    def _end_m(self, path: DrivingPath, arc_m: float) -> float:
        """Where the path ends or the next red light closes it."""
        reds: Iterable[tuple[float, float]] = self.red_lights.on_path(path, self.closed)
        return min((start for start, end in reds if 0.5 * (start + end) > arc_m), default=path.length_m)
