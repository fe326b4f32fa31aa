"""The families of scenarios: one module each, with its rows as data, what sites suit it, and how to draw new ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from interplan_sumo.families import accident, construction, jaywalker, lane_change, nudge, overtake
from interplan_sumo.scenario.scenario import Density, Scenario
from interplan_sumo.scenario.sites import Site
from interplan_sumo.world.roads import Roads


@dataclass(frozen=True, slots=True)
class Family:
    """A family of scenarios."""

    name: str
    suitable: Callable[[Roads, str, float], Site]
    """The site at a place (lane, arc length) of a map; UnsuitableError with the reason if the place does not do."""
    drawn: Callable[[str, Roads, Site, np.random.Generator], Scenario]
    """A new scenario with an id at a site; UnsuitableError if what was drawn finds no room."""
    scenarios: tuple[Scenario, ...]
    """The official ten."""


def _without_roads(
    draw: Callable[[str, Site, np.random.Generator], Scenario],
    id: str,
    _roads: Roads,
    site: Site,
    rng: np.random.Generator,
) -> Scenario:
    return draw(id, site, rng)


def _change(density: Density, id: str, roads: Roads, site: Site, rng: np.random.Generator) -> Scenario:
    return lane_change.drawn(id, roads, site, density, rng)


_ALL: Final = (
    Family("construction", construction.suitable, partial(_without_roads, construction.drawn), construction.SCENARIOS),
    Family("accident", accident.suitable, partial(_without_roads, accident.drawn), accident.SCENARIOS),
    Family("jaywalker", jaywalker.suitable, partial(_without_roads, jaywalker.drawn), jaywalker.SCENARIOS),
    Family("nudge", nudge.suitable, partial(_without_roads, nudge.drawn), nudge.SCENARIOS),
    Family("overtake", overtake.suitable, partial(_without_roads, overtake.drawn), overtake.SCENARIOS),
    *(
        Family(name, lane_change.suitable, partial(_change, density), lane_change.SCENARIOS[name])
        for name, density in lane_change.FAMILIES.items()
    ),
)
FAMILIES: Final[dict[str, Family]] = {family.name: family for family in _ALL}
"""In the order of the paper's table."""
