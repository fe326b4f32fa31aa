"""Quality and diversity: points of a space that are good in different ways, by CMA-ES around a grid of the best ones.

Half of each batch comes from a covariance matrix adaptation that ranks its points by how much they improve the grid
(CMA-ME, Fontaine et al. 2020), half from crossing the grid's points with one another (iso+line, Vassiliades and Mouret
2018). The optimiser is `cma`, of the extra [search].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from interplan_sumo.extras import library, need
from interplan_sumo.world.geometry import Floats

CELLS: Final = 6
"""Of the grid, along each of its two sides."""
NOBODY: Final = -2.0
"""The value that a cell without anybody counts as."""
LEAST_EVOLVED: Final = 4
"""Points in a batch that the strategy gives, half of it where that is more."""
RESTART_SIGMA: Final = 0.5
"""Around a point of the grid; the first search begins with 1: the distributions as they are."""
ISO, LINE = 0.2, 0.3
"""Deviation of a crossed point in every direction, and along the line between its parents."""
MOST_ASKED: Final = 400
"""Points that are asked for in a row until one is worth a look."""

Worth = Callable[[Floats], bool]
"""Whether a point is worth a look at all; asked once for each, in order."""


def check_optimiser() -> None:
    """InputError without the library."""
    need("cma", "the search", "search")


_Cell = tuple[int, int]


@dataclass(slots=True)
class EliteGrid:
    """The best point of each cell."""

    best: dict[_Cell, tuple[float, Floats]] = field(default_factory=dict[_Cell, tuple[float, Floats]])

    def improvement(self, value: float, measures: tuple[float, float]) -> float:
        """How much better a point is than the one in its cell."""
        return value - self.best.get(_cell(measures), (NOBODY,))[0]

    def add(self, point: Floats, value: float, measures: tuple[float, float]) -> None:
        """Keep a point if it is better than the one in its cell."""
        if self.improvement(value, measures) > 0.0:
            self.best[_cell(measures)] = (value, point)

    def some(self, rng: np.random.Generator) -> Floats:
        """One of its points."""
        cells = sorted(self.best)
        return self.best[cells[int(rng.integers(len(cells)))]][1]


def _cell(measures: tuple[float, float]) -> _Cell:
    x, y = (min(int(each * CELLS), CELLS - 1) for each in measures)
    return x, y


class DiverseSearch:
    """Batches of points of a space of standard normal coordinates; equal seeds and values give equal batches."""

    def __init__(self, dimensions: int, batch: int, seed: int) -> None:
        check_optimiser()
        self._rng = np.random.default_rng([seed, 2])
        self._dimensions, self._evolved = dimensions, max(LEAST_EVOLVED, batch // 2)
        self._crossed = max(batch - self._evolved, 0)
        self.grid = EliteGrid()
        self._strategy = self._begun(np.zeros(dimensions), 1.0)
        self._offered: list[Floats] = []
        """What the strategy gave, and nobody has looked at yet: it gives whole populations."""
        self._asked = 0

    def ask(self, worth: Worth) -> list[Floats]:
        """Points that are worth a look; fewer than a batch where hardly any is."""
        evolved = self._some(self._evolved, self._evolve, worth)
        self._asked = len(evolved)
        return [*evolved, *self._some(self._crossed, self._cross, worth)]

    def tell(self, points: Sequence[Floats], values: Sequence[float], measures: Sequence[tuple[float, float]]) -> None:
        """What became of the points last asked for, in their order: values, of which high ones are good, and places in
        the grid, 0 to 1."""
        gained = [self.grid.improvement(value, at) for value, at in zip(values, measures, strict=True)]
        for point, value, at in zip(points, values, measures, strict=True):
            self.grid.add(point, value, at)
        evolved = gained[: self._asked]
        self._offered = []
        if len(evolved) == self._evolved and max(evolved) > 0.0:
            self._strategy.tell(list(points[: self._asked]), [-each for each in evolved])
        elif self.grid.best:
            self._strategy = self._begun(self.grid.some(self._rng), RESTART_SIGMA)

    def _evolve(self) -> Floats:
        if not self._offered:
            self._offered = [np.asarray(point) for point in reversed(self._strategy.ask())]
        return self._offered.pop()

    def _begun(self, around: Floats, sigma: float) -> Any:
        options: dict[str, Any] = {
            "popsize": self._evolved,
            "CMA_diagonal": True,  # a few hundred points say little about how dozens of coordinates hang together
            "CMA_mirrors": 0,  # a batch may end before a point has its mirror
            "randn": lambda *shape: self._rng.standard_normal(shape),
            "seed": np.nan,
            "verbose": -9,
        }
        return library("cma", "the search", "search").CMAEvolutionStrategy(around, sigma, options)

    def _cross(self) -> Floats:
        if not self.grid.best:
            return self._rng.standard_normal(self._dimensions)
        one, other = self.grid.some(self._rng), self.grid.some(self._rng)
        along = LINE * self._rng.standard_normal() * (other - one)
        return one + ISO * self._rng.standard_normal(self._dimensions) + along

    @staticmethod
    def _some(many: int, make: Callable[[], Floats], worth: Worth) -> list[Floats]:
        found: list[Floats] = []
        for _ in range(many):
            for _ in range(MOST_ASKED):
                point = make()
                if worth(point):
                    found.append(point)
                    break
            else:
                break
        return found
