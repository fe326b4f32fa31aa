"""Who drives into whom in plain traffic, told by boxes alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import KDTree

from interplan_sumo.realism.tracks import RecordedTraffic, Track
from interplan_sumo.world.geometry import Floats, wrap_angle

DEEP_M: Final = 0.05
ALIKE_RAD, ASIDE_M = np.radians(15.0), 1.2
"""Two that head more differently, or are farther beside one another, meet where lanes fork: one stands aslant there,
its rear in the lane that it has left."""


@dataclass(frozen=True, slots=True)
class Overlaps:
    """Pairs of vehicles whose boxes lay in one another, each once."""

    agent_s: float
    behind: frozenset[tuple[str, str]]
    """One drove into the other."""
    aslant: frozenset[tuple[str, str]]
    """One scraped along the other."""


def overlaps(traffic: RecordedTraffic) -> Overlaps:
    """All pairs of one recording whose steps are those of SUMO."""
    rows: dict[int, list[tuple[int, int]]] = {}
    for number, track in enumerate(traffic.tracks):
        for row, step in enumerate(np.round(track.time_s * 10.0).astype(int).tolist()):
            rows.setdefault(step, []).append((number, row))
    boxes = [_corners(each) for each in traffic.tracks]
    found: dict[bool, set[tuple[str, str]]] = {True: set(), False: set()}
    reach_m = max(each.length_m + each.width_m for each in traffic.tracks)
    for there in rows.values():
        places = np.array([(traffic.tracks[i].x_m[k], traffic.tracks[i].y_m[k]) for i, k in there])
        for a, b in KDTree(places).query_pairs(reach_m):
            (i, k), (j, m) = there[a], there[b]
            headings = float(traffic.tracks[i].heading_rad[k]), float(traffic.tracks[j].heading_rad[m])
            if _deep_m(boxes[i][k], boxes[j][m], headings) > DEEP_M:
                x_m, y_m = (places[a] - places[b]).tolist()
                aside_m = abs(y_m * np.cos(headings[0]) - x_m * np.sin(headings[0]))
                alike = bool(abs(wrap_angle(headings[0] - headings[1])) < ALIKE_RAD and aside_m < ASIDE_M)
                found[alike].add((traffic.tracks[i].id, traffic.tracks[j].id))
    return Overlaps(sum(map(len, rows.values())) / 10.0, frozenset(found[True]), frozenset(found[False]))


def _corners(track: Track) -> Floats:
    """(N, 4, 2)"""
    ahead = np.stack([np.cos(track.heading_rad), np.sin(track.heading_rad)], axis=1) * track.length_m / 2.0
    left = np.stack([-np.sin(track.heading_rad), np.cos(track.heading_rad)], axis=1) * track.width_m / 2.0
    middle = np.stack([track.x_m, track.y_m], axis=1)
    return np.stack([middle + a * ahead + b * left for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))], axis=1)


def _deep_m(one: Floats, other: Floats, headings_rad: tuple[float, float]) -> float:
    """How far two boxes would have to be moved apart; 0 or less if they do not touch."""
    axes = [(np.cos(h + turn), np.sin(h + turn)) for h in headings_rad for turn in (0.0, np.pi / 2.0)]
    spans = [(one @ axis, other @ axis) for axis in axes]
    return min(float(min(p.max(), q.max()) - max(p.min(), q.min())) for p, q in spans)
