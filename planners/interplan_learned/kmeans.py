"""K-means, for many sets of points at once; the same for the same points."""

from __future__ import annotations

import numpy as np

from interplan_sumo.world.geometry import Floats, Ints


def kmeans(points: Floats, first: Ints, count: int, rounds: int) -> Ints:
    """(B, N) cluster, 0 to count - 1, of each point (B, N, D), after Lloyd's rounds. Clusters may be empty.

    The first centre is the point `first` (B,), each next one that farthest from all before.
    """
    centres = _spread(points, first, count)
    kind = _nearest(points, centres)
    for _ in range(rounds):
        member = kind[..., None] == np.arange(count)
        held = member.sum(axis=1)
        sums = member.transpose(0, 2, 1).astype(np.float64) @ points
        centres = np.where(held[..., None] > 0, sums / np.maximum(held, 1)[..., None], centres)
        again = _nearest(points, centres)
        if np.array_equal(again, kind):
            break
        kind = again
    return kind


def _spread(points: Floats, first: Ints, count: int) -> Floats:
    """(B, count, D) points (B, N, D) far from each other."""
    batch = np.arange(len(points))
    centre = points[batch, first]
    found, off = [centre], ((points - centre[:, None]) ** 2).sum(axis=-1)
    while len(found) < count:
        found.append(points[batch, off.argmax(axis=1)])
        off = np.minimum(off, ((points - found[-1][:, None]) ** 2).sum(axis=-1))
    return np.stack(found, axis=1)


def _nearest(points: Floats, centres: Floats) -> Ints:
    apart = (centres**2).sum(axis=-1)[:, None] - 2.0 * points @ centres.transpose(0, 2, 1)
    return apart.argmin(axis=-1)
