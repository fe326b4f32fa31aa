"""Candidates: which scenes are tried for a slot, one place after the other, none of them taken before."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

from interplan_sumo.families import FAMILIES
from interplan_sumo.families.generate import Search
from interplan_sumo.scenario.scenario import Scenario, perception_named
from interplan_sumo.scenario.sites import Rejected
from interplan_sumo.verification.light_windows import green_too_soon, light_problems
from interplan_sumo.verification.suite_slots import SIZES, Seed, Slot, groups
from interplan_sumo.world.lane_changes import lane_changes_needed
from interplan_sumo.world.roads import DrivingSide, Roads

MOST_TAKEN: Final = 200
"""So many places in a row that are taken, and a map counts as used up."""
SIDE_TRIES: Final = 12
"""A slot for which so many candidates of its side of the road failed takes those of the other, too."""
MANY_CHANGES: Final = 2
ALONE: Final = 10
"""The slots below have a roadblock each; those from here on, and ordinary ones, share one where there is no other."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A scene of each family of a slot, at one place."""

    slot: Slot
    attempt: int
    scenarios: tuple[Scenario, ...]
    block: str
    """Map and roadblock where it happens."""

    @property
    def key(self) -> str:
        """Of what it is, not of whom it is for."""
        return "-".join(scenario.hash()[:12] for scenario in self.scenarios)


_Key = tuple[tuple[str, ...], str, bool]
"""Families, map, and whether only scenes of many lane changes are looked for."""


def changes_asked(scenario: Scenario, roads: Roads) -> int:
    """How many lane changes lead to the goal lane."""
    return lane_changes_needed(roads, scenario.route, scenario.goal.lane).get(scenario.start.lane, 0)


def block_of(scenario: Scenario, roads: Roads) -> str:
    """Map and roadblock where a scene happens."""
    return scenario.site(roads).partition("@")[0]


class Streams:
    """All places of all maps, family by family, in an order that a seed decides."""

    def __init__(self, maps: Sequence[Roads], seed: Seed) -> None:
        self._seed = seed
        self._roads = {roads.name: roads for roads in maps}
        everybody = dict.fromkeys(families for suite in SIZES for families in groups(suite))
        self._groups = {families: number for number, families in enumerate(everybody)}
        self._searches: list[Search] = []
        self._running: dict[_Key, Iterator[tuple[Scenario, ...]]] = {}
        self._used_up: set[_Key] = set()
        self.passed_over: list[tuple[Slot, Rejected]] = []
        """Places where lights leave no time."""

    @property
    def unsuitable(self) -> dict[tuple[str, Rejected], None]:
        """The places that did not do, with the family that looked at them; each once."""
        return {(search.family, each): None for search in self._searches for each in search.rejected}

    def next(self, slot: Slot, attempt: int, taken: set[str]) -> Candidate | None:
        """The next candidate for a slot, on a roadblock that is not taken; None if no map has one."""
        for many in (True, False) if slot.is_far else (False,):
            may_share = (slot.number >= ALONE and not many) or slot.is_ordinary
            for shared in (False, True) if may_share else (False,):
                for name in self._in_turn(slot, attempt):
                    found = self._at(slot, attempt, (slot.families, name, many), set() if shared else taken)
                    if found is not None:
                        return found
        return None

    def _in_turn(self, slot: Slot, attempt: int) -> list[str]:
        """The maps of the slot's side, another one first with each attempt, then the others."""
        sides: dict[DrivingSide, list[str]] = {}
        for name, roads in self._roads.items():
            sides.setdefault(roads.driving_side, []).append(name)
        mine = sides.pop(slot.side(tuple(sides)))
        if attempt >= SIDE_TRIES:
            mine = sorted((*mine, *(name for names in sides.values() for name in names)))
            sides = {}
        first = (self._groups[slot.families] + slot.number + attempt) % len(mine)
        return [*mine[first:], *mine[:first], *(name for names in sides.values() for name in names)]

    def _at(self, slot: Slot, attempt: int, key: _Key, taken: set[str]) -> Candidate | None:
        _, map_name, many = key
        if key in self._used_up and taken:
            return None
        stream = self._running.get(key)
        if stream is None:
            stream = self._running[key] = self._stream(slot.families, map_name)
        for _ in range(MOST_TAKEN):
            drawn = next(stream, None)
            if drawn is None:
                break
            roads, first = self._roads[map_name], drawn[0]
            block = block_of(first, roads)
            if block in taken or (many and changes_asked(first, roads) < MANY_CHANGES):
                continue
            if problems := light_problems(first, roads) or green_too_soon(first, roads):
                self.passed_over.append((slot, Rejected(first.goal.lane, first.goal.arc_m, problems[0])))
                continue
            return Candidate(slot, attempt, tuple(self._fitted(slot, each) for each in drawn), block)
        self._used_up.add(key)
        return None

    def _stream(self, families: tuple[str, ...], map_name: str) -> Iterator[tuple[Scenario, ...]]:
        roads = self._roads[map_name]
        search = Search(roads, families[0], self._seed.value)
        self._searches.append(search)
        restaged = [FAMILIES[family].restaged for family in families[1:]]
        for drawn in search:
            yield (drawn, *(as_another(drawn) for as_another in restaged if as_another is not None))

    def _fitted(self, slot: Slot, drawn: Scenario) -> Scenario:
        """A drawn scene as the slot has it: its id, its drivers, and what the planner may see."""
        id = self._seed.id(drawn.family, slot.number)
        if slot.is_ordinary:
            return replace(drawn, id=id)
        modes = [each for each in drawn.perception.split("+") if each not in ("full", "occluded")]
        return replace(
            drawn,
            id=id,
            traffic=replace(drawn.traffic, behaviour=slot.behaviour),
            perception=perception_named("+".join(["occluded", *modes])),
        )
