"""Trajectory tree: cubic speed profiles along reference paths, to 3 s and from there to 8 s; many samples at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.dtpp.sizes import TreeSize
from interplan_sumo.world.geometry import Floats, Ints

STEP_S: Final = 0.1
STEPS: Final = 80
FIRST_STEPS: Final = 30
"""The first stage ends after 3 s, the second after 8 s, as published."""
BRAKING_MPS2, PUSHING_MPS2 = 4.0, 2.4
"""Bounds of the speeds that are aimed at."""
MERGED_M: Final = 0.5
"""Of leaves that end nearer to each other than this, the first stays."""
POSE, SPEED, ACCELERATION, CURVATURE = slice(0, 3), 3, 4, 5
"""Channels of a branch: x, y, yaw, then these."""


@dataclass(frozen=True, slots=True, eq=False)
class Branches:
    """The leaves of one stage, each with its motion from the present on; ego frame, rear axle.

    Rows that do not exist are 0.
    """

    motion: Floats
    """(B, M, steps, 6): x, y, yaw, speed, acceleration, curvature after each step."""
    arc_m: Floats
    """(B, M, steps) on their paths."""
    path: Ints
    """(B, M)"""
    parent: Ints
    """(B, M) the leaf of the stage before."""
    valid: NDArray[np.bool_]
    """(B, M)"""


@dataclass(frozen=True, slots=True, eq=False)
class TreeStart:
    """Where trees begin."""

    paths: NDArray[Any]
    """(B, P, points, 4) as `paths.reference_paths` gives them."""
    paths_valid: NDArray[np.bool_]
    """(B, P)"""
    speed_mps: Floats
    """(B,)"""
    acceleration_mps2: Floats
    """(B,)"""
    limit_mps: Floats
    """(B,)"""


def target_speeds(speed_mps: Floats, limit_mps: Floats, seconds: float, count: int) -> Floats:
    """(..., count) speeds to reach after so long, from the hardest braking to the hardest push or the limit."""
    least = np.maximum(speed_mps - BRAKING_MPS2 * seconds, 0.0)
    most = np.maximum(np.minimum(speed_mps + PUSHING_MPS2 * seconds, limit_mps), least)
    return least[..., None] + (most - least)[..., None] * np.linspace(0.0, 1.0, count)


def cubic_speeds(speed_mps: Floats, acceleration_mps2: Floats, target_mps: Floats, steps: int) -> Floats:
    """(..., steps) speeds on cubics from a speed and acceleration to a speed with none, after each step; none negative.

    All arguments are (...).
    """
    span_s = steps * STEP_S
    u = np.arange(1, steps + 1) / steps
    gained, pushed = (target_mps - speed_mps)[..., None], (acceleration_mps2 * span_s)[..., None]
    cubic = speed_mps[..., None] + pushed * (u - 2.0 * u**2 + u**3) + gained * (3.0 * u**2 - 2.0 * u**3)
    return np.maximum(cubic, 0.0)


def first_stage(start: TreeStart, size: TreeSize) -> Branches:
    """Every path with every speed of the grid; merged, then at most `size.branches`."""
    count, paths = start.paths_valid.shape
    targets = target_speeds(start.speed_mps, start.limit_mps, FIRST_STEPS * STEP_S, size.first_speeds)
    shape = (count, paths, size.first_speeds)
    speeds = cubic_speeds(
        np.broadcast_to(start.speed_mps[:, None, None], shape),
        np.broadcast_to(start.acceleration_mps2[:, None, None], shape),
        np.broadcast_to(targets[:, None], shape),
        FIRST_STEPS,
    ).reshape(count, -1, FIRST_STEPS)
    path = np.broadcast_to(np.repeat(np.arange(paths), size.first_speeds), speeds.shape[:2])
    valid = np.repeat(start.paths_valid, size.first_speeds, axis=1)
    return _kept(_branches(start, speeds, path, np.zeros_like(path), valid), size.branches)


def second_stage(start: TreeStart, first: Branches, parents: Ints, size: TreeSize) -> Branches:
    """Children of some leaves (B, K) of the first stage, -1 where there is none: on with the parent's path."""
    count, chosen = parents.shape
    rows, valid = np.maximum(parents, 0), parents >= 0
    held = np.take_along_axis(first.motion[..., SPEED], rows[..., None], axis=1)
    steps = STEPS - FIRST_STEPS
    targets = target_speeds(held[..., -1], start.limit_mps[:, None], steps * STEP_S, size.second_speeds)
    speeds = cubic_speeds(np.broadcast_to(held[..., -1:], targets.shape), np.zeros(targets.shape), targets, steps)
    before = np.broadcast_to(held[:, :, None], (*targets.shape, FIRST_STEPS))
    whole = np.concatenate((before, speeds), axis=-1).reshape(count, chosen * size.second_speeds, STEPS)
    path = np.repeat(np.take_along_axis(first.path, rows, axis=1), size.second_speeds, axis=1)
    parent, exists = np.repeat(rows, size.second_speeds, axis=1), np.repeat(valid, size.second_speeds, axis=1)
    return _kept(_branches(start, whole, path, parent, exists), size.branches)


