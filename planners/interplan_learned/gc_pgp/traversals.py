"""Traversals: chains of edges through the lane graph, sampled from the scores of a policy."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from interplan_learned.gc_pgp.local_graph import NONE
from interplan_learned.gc_pgp.sizes import PATH_NODES
from interplan_sumo.world.geometry import Floats, Ints

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
