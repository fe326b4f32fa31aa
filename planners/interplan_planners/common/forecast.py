"""Where the others will be: boxes over time, and the plainest forecast, constant velocity."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.geometry import Floats, Ints

STEP_S = 0.2
"""PDM's resolution of forecasts."""
MOST_OF_A_KIND = {ActorKind.VEHICLE: 50, ActorKind.PEDESTRIAN: 25, ActorKind.BICYCLE: 10}
MOST_STATIC = 50
"""PDM considers this many of each class, nearest first; static classes count together."""


@dataclass(frozen=True, eq=False)
class Forecast:
    """Boxes of A actors at K + 1 instants: now, `step_s` from now, twice that, and so on.

    Map frame. A time between
    two instants takes the earlier one, as in PDM; one beyond the last takes the
    last.
    """

    ids: tuple[str, ...]
    is_agent: NDArray[np.bool_]  # (A,)
    length_m: Floats  # (A,)
    width_m: Floats  # (A,)
    x_m: Floats  # (A, K + 1)
    y_m: Floats  # (A, K + 1)
    heading_rad: Floats  # (A, K + 1) of the box
    speed_mps: Floats  # (A, K + 1) along the heading; negative when backing
    step_s: float = STEP_S

    def __len__(self) -> int:
        return len(self.ids)

    @property
    def instants(self) -> int:
        """K + 1."""
        return self.x_m.shape[1]

    @cached_property
    def radius_m(self) -> Floats:
        """(A,) half diagonals."""
        return 0.5 * np.hypot(self.length_m, self.width_m)

    @cached_property
    def stands(self) -> NDArray[np.bool_]:
        """(A,) whether an actor is where it was at every instant."""
        same_place = (self.x_m == self.x_m[:, :1]) & (self.y_m == self.y_m[:, :1])
        return np.asarray((same_place & (self.heading_rad == self.heading_rad[:, :1])).all(axis=1))

    def instant(self, ahead_s: ArrayLike) -> Ints:
        """Index of the instant that holds at times from now."""
        k = np.floor(np.asarray(ahead_s, dtype=np.float64) / self.step_s + 1e-6).astype(np.int64)
        return np.minimum(np.maximum(k, 0), self.instants - 1)

    def between(self, start_s: float, end_s: float) -> Forecast:
        """The part between two times from now, which then begins at `start_s`."""
        first, last = int(self.instant(start_s)), int(self.instant(end_s))
        x_m, y_m, heading_rad, speed_mps = (
            column[:, first : last + 1] for column in (self.x_m, self.y_m, self.heading_rad, self.speed_mps)
        )
        sizes = (self.length_m, self.width_m)
        return Forecast(self.ids, self.is_agent, *sizes, x_m, y_m, heading_rad, speed_mps, self.step_s)

    def only(self, keep: ArrayLike) -> Forecast:
        """The actors selected by a mask (A,) or by increasing indices."""
        rows = np.arange(len(self))[np.asarray(keep)]
        return Forecast(
            tuple(self.ids[i] for i in rows.tolist()),
            self.is_agent[rows], self.length_m[rows], self.width_m[rows],
            self.x_m[rows], self.y_m[rows], self.heading_rad[rows], self.speed_mps[rows], self.step_s,
        )  # fmt: skip


def nearest(actors: Actors, x_m: float, y_m: float) -> Actors:
    """The actors that PDM considers around a point: the nearest of each class, up to its numbers."""
    groups = [(actors.kind == kind, most) for kind, most in MOST_OF_A_KIND.items()]
    groups.append((actors.kind > ActorKind.BICYCLE, MOST_STATIC))
    if all(np.count_nonzero(members) <= most for members, most in groups):
        return actors
    away = np.hypot(actors.x_m - x_m, actors.y_m - y_m)
    keep = np.zeros(len(actors), dtype=np.bool_)
    for members, most in groups:
        rows = np.flatnonzero(members)
        keep[rows[np.argsort(away[rows], kind="stable")[:most]]] = True
    return actors.only(keep)


def constant_velocity(actors: Actors, horizon_s: float, step_s: float = STEP_S) -> Forecast:
    """Every agent goes on at its speed along its heading, backwards if it backs; static classes stand.

    Speed is the magnitude of the velocity, as in nuPlan.
    """
    is_agent = actors.kind <= ActorKind.BICYCLE
    cos, sin = np.cos(actors.heading_rad), np.sin(actors.heading_rad)
    backs = actors.vx_mps * cos + actors.vy_mps * sin < 0.0
    speed = np.where(is_agent, np.where(backs, -actors.speed_mps, actors.speed_mps), 0.0)
    ahead_s = step_s * np.arange(int(np.floor(horizon_s / step_s + 1e-6)) + 1)
    moved_m = speed[:, None] * ahead_s
    shape = moved_m.shape
    return Forecast(
        actors.ids, is_agent, actors.length_m, actors.width_m,
        actors.x_m[:, None] + cos[:, None] * moved_m, actors.y_m[:, None] + sin[:, None] * moved_m,
        np.broadcast_to(actors.heading_rad[:, None], shape), np.broadcast_to(speed[:, None], shape), step_s,
    )  # fmt: skip