def best_parents(scores: NDArray[Any], valid: NDArray[np.bool_], count: int) -> Ints:
    """(B, count) leaves with the highest scores (B, M), the best first; -1 where there are fewer."""
    ranked = np.where(valid, scores, -np.inf)
    rows = np.argsort(-ranked, axis=1, kind="stable")[:, :count]
    return np.where(np.take_along_axis(valid, rows, axis=1), rows, -1)


def _branches(start: TreeStart, speeds: Floats, path: Ints, parent: Ints, valid: NDArray[np.bool_]) -> Branches:
    """All leaves with speeds (B, K, T) on paths (B, K), before any of them is left out."""
    before = np.broadcast_to(start.speed_mps[:, None, None], (*speeds.shape[:2], 1))
    known = np.concatenate((before, speeds), axis=-1)
    arc_m = np.cumsum((known[..., 1:] + known[..., :-1]) * (STEP_S / 2.0), axis=-1)
    acceleration = np.diff(known, axis=-1) / STEP_S
    on_path = _places(start.paths, path, arc_m)
    motion = np.concatenate((on_path[..., :3], speeds[..., None], acceleration[..., None], on_path[..., 3:]), axis=-1)
    return Branches(motion * valid[..., None, None], arc_m, path, parent, valid)


def _places(paths: NDArray[Any], path: Ints, arc_m: Floats) -> Floats:
    """(B, K, T, 4) x, y, yaw, curvature at arc lengths on paths with a point every metre; straight on beyond them."""
    last = paths.shape[2] - 1
    row = np.minimum(arc_m.astype(np.int64), last - 1)
    sample = np.arange(len(paths))[:, None, None]
    one = paths[sample, path[..., None], row].astype(np.float64)
    other = paths[sample, path[..., None], row + 1]
    share = (arc_m - row)[..., None]
    found = one + share * (other - one)
    found[..., 2:] = one[..., 2:] + np.minimum(share, 1.0) * (other - one)[..., 2:]
    return found


def _kept(all_leaves: Branches, most: int) -> Branches:
    """Without leaves that end beside an earlier one; if more are left than there is room for, evenly spread ones."""
    ends = all_leaves.motion[:, :, -1, :2]
    apart_m = np.hypot(*np.moveaxis(ends[:, :, None] - ends[:, None], -1, 0))
    valid = all_leaves.valid.copy()
    for leaf in range(1, valid.shape[1]):
        valid[:, leaf] &= ~((apart_m[:, leaf, :leaf] < MERGED_M) & valid[:, :leaf]).any(axis=1)
    left = np.count_nonzero(valid, axis=1)
    order = np.argsort(~valid, axis=1, kind="stable")
    number = np.arange(most)
    spread = np.rint(number * (left[:, None] - 1) / (most - 1)).astype(np.int64)
    wanted = np.where(left[:, None] > most, spread, np.minimum(number, valid.shape[1] - 1))
    rows = np.take_along_axis(order, wanted, axis=1)
    exists = number < left[:, None]
    return Branches(
        np.take_along_axis(all_leaves.motion, rows[..., None, None], axis=1) * exists[..., None, None],
        np.take_along_axis(all_leaves.arc_m, rows[..., None], axis=1),
        np.take_along_axis(all_leaves.path, rows, axis=1),
        np.take_along_axis(all_leaves.parent, rows, axis=1),
        exists,
    )
