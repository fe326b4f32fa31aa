"""How long a plan is kept: until the others are not where they were to be, or until its time is over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from interplan_planners.common.forecast import Forecast
from interplan_sumo.planner import Observation
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.trajectory import Trajectory

Budget = Literal["normal", "fast"]
KEPT_S: dict[Budget, tuple[float, float]] = {"normal": (0.0, 0.0), "fast": (1.4, 0.4)}
"""How long a plan is kept at most while the world is as it was foreseen, a round at least: along a free lane that the
ego means to keep and whose end is far, and otherwise."""
AHEAD_S, APART_S = 4.0, 0.8
"""How much of a plan others may upset, and how finely it is looked at."""
SPEED_COUNTS_S = 1.0
"""A speed that was not foreseen counts as far as it leads in this time."""
SLACK_M, SLACK_SHARE = 0.8, 0.15
"""How far off the others may be: this, and this share of how far they are from the ego's way."""
NEW_M = 25.0
"""Whoever was not seen before matters within this of the ego's way."""


@dataclass(frozen=True, slots=True, eq=False)
class Foreseen:
    """The world as it was when a plan was made, and as it was to go on."""

    observation: Observation
    forecast: Forecast
    plan: Trajectory
    most_s: float
    """How long it may be kept."""

    def still(self, seen: Observation) -> bool:
        """Whether the plan is fresh, lights are as they were, and everybody near its rest is where they should be."""
        then, since_s = self.observation.signals, seen.time_s - self.observation.time_s
        if since_s > self.most_s - 1e-6:
            return False
        if seen.signals.connector_ids != then.connector_ids or (seen.signals.status != then.status).any():
            return False
        away_m = self._away_m(seen)
        return bool((self._off_m(seen.actors, since_s, away_m) <= SLACK_M + SLACK_SHARE * away_m).all())

    def _off_m(self, actors: Actors, since_s: float, away_m: Floats) -> Floats:
        """(A,) how far actors, `away_m` from the ego's way, are from where they should be; infinite for who is new."""
        forecast, off_m = self.forecast, np.where(away_m > NEW_M, 0.0, np.inf)
        row_of = {name: row for row, name in enumerate(forecast.ids)}
        rows = np.array([row_of.get(name, -1) for name in actors.ids], dtype=np.int64)
        known, instant = np.flatnonzero(rows >= 0), int(forecast.instant(since_s))
        there = rows[known]
        off_x, off_y = (
            actors.x_m[known] - forecast.x_m[there, instant],
            actors.y_m[known] - forecast.y_m[there, instant],
        )
        off_mps = np.abs(actors.speed_mps[known] - np.abs(forecast.speed_mps[there, instant]))
        off_m[known] = np.hypot(off_x, off_y) + SPEED_COUNTS_S * off_mps
        return off_m

    def _away_m(self, seen: Observation) -> Floats:
        """(A,) how far actors are from the nearest place where the ego is to be."""
        plan, time_s = self.plan, seen.time_s + np.arange(0.0, AHEAD_S, APART_S)
        x_m, y_m = np.interp(time_s, plan.time_s, plan.x_m), np.interp(time_s, plan.time_s, plan.y_m)
        return np.hypot(seen.actors.x_m[:, None] - x_m, seen.actors.y_m[:, None] - y_m).min(axis=1)
