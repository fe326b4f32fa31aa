"""Training scenes: generated ones on the shipped maps, apart from every scenario of a suite."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Final, Literal

from interplan_sumo.errors import InputError
from interplan_sumo.families import names
from interplan_sumo.maps.store import load_roads, maps
from interplan_sumo.scenario.files import read_scenarios
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import suites
from interplan_sumo.verification.generation import generate
from interplan_sumo.verification.ordinary_scenes import FIRST_SEED

Split = Literal["train", "val"]

START_APART_M: Final = 5.0
"""A scene that starts nearer than this to a scenario of a suite is not used."""
HELD_OUT: Final = (10, 4)
"""Of so many rounds through the families, this one is for validation."""
STRAYS: Final = (3, 2)
"""Of so many scenes, this one begins with a coin that chooses."""


@dataclass(frozen=True, slots=True)
class TrainingScene:
    """One scene, and how it is driven."""

    number: int
    """In order of the scenes."""
    scenario: Scenario
    seed: int
    """Of its traffic, and of the coin; a seed belongs to one scene."""

    @property
    def split(self) -> Split:
        rounds, held_out = HELD_OUT
        return "val" if self.number // len(names(ordinary=False)) % rounds == held_out else "train"

    @property
    def strays(self) -> bool:
        """Whether a coin chooses at first, so that the drive gets where no rule would take it."""
        of, this = STRAYS
        return self.number % of == this


def generated_scenes(per_family: int, seeds_from: int = FIRST_SEED) -> list[TrainingScene]:
    """`per_family` scenes of each family of interplan, from map to map; fewer where the maps have no room for more.

    They come in rounds through the families. InputError for seeds that are not for training.
    """
    _check_seeds(seeds_from)
    if per_family < 1:
        raise InputError(f"per-family is {per_family}, expected 1 or more")
    places = list(maps())
    where = [
        (places[(row + column) % len(places)], family)
        for row in range(per_family)
        for column, family in enumerate(names(ordinary=False))
    ]
    made = {key: iter(_apart(*key, number, seeds_from)) for key, number in Counter(where).items()}
    found = [(number, next(made[key], None)) for number, key in enumerate(where)]
    return [TrainingScene(number, scene, seeds_from + number) for number, scene in found if scene is not None]


def scenes_of(files: Sequence[Path], seeds_from: int = FIRST_SEED) -> list[TrainingScene]:
    """The scenarios of files, in their order; InputError if one of them is too near to one of a suite."""
    _check_seeds(seeds_from)
    scenarios = [scenario for file in files for scenario in read_scenarios(file)]
    for scenario in scenarios:
        near = near_official(scenario)
        if near is not None:
            raise InputError(f"{scenario.id} is where {near.id} is, which is for testing; leave it out")
    ids = [scenario.id for scenario in scenarios]
    if len(set(ids)) < len(ids):
        twice = next(id for i, id in enumerate(ids) if id in ids[:i])
        raise InputError(f"there are two scenarios {twice!r}; give one of them another id")
    return [TrainingScene(number, scenario, seeds_from + number) for number, scenario in enumerate(scenarios)]


def near_official(scenario: Scenario) -> Scenario | None:
    """A scenario of any suite that takes place on the same site, or starts within 5 m of it; None where there is none.

    The site is the roadblock and the 10 m of it where the first obstacle or
    pedestrian is, or else the goal.
    """
    roads = load_roads(scenario.map, scenario.maps_beside)
    here, site = scenario.start.pose(roads), scenario.site(roads)
    for official in _officials(scenario.map):
        there = official.start.pose(roads)
        starts_here = hypot(here.x_m - there.x_m, here.y_m - there.y_m) < START_APART_M
        if starts_here or official.site(roads) == site:
            return official
    return None


def _officials(map_name: str) -> Iterator[Scenario]:
    return (scenario for suite in suites().values() for scenario in suite.scenarios if scenario.map == map_name)


def _apart(where: str, family: str, number: int, seed: int) -> list[Scenario]:
    """The first `number` generated scenes that are not where a suite is, or as many as there are."""
    asked = number
    while True:
        made = generate(load_roads(where), family, asked, seed).scenarios
        apart = [scenario for scenario in made if near_official(scenario) is None]
        if len(apart) >= number or len(made) < asked:
            return apart[:number]
        asked += number - len(apart)


def _check_seeds(seeds_from: int) -> None:
    if seeds_from < FIRST_SEED:
        raise InputError(f"seeds-from is {seeds_from}, expected {FIRST_SEED} or more: smaller seeds are for testing")
