"""What takes two runs to tell, or one without an ego: bad starts, reactions to what is behind, equal runs."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from tests.simulation.traffic_invariants import DT_S, TOLERANCE_MPS2, Array, Body, Drive, Violation, corners_of

REACTION_MPS2 = 1.0
"""Braking that much harder than without an ego is a reaction."""
SAME_M, SAME_MPS = 0.02, 0.01
"""Two runs are still the same for an agent up to these differences."""
ROUNDING = 1e-6
SUDDEN_FRAMES = 3
"""A reaction shows within so many frames of the first difference of all; what grows more slowly came from others."""
CONTAGION_M = 150.0
"""Who is this near to somebody that moves otherwise than without an ego, or is in one run only, may brake for it.

Cross traffic of 25 m/s that is 6 s away from a junction is.
"""
BESIDE_M = 2.0
"""Who is less than that to the side of an agent's axis is in its lane."""
SPAWN_S, SPAWN_BRAKING_MPS2 = 2.0, 3.0


def spawn_braking(without_ego: Drive, bodies: Mapping[str, Body]) -> Iterator[Violation]:
    """Agents that brake hard as soon as they are there, in the twin run, where no ego can be the reason.

    Who does so because one ahead has just braked as hard is not to blame, nor is its start.
    """
    change = np.diff(without_ego.sumo_mps, axis=0) / DT_S
    for i, name in enumerate(without_ego.ids):
        if name not in bodies:
            continue
        begins = int(np.flatnonzero(without_ego.there[:, i])[0])
        early = change[begins : begins + round(SPAWN_S / DT_S), i]
        if np.isfinite(early).any() and np.nanmin(early) < -SPAWN_BRAKING_MPS2 - TOLERANCE_MPS2:
            k = begins + int(np.nanargmin(early))
            if _one_ahead_braked_as_hard(without_ego, change, k, i):
                continue
            yield Violation("spawn_braking", k + 1, name, float(-change[k, i]), f"there since frame {begins}")


def _one_ahead_braked_as_hard(drive: Drive, change: Array, k: int, i: int) -> bool:
    """Whether one straight ahead of agent `i` braked as hard, at frame `k` or just before; `change` is in m/s2."""
    dx, dy = drive.x_m[k] - drive.x_m[k, i], drive.y_m[k] - drive.y_m[k, i]
    along, across = np.cos(drive.heading_rad[k, i]), np.sin(drive.heading_rad[k, i])
    ahead = dx * along + dy * across
    leads = (ahead > 0.0) & (ahead < CONTAGION_M) & (np.abs(dy * along - dx * across) < BESIDE_M)
    before = np.nan_to_num(change[max(0, k - SUDDEN_FRAMES) : k + 1]).min(axis=0)
    return bool((before[leads] <= change[k, i]).any())


def reactions_to_what_is_behind(
    drive: Drive, twin: Drive, bodies: Mapping[str, Body], giving_way: Collection[tuple[int, str]] = ()
) -> Iterator[Violation]:
    """Agents that brake for an ego that is wholly behind their front bumpers, by comparison with the run without it.

    Looked for where an agent first drives otherwise than in the twin run while
    nobody near it did before: then nothing but the ego can be the reason. Who
    stands and lets the ego go first at a junction does not brake; who wants the
    ego's lane and gives way to it, by frame and agent in `giving_way`, may.
    """
    ids = sorted({*drive.ids, *twin.ids})
    last = min(len(drive.x_m), len(twin.x_m))
    mine, other = (_columns(each, ids, last) for each in (drive, twin))
    slower = other[2] - mine[2]
    away = np.hypot(other[0] - mine[0], other[1] - mine[1])
    braked = -np.diff(mine[2], axis=0, prepend=mine[2][:1])
    alone = np.isnan(mine[0]) != np.isnan(other[0])
    first, touched = (
        np.where(differs.any(axis=0), differs.argmax(axis=0), last)
        for differs in (
            alone | (np.abs(slower) > SAME_MPS) | (away > SAME_M),
            alone | (np.abs(slower) > ROUNDING) | (away > ROUNDING),
        )
    )
    walks = np.array([name not in bodies for name in ids], dtype=bool)  # who will set out is foreseen
    for i, name in enumerate(ids):
        k = int(first[i])
        if k == 0 or k >= last or alone[k, i] or name not in bodies:
            continue
        if not min(slower[k, i], braked[k, i]) > REACTION_MPS2 * DT_S or (k - 1, name) in giving_way:
            continue
        x, y = mine[0][k, i], mine[1][k, i]
        near = np.minimum(*(np.nan_to_num(np.hypot(px[k] - x, py[k] - y), nan=np.inf) for px, py, *_ in (mine, other)))
        touched_before = touched < k + np.where(walks, SUDDEN_FRAMES, 0) - (np.arange(len(ids)) == i) * SUDDEN_FRAMES
        if (touched_before & (near < CONTAGION_M)).any():
            continue
        ego_x, ego_y, heading, length, width = drive.ego[k - 1]
        corners = corners_of(np.array([ego_x]), np.array([ego_y]), np.array([heading]), np.array([[length, width]]))[0]
        x, y, here = (part[k - 1, i] for part in (mine[0], mine[1], mine[3]))
        half = drive.length_m[drive.ids.index(name)] / 2.0
        ahead = (corners - (x, y)) @ np.array((np.cos(here), np.sin(here))) - half
        if ahead.max() < 0.0:
            detail = f"more than without the ego, whose nearest corner is {-ahead.max():.1f} m behind its front"
            yield Violation("reacts_behind", k, name, float(slower[k, i] / DT_S), detail)


def same(one: Drive, other: Drive, names: Sequence[str], frame: int) -> bool:
    """Whether some actors are bit by bit where they are in another run up to a frame."""
    if not all(name in drive.ids for drive in (one, other) for name in names):
        return False
    mine, theirs = (
        np.stack([part[: frame + 1, [each.ids.index(name) for name in names]] for part in each.states])
        for each in (one, other)
    )
    return bool(np.array_equal(mine, theirs, equal_nan=True))


def _columns(drive: Drive, ids: Sequence[str], last: int) -> tuple[Array, Array, Array, Array]:
    """(last, N) x, y, speed and heading of actors by id, nan where they are not there."""
    wide = np.full((4, last, len(ids)), np.nan)
    at = [ids.index(name) for name in drive.ids]
    for row, values in zip(wide, (drive.x_m, drive.y_m, drive.speed_mps, drive.heading_rad), strict=True):
        row[:, at] = values[:last]
    return wide[0], wide[1], wide[2], wide[3]
