"""Balance: which of many possible samples are taken, so that what is rare is not drowned by what is common."""

from __future__ import annotations

import numpy as np

from interplan_sumo.world.geometry import Ints


def balanced(groups: Ints, count: int, rng: np.random.Generator) -> Ints:
    """Places (up to `count`,) in `groups` (N,), in increasing order: as many of each group as can be.

    Groups that have fewer give all they have, the others fill up with equal
    numbers. Which members of a group are taken is drawn.
    """
    order = rng.permutation(len(groups))
    rank = np.zeros(len(groups), dtype=np.int64)
    for group in np.unique(groups):
        members = order[groups[order] == group]
        rank[members] = np.arange(len(members))
    first = np.lexsort((groups, rank))[:count]
    return np.sort(first)


def spread(frames: Ints, most: int) -> Ints:
    """At most so many of the places in `frames` (N,), in order and evenly spread."""
    if len(frames) <= most:
        return np.arange(len(frames))
    return np.unique(np.linspace(0, len(frames) - 1, most).round().astype(np.int64))
