"""New scenarios of any family on any map, from a seed: equal seeds give equal scenarios."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from interplan_sumo.errors import ScenarioError
from interplan_sumo.families import FAMILIES, Family
from interplan_sumo.families.draws import Draws
from interplan_sumo.scenario.route import route_lanes
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.sites import Rejected, UnsuitableError, places
from interplan_sumo.world.roads import Roads

APART_M = 50.0
"""Sites on one roadblock this far apart count as different (decisions.md)."""


@dataclass(slots=True)
class Search:
    """Generates scenarios of one family, if there is one of that name, on one map; remembers what it passed over."""

    roads: Roads
    family: str
    seed: int
    rejected: list[Rejected] = field(default_factory=list[Rejected])
    """Places that do not suit, with the reasons, as far as they were looked at."""
    _family: Family[Any] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._family = FAMILIES[self.family]

    def __iter__(self) -> Iterator[Scenario]:
        """Scenarios without end, on sites apart from one another as long as the map has them.

        Ends at once if the map has no suitable place.
        """
        rng = _rng(self.roads.name, self._family.draws_as or self.family, self.seed)
        everywhere = list(places(self.roads))
        crowded: list[tuple[str, float]] = []
        taken: dict[str, list[float]] = {}
        number = 0
        for row in rng.permutation(len(everywhere)):
            lane_id, at_m = everywhere[int(row)]
            others = taken.setdefault(self.roads[lane_id].roadblock_id, [])
            if any(abs(at_m - other_m) < APART_M for other_m in others):
                crowded.append((lane_id, at_m))
                continue
            made = self._made(lane_id, at_m, number, rng)
            if made is not None:
                others.append(at_m)
                number += 1
                yield made
        while crowded:  # every place of its own is used: go round those beside them, then round again
            before = number
            for lane_id, at_m in crowded:
                made = self._made(lane_id, at_m, number, rng)
                if made is not None:
                    number += 1
                    yield made
            if number == before:
                return

    def _made(self, lane_id: str, at_m: float, number: int, rng: np.random.Generator) -> Scenario | None:
        id = f"{self.roads.name}.{self.family}/{self.seed}-{number}"
        try:
            place = self._family.suitable(self.roads, lane_id, at_m)
            scenario = self._family.drawn(id, self.roads, place, Draws(rng))
            scenario.check(self.roads)
            route_lanes(self.roads, scenario)
        except (UnsuitableError, ScenarioError) as reason:
            self.rejected.append(Rejected(lane_id, at_m, str(reason)))
            return None
        return scenario


def _rng(map_name: str, family: str, seed: int) -> np.random.Generator:
    digest = hashlib.sha256(f"generate {map_name} {family} {seed}".encode()).digest()
    return np.random.default_rng(np.frombuffer(digest, dtype=np.uint32))
