"""Who drives on a lane, before and behind: what lane-change decisions look at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from interplan_planners.common.forecast import Forecast
from interplan_planners.common.occupancy import StripOccupancy, occupancy
from interplan_planners.common.paths import DrivingPath
from interplan_sumo.planner import Observation
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, Ints

STANDING_MPS = 0.1
"""Below this something stands."""
_PAST_STRIDE = 5


@dataclass(frozen=True, eq=False)
class LaneQueue:
    """The B actors on a lane now, from back to front, by arc length of its path."""

    rows: Ints  # (B,) rows of the forecast
    rear_m: Floats  # (B,)
    front_m: Floats  # (B,)
    speed_mps: Floats  # (B,) along the lane

    def __len__(self) -> int:
        return len(self.rows)

    def ahead_of(self, arc_m: float) -> int:
        """Index of the first whose middle is ahead of an arc length; len(self) if nobody is."""
        return int(np.searchsorted(0.5 * (self.rear_m + self.front_m), arc_m, side="right"))

    def only(self, keep: NDArray[np.bool_]) -> LaneQueue:
        """Those selected by a mask (B,)."""
        return LaneQueue(self.rows[keep], self.rear_m[keep], self.front_m[keep], self.speed_mps[keep])


def queue_on(path: DrivingPath, half_width_m: float, forecast: Forecast, between_m: tuple[float, float]) -> LaneQueue:
    """Who is within `half_width_m` of a stretch of a path at the first instant of the forecast."""
    now = occupancy(path, half_width_m, forecast.between(0.0, 0.0), between_m)
    order = np.argsort(0.5 * (now.near_m[:, 0] + now.far_m[:, 0]), kind="stable")
    return LaneQueue(now.rows[order], now.near_m[order, 0], now.far_m[order, 0], now.speed_mps[order, 0])


def stands_for_good(observation: Observation) -> NDArray[np.bool_]:
    """(A,) whether an actor has not moved in all that is remembered, or is of a class that never moves.

    The past is looked at every half second. A car in a queue at a light is
    among them after 2 s; who needs to tell them apart looks at what is ahead of it.
    """
    actors = observation.actors
    still = (actors.speed_mps < STANDING_MPS) | (actors.kind > ActorKind.BICYCLE)
    rows = {actors.ids[i]: i for i in np.flatnonzero(still).tolist()}
    for past in observation.past.actors[::_PAST_STRIDE] if rows else ():
        for i in np.flatnonzero(past.speed_mps >= STANDING_MPS).tolist():
            row = rows.get(past.ids[i])
            if row is not None and actors.kind[row] <= ActorKind.BICYCLE:
                still[row] = False
    return still


def together(*parts: StripOccupancy) -> StripOccupancy:
    """Several occupancies of one path as one; an actor may be in more than one of them."""
    return StripOccupancy(
        np.concatenate([p.rows for p in parts]),
        np.concatenate([p.near_m for p in parts]),
        np.concatenate([p.far_m for p in parts]),
        np.concatenate([p.center_m for p in parts]),
        np.concatenate([p.speed_mps for p in parts]),
    )


def moved(occupied: StripOccupancy, by_m: float) -> StripOccupancy:
    """An occupancy in arc lengths that are `by_m` larger."""
    return StripOccupancy(
        occupied.rows, occupied.near_m + by_m, occupied.far_m + by_m, occupied.center_m + by_m, occupied.speed_mps
    )
