"""Data: the samples of a split in memory, only what a recipe needs, and which of them an epoch shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from interplan_learned.kmeans import kmeans
from interplan_sumo.dataset.columns import Columns, count_of, joined, picked
from interplan_sumo.dataset.reading import Dataset
from interplan_sumo.dataset.records import Split
from interplan_sumo.errors import InputError
from interplan_sumo.world.geometry import Floats, Ints
from tools.train.recipe import Recipe, fields_of

CLUSTERS: Final = 20
"""Kinds of ego futures among which training is balanced: FlowDrive's number."""
_LOOKED_AT: Final = (19, 39, 59, 79)
"""Frames of the future that tell its kind: 2, 4, 6 and 8 s ahead."""
_ROUNDS: Final = 30


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Samples in memory, as the recipe keeps them."""

    columns: Columns

    def __len__(self) -> int:
        return count_of(self.columns)

    def picked(self, rows: Ints) -> Columns:
        return picked(self.columns, rows)


def read_samples(dataset: Dataset, split: Split, recipe: Recipe, share: float = 1.0) -> Samples:
    """The samples of a split, or those of a share of its drives, drawn: larger shares hold the smaller ones.

    InputError if there are none.
    """
    data = dataset.split(split)
    if not len(data):
        raise InputError(
            f"{dataset.folder} has no samples in its split {split!r}; "
            "export with --holdout-seeds or --holdout-maps, so that there are some to train on and some to test with"
        )
    if not 0.0 < share <= 1.0:
        raise InputError(f"share is {share:g}, expected more than 0 and at most 1")
    drives = len(dataset.drives)
    drawn = np.random.default_rng(drives).permutation(drives) < share * drives
    parts: list[Columns] = []
    for number in range(len(data.shards)):
        rows = np.flatnonzero(drawn[data.shard(number, ("drive",))["drive"]])
        if len(rows):
            parts.append(recipe.keep(picked(data.shard(number, fields_of(recipe)), rows), dataset))
    if not parts:
        raise InputError(f"a share of {share:g} of {drives} drives holds no samples of {split!r}; take more")
    return Samples(joined(parts))


def held_out_split(dataset: Dataset) -> Split:
    """The split that decides when training stops: other seeds, and where there are none other maps."""
    return "val" if len(dataset.split("val")) else "test"


class Balanced:
    """Draws samples so that rare kinds of futures come more often: with the inverse root of how common their kind is.

    Kinds are K-means clusters of where the ego will be; a future that ends early counts as standing at its end.
    """

    def __init__(self, future: NDArray[Any]) -> None:
        """`future` is `ego_future` (S, 80, 4)."""
        kind = _clusters(_places(future), CLUSTERS)
        share = np.bincount(kind)[kind] ** -0.5
        self._share: Floats = share / share.sum()

    def draw(self, rng: np.random.Generator) -> Ints:
        """As many rows as there are samples, some twice, some not at all."""
        return rng.choice(len(self._share), len(self._share), p=self._share)


def _places(future: NDArray[Any]) -> Floats:
    last = np.maximum(np.count_nonzero(future[..., 3] > 0.5, axis=1) - 1, 0)
    rows = np.minimum(np.array(_LOOKED_AT), last[:, None])
    return np.take_along_axis(future, rows[..., None], axis=1)[..., :2].reshape(len(future), -1).astype(np.float64)


def _clusters(points: Floats, count: int) -> Ints:
    """(S,) Lloyd's clusters of points (S, D), from the farthest points on; the same for the same points."""
    count = min(count, len(points))
    return kmeans(points[None], np.zeros(1, dtype=np.int64), count, _ROUNDS)[0]
