"""Plans: from what the two graphs say to poses, the same for a step of a drive and for held-out samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.gc_pgp.local_graph import NONE
from interplan_learned.gc_pgp.sizes import LATENTS, PATH_NODES, Dimensions
from interplan_learned.kmeans import kmeans
from interplan_sumo.features.view import Arrays
from interplan_sumo.world.geometry import Floats, Ints

SEED: Final = 0
"""Of the draws and the noise: the same at every step, so that equal views give equal plans (PGP's)."""

Decode = Callable[[NDArray[np.int64], NDArray[np.float32]], NDArray[Any]]
"""Trajectories (B, T, POSES, 2) from traversals (B, T, PATH_NODES) and noise (B, T, LATENTS)."""


def plans(given: Arrays, scores: NDArray[Any], decode: Decode, size: Dimensions) -> Floats:
    """(B, POSES, 3) poses from `inputs` and the policy's scores (B, M, EDGES + 1); what leaves the route is masked."""
    count, traversals = len(scores), size.drive_traversals
    rng = np.random.default_rng(SEED)
    draws = np.broadcast_to(rng.random((traversals, PATH_NODES)), (count, traversals, PATH_NODES))
    noise = rng.standard_normal((traversals, LATENTS), dtype=np.float32)
    paths = sampled(chances(scores, given["allowed"]), given["edges"], given["allowed_starts"], draws)
    found = decode(paths, np.broadcast_to(noise, (count, traversals, LATENTS)))
    return np.stack([with_headings(points) for points in chosen(found, size.clusters)])


_NEVER = -1e9


def chances(scores: NDArray[Any], open_edges: NDArray[np.bool_]) -> Floats:
    """(B, M, K + 1) the chance of each edge out of a node and, last, of the end there.

    From scores of the same shape; edges that are not in `open_edges` (B, M, K)
    have none: with those of the route alone, this is the route mask.
    """
    masked = scores.astype(np.float64)
    masked[..., :-1] = np.where(open_edges, masked[..., :-1], _NEVER)
    grown = np.exp(masked - masked.max(axis=-1, keepdims=True))
    return grown / grown.sum(axis=-1, keepdims=True)


def sampled(chance: Floats, edges: Ints, starts: NDArray[np.bool_], draws: Floats) -> Ints:
    """(B, T, PATH_NODES) nodes of T traversals from draws (B, T, PATH_NODES) in [0, 1); NONE beyond the last node.

    Each begins on one of the nodes `starts` (B, M), all alike, takes the edges
    (B, M, K) by their chances (B, M, K + 1) and ends where it chooses to, or
    after PATH_NODES nodes. Without a start it is empty.
    """
    batch = np.arange(len(edges))[:, None]
    ahead = np.concatenate((edges, np.full((*edges.shape[:2], 1), NONE)), axis=-1)
    reach = np.cumsum(chance, axis=-1)
    reach[..., -1] = np.inf  # a draw above a sum that rounding made less than 1
    counts = starts.sum(axis=1, keepdims=True)
    order = np.argsort(~starts, axis=1, kind="stable")
    place = np.minimum((draws[..., 0] * counts).astype(np.int64), np.maximum(counts - 1, 0))
    nodes = np.full(draws.shape, NONE, dtype=np.int64)
    nodes[..., 0] = np.where(counts > 0, np.take_along_axis(order, place, axis=1), NONE)
    for step in range(1, PATH_NODES):
        here = nodes[..., step - 1]
        taken = (draws[..., step, None] >= reach[batch, here]).sum(axis=-1)
        nodes[..., step] = np.where(here == NONE, NONE, ahead[batch, here, taken])
    return nodes


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


LEAST_END_M: Final = 0.2
"""A plan that ends less far ahead stands (PGP's)."""
LEAST_STEP_M: Final = 0.5
"""Points closer than this to the last one that counted say nothing of a heading (PGP's)."""


def with_headings(points: NDArray[Any]) -> Floats:
    """(N, 3) poses from points (N, 2) ahead of an ego at 0, 0 with heading 0; all 0 if it hardly moves."""
    path: Floats = np.concatenate((np.zeros((1, 2)), points.astype(np.float64)))
    knots = [0]
    for row in range(1, len(path)):
        if np.hypot(*(path[row] - path[knots[-1]])) >= LEAST_STEP_M:
            knots.append(row)
    if path[-1, 0] < LEAST_END_M or len(knots) < 2:
        return np.zeros((len(points), 3))
    from scipy.interpolate import CubicSpline  # a third of a second that only those who drive should wait

    held = path[knots]
    arc_m = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(held, axis=0).T))))
    ends: Any = ((1, (1.0, 0.0)), "not-a-knot")  # it begins straight ahead
    spline = CubicSpline(arc_m, held, bc_type=ends)
    tangents = spline(arc_m, 1)
    headings = np.arctan2(tangents[:, 1], tangents[:, 0])
    last = np.searchsorted(knots, np.arange(len(path)), side="right") - 1
    return np.concatenate((path, headings[last, None]), axis=1)[1:]
