"""Clusters: many trajectories become a few modes, and the one that stands for most of them is chosen."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.kmeans import kmeans
from interplan_sumo.world.geometry import Floats, Ints

THINNED: Final = 3
"""Every third pose tells trajectories apart (PGP's)."""
_ROUNDS: Final = 10


def clusters(trajectories: NDArray[Any], count: int) -> Ints:
    """(B, T) K-means cluster, 0 to count - 1, of each trajectory (B, T, POSES, 2); equal for equal trajectories.

    The first centre is the trajectory nearest the mean, each next one that
    farthest from all before; then Lloyd's rounds. Clusters may be empty.
    """
    thin = trajectories[:, :, THINNED - 1 :: THINNED].astype(np.float64)
    points = thin.reshape(*thin.shape[:2], -1)
    first = ((points - points.mean(axis=1, keepdims=True)) ** 2).sum(axis=-1).argmin(axis=1)
    return kmeans(points, first, count, _ROUNDS)


def means(trajectories: NDArray[Any], kind: Ints, count: int) -> tuple[Floats, Ints]:
    """(B, count, POSES, 2) mean trajectory of each cluster, 0 for an empty one, and (B, count) how many it holds."""
    member = kind[..., None] == np.arange(count)
    held = member.sum(axis=1)
    flat = trajectories.reshape(*trajectories.shape[:2], -1).astype(np.float64)
    sums = member.transpose(0, 2, 1).astype(np.float64) @ flat
    return (sums / np.maximum(held, 1)[..., None]).reshape(len(kind), count, *trajectories.shape[2:]), held


def ranks(centres: Floats, held: Ints) -> Ints:
    """(K,) rank of each cluster, 1 the best, by Ward's merging of centres (K, D) that hold so many points (K,).

    Again and again the two clusters are merged whose merging costs least
    (n m / (n + m) times their squared distance); the smaller of the two gets the
    worst rank that is left, the other goes on as both. Of equal ones the first
    goes on. Empty clusters come last.
    """
    place, weight = centres.astype(np.float64), held.astype(np.float64)
    found = np.zeros(len(held), dtype=np.int64)
    empty = np.flatnonzero(held == 0)
    left = np.flatnonzero(held > 0).tolist()
    found[empty] = np.arange(len(left) + 1, len(held) + 1)
    while len(left) > 1:
        apart = ((place[left, None] - place[left]) ** 2).sum(axis=-1)
        cost = apart * np.multiply.outer(weight[left], weight[left]) / np.add.outer(weight[left], weight[left])
        np.fill_diagonal(cost, np.inf)
        one, other = (left[k] for k in np.unravel_index(cost.argmin(), cost.shape))
        lost, stays = (one, other) if weight[one] < weight[other] else (other, one)
        found[lost] = len(left)
        both = weight[one] + weight[other]
        place[stays] = (weight[one] * place[one] + weight[other] * place[other]) / both
        weight[stays] = both
        left.remove(lost)
    found[left] = 1
    return found


def chosen(trajectories: NDArray[Any], count: int) -> Floats:
    """(B, POSES, 2) mean of the cluster ranked first, of trajectories (B, T, POSES, 2).

    Modes are as probable as 1 / rank; the most probable one is taken.
    """
    centres, held = means(trajectories, clusters(trajectories, count), count)
    first = [int(ranks(each.reshape(count, -1), n).argmin()) for each, n in zip(centres, held, strict=True)]
    return centres[np.arange(len(first)), first]
