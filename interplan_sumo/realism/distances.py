"""Distances between two samples of a feature, and samples in which every road user counts the same.

One car that stands for a minute gives 600 equal values. So a value weighs 1 / (values of its road user): every road
user counts as one, however long it is seen.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from interplan_sumo.world.geometry import Floats, Ints, frozen


@dataclass(frozen=True, eq=False)
class Sample:
    """Values of one feature, each with the number of the road user that it is of. Arrays are made read-only."""

    values: Floats
    """(N,) finite."""
    owners: Ints
    """(N,) equal numbers: the same road user."""

    def __post_init__(self) -> None:
        # The last digits of floats are no difference: without this all who drive at the limit might differ by 1e-15.
        object.__setattr__(self, "values", frozen(np.round(self.values, 9)))
        object.__setattr__(self, "owners", frozen(self.owners, np.int64))
        if self.values.ndim != 1 or self.values.shape != self.owners.shape:
            raise ValueError(f"Sample has values {self.values.shape} of owners {self.owners.shape}")
        if not np.isfinite(self.values).all():
            raise ValueError("Sample holds a number that is not finite")

    @classmethod
    def of(cls, per_owner: Iterable[Sequence[float] | Floats]) -> Self:
        """From the values of each road user; who has none is left out."""
        parts = [np.asarray(part, np.float64) for part in per_owner]
        lengths = [len(part) for part in parts]
        return cls(np.concatenate(parts or [np.zeros(0)]), np.repeat(np.arange(len(parts)), lengths))

    @classmethod
    def pooled(cls, samples: Sequence[Sample]) -> Self:
        """Several samples as one; road users of different samples are different ones."""
        firsts = np.cumsum([0, *(int(each.owners.max(initial=-1)) + 1 for each in samples)])
        owners = [each.owners + first for each, first in zip(samples, firsts, strict=False)]
        values = np.concatenate([np.zeros(0), *(each.values for each in samples)])
        return cls(values, np.concatenate([np.zeros(0, np.int64), *owners]))

    def __len__(self) -> int:
        return len(self.values)

    @cached_property
    def weights(self) -> Floats:
        """(N,) those of a road user sum to 1."""
        _, place, counts = np.unique(self.owners, return_inverse=True, return_counts=True)
        return 1.0 / counts[place] if len(self) else np.zeros(0)

    @cached_property
    def road_users(self) -> int:
        """How many the values are of."""
        return len(np.unique(self.owners))

    @cached_property
    def cumulative(self) -> tuple[Floats, Floats]:
        """The values in ascending order, and the share of the weight at each and before it, 0 to 1."""
        order = np.argsort(self.values, kind="stable")
        reached = np.cumsum(self.weights[order])
        return self.values[order], reached / reached[-1] if len(self) else reached

    def quantile(self, share: float) -> float:
        """The least value at or below which lies this share of the weight; ValueError if there is none."""
        if not len(self):
            raise ValueError("an empty sample has no quantiles")
        values, reached = self.cumulative
        return float(values[min(int(np.searchsorted(reached, share * (1.0 - 1e-12))), len(self) - 1)])

    def shares(self, places: Floats) -> Floats:
        """The share of the weight at or below each place; ValueError if there is none."""
        if not len(self):
            raise ValueError("an empty sample has no distance to another")
        values, reached = self.cumulative
        return np.concatenate([[0.0], reached])[np.searchsorted(values, places, side="right")]


def kolmogorov_smirnov(one: Sample, other: Sample) -> float:
    """The greatest difference of the two weighted cumulative distributions, 0 to 1; ValueError if one is empty."""
    return float(_apart(one, other)[1].max())


def wasserstein(one: Sample, other: Sample) -> float:
    """The area between the two weighted cumulative distributions, in the unit of the feature; ValueError as above.

    It is the way that weight has to be carried on average to make one distribution of the other (1-Wasserstein).
    """
    places, apart = _apart(one, other)
    return float(apart[:-1] @ np.diff(places))


def _apart(one: Sample, other: Sample) -> tuple[Floats, Floats]:
    """All values, ascending, and how far the cumulative distributions are apart from there to the next."""
    places = np.sort(np.concatenate([one.values, other.values]))
    return places, np.abs(one.shares(places) - other.shares(places))
