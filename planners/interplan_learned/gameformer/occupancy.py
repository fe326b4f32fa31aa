"""Occupancy: which metre of the reference path is taken at which step, by predicted agents and red lights."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from interplan_learned.gameformer.candidates import REACH_M
from interplan_learned.gameformer.inputs import PLAN_STEP_S, PLAN_STEPS
from interplan_learned.scene import AGENT_CHANNELS
from interplan_planners.common.paths import DrivingPath
from interplan_sumo.world.geometry import Floats, Polyline

CELLS: Final = round(REACH_M)
"""Of a metre each."""
SIDE_M: Final = 0.3
"""Agents that come nearer to the ego's side than this are in the way."""
BEHIND_M: Final = 3.0
"""The ego stays so far behind an agent."""
ON_PATH_M: Final = 0.5
"""A red connector whose centre line is nearer than this to the path is on it."""
_LENGTH, _WIDTH = AGENT_CHANNELS.index("length"), AGENT_CHANNELS.index("width")
_CELL_MIDDLES: Final[Floats] = np.arange(CELLS, dtype=np.float64) + 0.5


def taken(
    path: DrivingPath, agents: NDArray[Any], futures: NDArray[Any], red: list[Polyline], ego_width_m: float
) -> NDArray[np.bool_]:
    """(80, 120) whether metre m of a path is taken at 0.1, 0.2 ... 8 s; all in the ego frame.

    `agents` (A, C) are the present rows of `scene.AGENT_CHANNELS`, `futures` (A, T, 2)
    where their centres will be in the next 8 s. Agents that are behind the start of the path are left out, and so is a
    red connector on which the rear axle is already. Beyond its end the path is taken.
    """
    cells = np.zeros((PLAN_STEPS, CELLS), dtype=np.bool_)
    cells[:, _beyond(path) | _red(path, red)] = True
    exists = np.flatnonzero(agents[:, _LENGTH] > 0.0)
    if not exists.size:
        return cells
    agents, places = agents[exists].astype(np.float64), _every_step(agents[exists], futures[exists])
    arc_m, left_m = (
        each.reshape(places.shape[:2]) for each in path.project(places[..., 0].ravel(), places[..., 1].ravel())
    )
    half_m = agents[:, _LENGTH, None] / 2.0
    aside_m = (agents[:, _WIDTH, None] + ego_width_m) / 2.0 + SIDE_M
    in_way = (arc_m > 0.0) & (arc_m[:, :1] > 0.0) & (np.abs(left_m) < aside_m)
    first = np.floor(arc_m - half_m - BEHIND_M)
    last = np.ceil(arc_m + half_m)
    number = np.arange(CELLS)
    covered = (number >= first[..., None]) & (number < last[..., None]) & in_way[..., None]
    return cells | covered.any(axis=0)


def _every_step(agents: Floats, futures: NDArray[Any]) -> Floats:
    """(A, 80, 2) places at every step, between which the network's may be further apart."""
    known_s = np.arange(futures.shape[1] + 1) * (PLAN_STEPS * PLAN_STEP_S / futures.shape[1])
    known = np.concatenate((agents[:, None, :2], futures), axis=1)
    steps_s = PLAN_STEP_S * np.arange(1, PLAN_STEPS + 1)
    after = np.clip(np.searchsorted(known_s, steps_s), 1, len(known_s) - 1)
    share = ((steps_s - known_s[after - 1]) / (known_s[after] - known_s[after - 1]))[:, None]
    return known[:, after - 1] + share * (known[:, after] - known[:, after - 1])


def _beyond(path: DrivingPath) -> NDArray[np.bool_]:
    return np.arange(CELLS) >= np.ceil(path.length_m)


def _red(path: DrivingPath, red: list[Polyline]) -> NDArray[np.bool_]:
    held = np.zeros(CELLS, dtype=np.bool_)
    middles = np.asarray(shapely.points(path.line.poses_at(_CELL_MIDDLES)[:, :2]))
    for line in red:
        on_it = np.asarray(shapely.dwithin(middles, line.linestring, ON_PATH_M))
        if not on_it[0]:
            held |= on_it
    return held
