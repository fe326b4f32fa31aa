"""Distributions that stand for a number in a vehicle-type file, in SUMO's notation: `normc(1,0.1,0.2,2)`.

`norm` and `normc` are those of SUMO's speedFactor; the others, and their meaning, are those of the tool with which SUMO
makes distributions of vehicle types (createVehTypeDistribution).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from math import exp, inf, isfinite, log
from statistics import NormalDist
from typing import Final, Literal

_NAMES: Final[dict[str, Literal["normal", "lognormal", "uniform", "gamma"]]] = {
    "norm": "normal", "normc": "normal", "normal": "normal", "normalCapped": "normal", "lognorm": "lognormal",
    "lognormal": "lognormal", "uniform": "uniform", "gamma": "gamma",
}  # fmt: skip
_FORM = re.compile(r"\s*(\w+)\s*\((.*)\)\s*")
NOTATION: Final = "a distribution such as normc(mean,deviation,lowest,highest)"
LEAST_MASS: Final = 1e-3
"""A distribution of which less lies within its bounds is a mistake."""


@dataclass(frozen=True, slots=True)
class NumberDistribution:
    """A distribution of one number, cut to the values from `lowest` to `highest`."""

    shape: Literal["normal", "lognormal", "uniform", "gamma"]
    first: float
    """Mean (of the logarithm, for lognormal), lower end of uniform, shape of gamma."""
    second: float
    """Standard deviation (of the logarithm), upper end, rate."""
    lowest: float = -inf
    highest: float = inf

    def within(self, lowest: float, highest: float) -> NumberDistribution:
        """The same, cut to a range as well; ValueError if next to nothing of it lies there."""
        cut = replace(self, lowest=max(self.lowest, lowest), highest=min(self.highest, highest))
        if cut.lowest > cut.highest or cut.mass() < LEAST_MASS:
            raise ValueError(f"hardly ever from {lowest:g} to {highest:g}")
        return cut

    def mass(self) -> float:
        """The share of the uncut distribution that is left."""
        if self.constant is not None:
            return float(self.lowest <= self.constant <= self.highest)
        return self._share_below(self.highest) - self._share_below(self.lowest)

    @property
    def constant(self) -> float | None:
        """The only value, where there is no spread."""
        if self.shape == "normal" and self.second == 0.0:
            return self.first
        if self.shape == "lognormal" and self.second == 0.0:
            return exp(self.first)
        return self.first if self.shape == "uniform" and self.first == self.second else None

    def quantile(self, share: float) -> float:
        """The value below which a share of the draws lies."""
        if self.constant is not None:
            return self.constant
        low, high = self._share_below(self.lowest), self._share_below(self.highest)
        value = self._value_at(min(max(low + share * (high - low), 1e-12), 1.0 - 1e-12))
        return min(max(value, self.lowest), self.highest)

    def _share_below(self, value: float) -> float:
        if value == inf:
            return 1.0
        if self.shape == "normal":
            return NormalDist(self.first, self.second).cdf(value) if value > -inf else 0.0
        if self.shape == "uniform":
            return min(1.0, max(0.0, (value - self.first) / (self.second - self.first)))
        if value <= 0.0:
            return 0.0
        if self.shape == "lognormal":
            return NormalDist(self.first, self.second).cdf(log(value))
        from scipy.special import gammainc

        return float(gammainc(self.first, value * self.second))

    def _value_at(self, share: float) -> float:
        if self.shape == "uniform":
            return self.first + share * (self.second - self.first)
        if self.shape == "gamma":
            from scipy.special import gammaincinv

            return float(gammaincinv(self.first, share)) / self.second
        value = NormalDist(self.first, self.second).inv_cdf(share)
        return exp(value) if self.shape == "lognormal" else value


def parse_distribution(text: str) -> NumberDistribution | None:
    """The distribution that a text stands for, None if it is not of that form; ValueError says what is wrong."""
    found = _FORM.fullmatch(text)
    if found is None:
        return None
    name, inner = found.groups()
    if name not in _NAMES:
        raise ValueError(f"{name!r} is no distribution; known: {', '.join(_NAMES)}")
    try:
        given = [float(each) for each in inner.split(",")]
    except ValueError:
        given = []
    shape = _NAMES[name]
    if not 2 <= len(given) <= (2 if shape in ("uniform", "gamma") else 4) or not all(isfinite(each) for each in given):
        raise ValueError(f"expected {NOTATION}")
    first, second, *bounds = given
    lowest, highest = (*bounds, *(-inf, inf)[len(bounds) :])
    if shape == "gamma" and not (first > 0.0 and second > 0.0):
        raise ValueError("shape and rate of a gamma distribution are above 0")
    if second < (first if shape == "uniform" else 0.0) or lowest > highest:
        raise ValueError("a deviation is at least 0, and a range goes from low to high")
    return NumberDistribution(shape, first, second, lowest, highest)
