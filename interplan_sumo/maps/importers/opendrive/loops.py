"""Edges of lanes without the loops that they make inside bends that are tighter than the edge is away."""

from __future__ import annotations

import numpy as np
import shapely

from interplan_sumo.world.geometry import Floats

_LOOP_M, _LOOP_SHARE = 1.0, 4.0
"""A loop no longer than this, and so many times the distance of the edge from the reference line, is no road."""


def without_loops(line: Floats, farthest_m: float) -> Floats:
    """(N, 2) the line, cut short where it crosses itself a few metres on.

    `farthest_m` is how far it lies from the line beside which it runs. What
    crosses itself after a longer way, such as a ramp, stays as it is.
    """
    if len(line) < 4 or shapely.LineString(line).is_simple:
        return line
    longest_m = _LOOP_M + _LOOP_SHARE * farthest_m
    arc_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))))
    kept: list[Floats] = [line[0]]
    k = 0
    while k < len(line) - 1:
        crossing = _last_crossing(line, arc_m, kept[-1], k, longest_m)
        if crossing is None:
            k += 1
            kept.append(line[k])
        else:
            at, k = crossing
            kept.append(at)
    return np.array(kept)


def _last_crossing(line: Floats, arc_m: Floats, here: Floats, k: int, longest_m: float) -> tuple[Floats, int] | None:
    """Where the rest of segment `k` is crossed by the last of those that follow within a loop, and which that is."""
    stop = int(np.searchsorted(arc_m, arc_m[k + 1] + longest_m, side="right"))
    first, last = line[k + 2 : stop - 1], line[k + 3 : stop]
    if not len(first):
        return None
    along, across = line[k + 1] - here, last - first
    cross = along[0] * across[:, 1] - along[1] * across[:, 0]
    away = first - here
    with np.errstate(divide="ignore", invalid="ignore"):
        own = (away[:, 0] * across[:, 1] - away[:, 1] * across[:, 0]) / cross
        other = (away[:, 0] * along[1] - away[:, 1] * along[0]) / cross
    hits = np.flatnonzero((own > 0.0) & (own < 1.0) & (other > 0.0) & (other < 1.0))
    if not len(hits):
        return None
    return here + own[hits[-1]] * along, k + 2 + int(hits[-1])
