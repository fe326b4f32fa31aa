"""Followers: how hard somebody behind the ego had to brake."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.metrics.facts import Facts
from interplan_sumo.world.actors import ActorKind
from interplan_sumo.world.geometry import Floats, Ints
from interplan_sumo.world.trace import ActorTable

LONGEST_GAP_M = 50.0
"""Who is farther behind is not taken to brake for the ego."""
LARGEST_ANGLE_RAD = np.deg2rad(45.0)
"""Who drives in another direction than this is no follower."""


def hardest_braking(facts: Facts) -> dict[str, Any] | None:
    """The hardest deceleration of any follower, with its time, track and gap; None if no follower ever brakes.

    A follower is a vehicle or bicycle with some of the ego's box straight ahead
    in the corridor of its own width, at most `LONGEST_GAP_M` away, and nobody between.
    """
    actors = facts.trace.actors
    acceleration = accelerations_mps2(actors, facts.step_us * 1e-6)
    gap = gaps_to_ego_m(facts)
    rows = np.flatnonzero(np.isfinite(gap) & (acceleration < 0.0))
    rows = rows[~screened(facts, rows, gap[rows])]
    if not len(rows):
        return None
    row = int(rows[np.argmin(acceleration[rows])])
    return {
        "deceleration_mps2": float(-acceleration[row]),
        "time_s": float(facts.time_s[actors.frame[row]]),
        "track": str(actors.ids[row]),
        "gap_m": float(gap[row]),
    }


def accelerations_mps2(actors: ActorTable, step_s: float) -> Floats:
    """(R,) change of speed since the frame before; 0 for a row whose track was not there then."""
    codes: dict[str, int] = {}
    code = np.fromiter((codes.setdefault(i, len(codes)) for i in actors.ids), dtype=np.int64, count=len(actors))
    order = np.lexsort((actors.frame, code))
    speed = np.hypot(actors.vx_mps, actors.vy_mps)[order]
    follows = (np.diff(code[order]) == 0) & (np.diff(actors.frame[order]) == 1)
    acceleration = np.zeros(len(actors))
    acceleration[order[1:]] = np.where(follows, np.diff(speed) / step_s, 0.0)
    return acceleration


def gaps_to_ego_m(facts: Facts) -> Floats:
    """(R,) gap from each follower's front to the nearest corner of the ego; infinite for whoever is no follower."""
    actors = facts.trace.actors
    gap = np.full(len(actors), np.inf)
    drives = (actors.kind == ActorKind.VEHICLE) | (actors.kind == ActorKind.BICYCLE)
    turned = facts.trace.ego.heading_rad[actors.frame] - actors.heading_rad
    near = np.hypot(*(facts.centre[actors.frame] - facts.actor_xy).T) < 2 * LONGEST_GAP_M
    rows = np.flatnonzero(drives & near & (np.cos(turned) > np.cos(LARGEST_ANGLE_RAD)) & facts.not_hit)
    along, across = _seen_from(actors, rows, facts.corners[actors.frame[rows]])
    ahead = along.min(axis=1) - actors.length_m[rows] / 2
    half_width = actors.width_m[rows] / 2
    inside = (across.max(axis=1) > -half_width) & (across.min(axis=1) < half_width)
    follows = inside & (ahead >= 0.0) & (ahead <= LONGEST_GAP_M)
    gap[rows[follows]] = ahead[follows]
    return gap


def screened(facts: Facts, rows: Ints, gap_m: Floats) -> NDArray[np.bool_]:
    """(K,) whether the centre of another actor lies between each follower and the ego, in the follower's corridor."""
    actors = facts.trace.actors
    hidden = np.zeros(len(rows), dtype=np.bool_)
    first, last = actors.starts[actors.frame[rows]], actors.starts[actors.frame[rows] + 1]
    counts = last - first
    pair = np.repeat(np.arange(len(rows)), counts)
    other = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + np.repeat(first, counts)
    along, across = _seen_from(actors, rows[pair], facts.actor_xy[other][:, None, :])
    front = actors.length_m[rows[pair]] / 2
    between = (along[:, 0] > front) & (along[:, 0] < front + gap_m[pair])
    between &= np.abs(across[:, 0]) < (actors.width_m[rows[pair]] + actors.width_m[other]) / 2
    hidden[pair[between]] = True
    return hidden


def _seen_from(actors: ActorTable, rows: Ints, xy: Floats) -> tuple[Floats, Floats]:
    """Forward and leftward coordinates (K, P) of points (K, P, 2) as the actors of the rows see them."""
    offset = xy - np.column_stack((actors.x_m[rows], actors.y_m[rows]))[:, None, :]
    cos, sin = np.cos(actors.heading_rad[rows])[:, None], np.sin(actors.heading_rad[rows])[:, None]
    return cos * offset[..., 0] + sin * offset[..., 1], cos * offset[..., 1] - sin * offset[..., 0]
