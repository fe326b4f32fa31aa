"""Plans: from what the two graphs say to poses, the same for a step of a drive and for held-out samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.gc_pgp.clusters import chosen
from interplan_learned.gc_pgp.headings import with_headings
from interplan_learned.gc_pgp.sizes import LATENTS, PATH_NODES, Dimensions
from interplan_learned.gc_pgp.traversals import chances, sampled
from interplan_sumo.features.view import Arrays
from interplan_sumo.world.geometry import Floats

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
