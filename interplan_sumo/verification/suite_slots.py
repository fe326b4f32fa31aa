"""Slots: what a suite of the benchmark is made of, before any place is chosen.

Families that draw alike share a slot: one place for all of them. A slot says
which drivers its scenes have and on which side of the road it lies, so that the
shares of both are right by construction, for the first ten of a family as well as for forty.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import dataclass
from typing import Final

from interplan_sumo.errors import UnknownNameError
from interplan_sumo.families import FAMILIES, names
from interplan_sumo.scenario.scenario import Behaviour
from interplan_sumo.world.roads import DrivingSide

SIZES: Final = {"interplan==1": 10, "interplan-large==1": 40, "common==1": 10}
"""Scenes per family; the smaller suite of the benchmark is the beginning of the larger one."""
ORDINARY: Final = frozenset({"common==1"})
"""Suites of ordinary driving; the others are the benchmark."""
TEN: Final[tuple[tuple[Behaviour, Behaviour], ...]] = (
    ("conservative", "measured_city_mild"),
    ("measured_city", "mixed"),
    ("assertive", "measured_city_bold"),
    ("measured_city_mild", "conservative"),
    ("mixed", "measured_city"),
    ("measured_city_bold", "assertive"),
    ("conservative", "measured_city_mild"),
    ("measured_city_bold", "assertive"),
    ("mixed", "measured_city"),
    ("measured_city", "mixed"),
)
"""Drivers of ten scenes: three cautious, three that push, four mixed, as in the paper; the paper's types in five of
them, measured ones in the others. The next ten have it the other way round."""
LEFT_EVERY: Final = 3
"""One slot in three lies where one drives on the left, if there are such maps."""
UNSELECTED_OF_TEN: Final = (2, 8)
"""Of ten scenes these may be ones that nobody solves who is asked, so that not every scene is chosen for somebody's
sake; lane changes among them are of two lanes or more, as long as there are places. All other scenes are solved: eight
in ten of each family, and more than nine in ten of all."""


@dataclass(frozen=True, slots=True)
class Slot:
    """A place to be found, for one scene of each of its families."""

    families: tuple[str, ...]
    number: int

    @property
    def name(self) -> str:
        """For people and files."""
        return f"{self.families[0]}-{self.number}"

    @property
    def is_ordinary(self) -> bool:
        """Whether it is one of ordinary driving: with its own drivers, and on roads that other families share."""
        return FAMILIES[self.families[0]].ordinary

    @property
    def behaviour(self) -> Behaviour:
        """The vehicle-type file of its traffic."""
        return TEN[self.number % 10][self.number // 10 % 2]

    @property
    def may_be_open(self) -> bool:
        """Whether its scenes need not be solved by anybody."""
        return self.number % 10 in UNSELECTED_OF_TEN

    @property
    def is_far(self) -> bool:
        """Whether it asks for two lane changes or more, where there is such a place."""
        return self.may_be_open and FAMILIES[self.families[0]].changes_lanes

    def side(self, sides: Collection[DrivingSide]) -> DrivingSide:
        """The side of the road on which one drives there, of those that there are."""
        wanted: DrivingSide = "left" if self.number % LEFT_EVERY == 1 else "right"
        return wanted if wanted in sides else next(iter(sides))


def size_of(suite: str) -> int:
    """Scenes per family of a suite that can be generated; UnknownNameError for another one."""
    if suite not in SIZES:
        raise UnknownNameError("suite", suite, SIZES, "These are the ones that are generated")
    return SIZES[suite]


def beginnings(suite: str) -> list[tuple[str, int]]:
    """The suites that a suite begins with, itself the last: names and scenes per family."""
    alike = [each for each in SIZES if (each in ORDINARY) == (suite in ORDINARY) and SIZES[each] <= SIZES[suite]]
    return sorted(((each, SIZES[each]) for each in alike), key=lambda each: each[1])


def groups(suite: str) -> tuple[tuple[str, ...], ...]:
    """The families that a suite has, in their order, those that draw alike together."""
    found: dict[str, list[str]] = {}
    for name in names(ordinary=suite in ORDINARY):
        found.setdefault(FAMILIES[name].draws_as or name, []).append(name)
    return tuple(tuple(each) for each in found.values())


def slots(suite: str, last: int, first: int = 0) -> list[Slot]:
    """The slots of a suite with numbers from `first` to before `last`."""
    return [Slot(families, number) for families in groups(suite) for number in range(first, last)]


@dataclass(frozen=True, slots=True)
class Seed:
    """What all places are drawn from."""

    value: int
    tag: str = ""
    """Stands in the ids of what was made from a secret seed, so that they are nobody else's."""

    @classmethod
    def secret(cls, text: bytes) -> Seed:
        """From the content of a file that is kept back; nothing of it can be told from the tag."""
        digest = hashlib.sha256(b"interplan-sumo secret seed\n" + text.strip()).digest()
        return cls(int.from_bytes(digest[:8], "big"), f"hidden-{hashlib.sha256(digest).hexdigest()[:8]}-")

    def id(self, family: str, number: int) -> str:
        """The id of a scene."""
        return f"{family}/{self.tag}{number}"
