"""Draws: everything that a family leaves to chance, by name, so that a scene can be drawn, noted down and chosen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import TypeVar

import numpy as np

from interplan_sumo.world.geometry import Floats

Option = TypeVar("Option")


@dataclass(frozen=True, slots=True)
class Draw:
    """One thing that was left to chance."""

    value: float | str
    quantile: float
    """Of the value in its distribution, 0 to 1; of one of several values the middle of its share."""
    tail: float
    """The probability of a value at least as far out as this one; half of its own share counts where values repeat."""


class Draws:
    """A generator of random numbers that knows what each is for.

    A name that is drawn again in the same scene is noted as `name 2`, `name 3`,
    and so on. Without `chosen` everything comes from the generator as it is.
    With it, a name takes the value that its distribution has at the quantile
    chosen for it, and a name that is not chosen one at a quantile that is drawn.
    """

    def __init__(self, rng: np.random.Generator, chosen: Mapping[str, float] | None = None) -> None:
        self._rng = rng
        self._chosen = None if chosen is None else dict(chosen)
        self.found: dict[str, Draw] = {}
        """What was drawn for the scene, in order."""

    def uniform(self, name: str, bounds: tuple[float, float], decimals: int | None = 2) -> float:
        """A number between bounds, all alike likely; rounded, for scenarios are data that people read."""
        low, high = bounds
        at = self._at(name)
        exact = float(self._rng.uniform(low, high)) if at is None else low + at * (high - low)
        value = exact if decimals is None else float(np.round(exact, decimals))
        quantile = (exact - low) / (high - low) if high > low else 0.5
        return self._noted(name, value, quantile)

    def whole(self, name: str, bounds: tuple[int, int]) -> int:
        """A whole number from the first bound to the last, all alike likely."""
        low, high = bounds
        at = self._at(name)
        many = high - low + 1
        value = int(self._rng.integers(low, high + 1)) if at is None else low + min(int(at * many), many - 1)
        self._noted(name, value, (value - low + 0.5) / many)
        return value

    def normal(self, name: str, mean_and_deviation: tuple[float, float], within: tuple[float, float]) -> float:
        """A number of a normal distribution; what falls outside is moved to the nearer of the bounds `within`."""
        law = NormalDist(*mean_and_deviation)
        at = self._at(name)
        free = float(self._rng.normal(law.mean, law.stdev)) if at is None else law.inv_cdf(min(max(at, 1e-9), 1 - 1e-9))
        return self._noted(name, float(np.clip(free, *within)), law.cdf(free))

    def happens(self, name: str, share: float) -> bool:
        """Whether something is there that has this share."""
        at = self._at(name)
        there = bool((self._rng.random() if at is None else at) < share)
        self._note(name, "yes" if there else "no", (share, 1.0 - share), 0 if there else 1)
        return there

    def one_of(self, name: str, options: Sequence[Option]) -> Option:
        """One of several things, all alike likely."""
        at = self._at(name)
        many = len(options)
        row = int(self._rng.integers(many)) if at is None else min(int(at * many), many - 1)
        self._note(name, options[row], (1.0 / many,) * many, row)
        return options[row]

    def by_share(self, name: str, shares: Mapping[Option, float]) -> Option:
        """One of several things that have these shares, of 1 in all."""
        at = self._at(name)
        likely = list(shares.values())
        if at is None:
            row = int(self._rng.choice(len(likely), p=likely))
        else:
            row = min(int(np.searchsorted(np.cumsum(likely), at, side="right")), len(likely) - 1)
        option = list(shares)[row]
        self._note(name, option, likely, row)
        return option

    def order(self, many: int) -> list[int]:
        """Numbers below `many` in any order; no parameter of a scene."""
        return self._rng.permutation(many).tolist()

    def scatter(self, bounds: tuple[float, float], many: int) -> Floats:
        """(many,) numbers between bounds, too small to be parameters of a scene."""
        return self._rng.uniform(*bounds, many)

    def tries(self, most: int) -> Iterator[int]:
        """The numbers of tries of which only the last one counts: what those before drew is forgotten."""
        before = dict(self.found)
        for number in range(most):
            self.found = dict(before)
            yield number

    def _at(self, name: str) -> float | None:
        """The quantile to take; None leaves it to the generator. One that was chosen is taken once."""
        if self._chosen is None:
            return None
        at = self._chosen.pop(self._key(name), None)
        return float(self._rng.random()) if at is None else at

    def _noted(self, name: str, value: float, quantile: float) -> float:
        self.found[self._key(name)] = Draw(value, quantile, 2.0 * min(quantile, 1.0 - quantile))
        return value

    def _note(self, name: str, option: object, shares: Sequence[float], row: int) -> None:
        own = shares[row]
        rarer = sum(each for each in shares if each < own - 1e-9)
        alike = sum(each for each in shares if abs(each - own) <= 1e-9)
        value = option if isinstance(option, str | int | float) else str(row + 1)
        self.found[self._key(name)] = Draw(value, sum(shares[:row]) + own / 2.0, rarer + alike / 2.0)

    def _key(self, name: str) -> str:
        number = 1
        while (key := name if number == 1 else f"{name} {number}") in self.found:
            number += 1
        return key
