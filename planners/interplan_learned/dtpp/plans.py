"""Plans: the tree, pruned by the network's scores; the same for a step of a drive and for held-out samples."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from interplan_learned.card import Size
from interplan_learned.dtpp.inputs import shown
from interplan_learned.dtpp.sizes import SIZES
from interplan_learned.dtpp.tree import POSE, TreeStart, best_parents, first_stage, second_stage
from interplan_sumo.features.view import Arrays
from interplan_sumo.world.geometry import Floats

Decode = Callable[[Arrays], NDArray[Any]]
"""Scores (B, M) of branches as `inputs.shown` gives them; higher is better."""


def plans(start: TreeStart, decode: Decode, size: Size) -> Floats:
    """(B, 80, 3) poses 0.1 s apart: the child with the best sum of its own and its parent's score.

    All zeros, which is to stop, where there is no path.
    """
    tree = SIZES[size].tree
    first = first_stage(start, tree)
    scores = decode(shown(first, start, size))
    second = second_stage(start, first, best_parents(scores, first.valid, tree.parents), tree)
    sums = decode(shown(second, start, size)) + np.take_along_axis(scores, second.parent, axis=1)
    best = best_parents(sums, second.valid, 1)
    chosen = np.take_along_axis(second.motion, np.maximum(best, 0)[..., None, None], axis=1)[:, 0, :, POSE]
    return chosen * (best[..., None] >= 0)
