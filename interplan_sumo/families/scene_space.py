"""Scene space: the scenes of a family on some maps as points, one quantile for everything that is left to chance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import log
from typing import Any, Final

import numpy as np
from scipy.special import gammaincc, ndtr

from interplan_sumo.errors import InputError, ScenarioError
from interplan_sumo.families import FAMILIES
from interplan_sumo.families.draws import Draw, Draws
from interplan_sumo.scenario.route import route_lanes
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.sites import UnsuitableError, places
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads

PLACE: Final = "place"
"""The draw that says where on the maps it is."""
MOST_PLACES: Final = 400
"""On all maps together; a map has its share of them, drawn."""
ORDINARY: Final = 200
"""Scenes that the family draws, to know what is usual."""
TRIES_EACH: Final = 5
OFTEN: Final = 0.1
"""What is drawn in a smaller share of them has no quantile of its own in the space."""


@dataclass(frozen=True, slots=True)
class ScenePoint:
    """A scene, and what was drawn for it."""

    scenario: Scenario
    draws: Mapping[str, Draw]

    def apart(self, other: ScenePoint) -> float:
        """How far another scene lies from this one: the mean difference of quantiles, 1 for what only one has."""
        return quantiles_apart(*({name: draw.quantile for name, draw in each.draws.items()} for each in (self, other)))


class SceneSpace:
    """All that a family may stage on some maps; equal maps, families and seeds give equal spaces.

    InputError if no map has a place that suits.
    """

    def __init__(self, maps: Sequence[Roads], family: str, seed: int) -> None:
        self._name, self._family = family, FAMILIES[family]
        self._places = [each for roads in maps for each in self._suitable(roads, MOST_PLACES // len(maps), seed)]
        if not self._places:
            raise InputError(
                f"no place of {', '.join(roads.name for roads in maps)} suits {family}; name another --map"
            )
        rng = np.random.default_rng([seed, 1])
        usual = list(self._ordinary(rng))
        if not usual:
            raise InputError(f"no scene of {family} finds room on {', '.join(each.name for each in maps)}")
        often = Counter(name for scene in usual for name in scene.draws)
        self.names = tuple(name for name, count in often.items() if count >= OFTEN * len(usual))
        """What a quantile can be chosen for, the place first."""
        self._usual = np.sort([likelihood(scene.draws) for scene in usual])
        roads_of = {roads.name: roads for roads in maps}
        sites = (scene.scenario.site(roads_of[scene.scenario.map]) for scene in usual)
        self.blocks = len({site.partition("@")[0] for site in sites})
        """On how many roadblocks such scenes lie."""

    def scene(self, id: str, rng: np.random.Generator, chosen: Mapping[str, float] | None = None) -> ScenePoint:
        """A scene with these quantiles, and others drawn; the map's name is put before its `id`.

        UnsuitableError or ScenarioError if what was drawn finds no room.
        """
        draws = Draws(rng, chosen)
        roads, place = self._places[draws.whole(PLACE, (0, len(self._places) - 1))]
        scenario = self._family.drawn(f"{roads.name}.{id}", roads, place, draws)
        scenario.check(roads)
        route_lanes(roads, scenario)
        return ScenePoint(scenario, draws.found)

    def plausibility(self, draws: Mapping[str, Draw]) -> float:
        """The share of the scenes which the family draws here that are no more likely than this one, all in all."""
        return float(np.searchsorted(self._usual, likelihood(draws), side="right")) / len(self._usual)

    def _suitable(self, roads: Roads, most: int, seed: int) -> list[tuple[Roads, Any]]:
        """Places that suit, in the order of the map: neighbours are alike."""
        everywhere = list(places(roads))
        order = np.random.default_rng([seed, 0]).permutation(len(everywhere))
        found: dict[int, Any] = {}
        for row in order.tolist():
            try:
                found[row] = self._family.suitable(roads, *everywhere[row])
            except (UnsuitableError, ScenarioError):
                continue
            if len(found) >= most:
                break
        return [(roads, found[row]) for row in sorted(found)]

    def _ordinary(self, rng: np.random.Generator) -> Iterator[ScenePoint]:
        found = 0
        for number in range(TRIES_EACH * ORDINARY):
            try:
                yield self.scene(f"{self._name}/{number}", rng)
            except (UnsuitableError, ScenarioError):
                continue
            found += 1
            if found == ORDINARY:
                return


def likelihood(draws: Mapping[str, Draw]) -> float:
    """How usual draws are all together: Fisher's combined probability of their tails, 0 to 1.

    A density would not do: most ranges are drawn evenly, and where every number
    lies at the end of its range a density sees nothing unusual.
    """
    tails = [each.tail for name, each in draws.items() if name != PLACE]
    surprise = -sum(log(max(tail, 1e-12)) for tail in tails)
    return float(gammaincc(len(tails), surprise)) if tails else 1.0


def quantiles_apart(one: Mapping[str, float], other: Mapping[str, float]) -> float:
    """How far two scenes lie apart by the quantiles of what was drawn: the mean difference, 1 for what only one has."""
    names = (one.keys() | other.keys()) - {PLACE}
    both = sorted(name for name in names if name in one and name in other)  # sums keep one order
    differences = sum(abs(one[name] - other[name]) for name in both)
    return (differences + len(names) - len(both)) / len(names) if names else 0.0


def quantiles(names: Sequence[str], normal: Floats) -> dict[str, float]:
    """Quantiles of a point whose coordinates are standard normal numbers."""
    return dict(zip(names, np.clip(ndtr(normal), 1e-6, 1.0 - 1e-6).tolist(), strict=True))
