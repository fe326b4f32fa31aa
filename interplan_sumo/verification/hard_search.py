"""Hard search: scenes of a family in which a panel of planners does badly, each certified and solved by somebody.

Points of the family's scene space are asked for in batches of a fixed size and judged all at once, so that what comes
out does not depend on how many work on it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import ceil
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp

from interplan_sumo.errors import InputError, ScenarioError
from interplan_sumo.families import find_family
from interplan_sumo.families.draws import Draw
from interplan_sumo.families.scene_space import ScenePoint, SceneSpace, quantiles
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.sites import UnsuitableError
from interplan_sumo.verification.hard_judging import HardCandidate, HardVerdict, quick_problems
from interplan_sumo.verification.quality_diversity import DiverseSearch
from interplan_sumo.verification.solvers import SOLVED_SCORE
from interplan_sumo.verification.suite_candidates import block_of
from interplan_sumo.verification.suite_slots import Seed
from interplan_sumo.world.geometry import Floats
from interplan_sumo.world.roads import Roads

BATCH: Final = (6, 16)
"""Scenes that are judged at once, at least and at most: twice as many as are asked for."""
APART: Final = 0.12
"""Scenes differ by so much at least in the quantiles of what they draw, on average; two that are drawn, by a third."""
MOST_MEAN: Final = 0.5
"""Nobody of a panel of several gets a higher mean score in the scenes that are asked for."""
UNFIT: Final = {"start": -1.0, "traffic": -1.0, "fault": -1.0, "certificate": -0.5, "trivial": -0.25, "open": -0.25}
"""What a scene is worth to the search that fails at a stage; others count by how badly the panel does, 0 to 1."""


@dataclass(frozen=True, slots=True)
class HardOptions:
    """What is searched for. InputError for what cannot be."""

    family: str
    panel: tuple[str, ...]
    count: int
    seed: Seed
    least_difficulty: float = 0.5
    """The share of the panel that must fail in a scene."""
    least_plausibility: float = 0.05
    """The share of the family's own scenes that must be no more likely than it."""
    most_judged: int = 2000
    """Scenes that are driven; then the search gives up."""
    maps_beside: Path | None = None
    """The maps root of a map that is not shipped."""

    def __post_init__(self) -> None:
        if not self.panel:
            raise InputError("nobody to search against; name planners with --against")
        if len(set(self.panel)) < len(self.panel):
            raise InputError(f"--against names somebody twice: {', '.join(self.panel)}")
        if self.count < 1 or self.most_judged < 1:
            raise InputError(f"count is {self.count}, budget {self.most_judged}; expected 1 or more")
        for name in ("least_difficulty", "least_plausibility"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise InputError(f"{name.replace('_', ' ')} is {getattr(self, name)}, expected 0 to 1")


def shares(count: int, families: Sequence[str], *, last_first: bool = False) -> dict[str, int]:
    """How many scenes each family has; odd ones go to the first, or to the last, so that two such halves even out."""
    if count < len(families):
        raise InputError(f"count is {count}, expected {len(families)} or more, one for each family")
    least, odd = divmod(count, len(families))
    more = set(families[len(families) - odd :] if last_first else families[:odd])
    return {family: least + (family in more) for family in families}


@dataclass(frozen=True, slots=True)
class HardScene:
    """A scene that was judged."""

    drawn: ScenePoint
    plausibility: float
    candidate: HardCandidate
    verdict: HardVerdict

    @property
    def id(self) -> str:
        return self.drawn.scenario.id


HardJudge = Callable[[Sequence[HardCandidate]], Iterable[tuple[HardCandidate, HardVerdict]]]
"""Finds the verdicts on candidates, in any order."""


@dataclass(slots=True)
class HardSearch:
    """A search, and what it has found so far."""

    maps: Mapping[str, Roads]
    options: HardOptions
    space: SceneSpace
    taken: list[HardScene] = field(default_factory=list[HardScene])
    judged: list[HardScene] = field(default_factory=list[HardScene])
    passed_over: Counter[str] = field(default_factory=Counter[str])
    """Points that were not worth driving, by reason."""
    _waiting: list[tuple[ScenePoint, float]] = field(default_factory=list[tuple[ScenePoint, float]])
    _asked: int = 0

    @classmethod
    def of(cls, maps: Sequence[Roads], options: HardOptions) -> HardSearch:
        """A search on maps; InputError if none has a place for the family."""
        space = SceneSpace(maps, options.family, options.seed.value)
        return cls({roads.name: roads for roads in maps}, options, space)

    @property
    def complete(self) -> bool:
        """Whether all scenes that were asked for are found."""
        return len(self.taken) == self.options.count

    @property
    def cpu_s(self) -> float:
        """What judging took."""
        return sum(scene.verdict.cpu_s for scene in self.judged)

    @property
    def plausible_share(self) -> float:
        """Of the points that make a scene at all, the share that is as likely as it must be."""
        fine = len(self.judged) + self.passed_over["too like another"] + self.passed_over["unsound"]
        return fine / max(fine + self.passed_over["implausible"], 1)

    def run(self, judge: HardJudge, tell: Callable[[HardSearch], None] = lambda _: None) -> None:
        """Search until there are as many scenes as asked for, or the budget is spent; `tell` hears of each batch."""
        batch = min(max(2 * self.options.count, BATCH[0]), BATCH[1])
        search = DiverseSearch(len(self.space.names), batch, self.options.seed.value)
        while not self.complete and len(self.judged) < self.options.most_judged:
            self._waiting = []
            points = search.ask(self._is_worth_a_look)
            if not points:
                return
            candidate_of = self._candidates()
            asked = [(drawn, likely, candidate_of(drawn.scenario)) for drawn, likely in self._waiting]
            verdicts = {candidate.scenario.id: found for candidate, found in judge([each[2] for each in asked])}
            scenes = [HardScene(*each, verdicts[each[2].scenario.id]) for each in asked]
            self.judged += scenes
            search.tell(points, [_worth(scene) for scene in scenes], [self._measures(s.drawn.draws) for s in scenes])
            self.taken = self._chosen()
            tell(self)

    def _is_worth_a_look(self, point: Floats) -> bool:
        """Whether a point makes a sound and likely scene unlike those that are taken; it is kept then."""
        options, number = self.options, self._asked
        self._asked += 1
        rng = np.random.default_rng([options.seed.value, 3, number])
        try:
            drawn = self.space.scene(options.seed.id(options.family, number), rng, quantiles(self.space.names, point))
        except (UnsuitableError, ScenarioError):
            return self._passed_over("no room")
        drawn = replace(drawn, scenario=replace(drawn.scenario, maps_beside=options.maps_beside))
        likely = self.space.plausibility(drawn.draws)
        if likely < options.least_plausibility:
            return self._passed_over("implausible")
        if not self._is_another(drawn, self.taken):
            return self._passed_over("too like another")
        if quick_problems(drawn.scenario, self.maps[drawn.scenario.map]):
            return self._passed_over("unsound")
        self._waiting.append((drawn, likely))
        return True

    def _passed_over(self, reason: str) -> bool:
        self.passed_over[reason] += 1
        return False

    def _candidates(self) -> Callable[[Scenario], HardCandidate]:
        """What the next batch is asked: who has its points in what is taken may solve a scene alone, which takes the
        place of one that others solve, too; who has them from such scenes must fail."""
        options = self.options
        spent = _spent(self._left_to_score(self.taken))
        alone = [scene for scene in self.taken if len(scene.verdict.solved_by) <= 1]
        must_fail = _spent(self._left_to_score(alone))
        return lambda scenario: HardCandidate(
            scenario, options.panel, options.least_difficulty, must_fail, spent - must_fail
        )

    def _left_to_score(self, taken: Sequence[HardScene]) -> dict[str, float]:
        """What each of a panel of several may still get in all, a scene at most 1; nothing binds one alone."""
        options = self.options
        if len(options.panel) == 1:
            return {}
        got = {name: sum(each.verdict.scores[name] for each in taken) for name in options.panel}
        return {name: MOST_MEAN * options.count - scored for name, scored in got.items()}

    def _chosen(self) -> list[HardScene]:
        """The most hard scenes that may be taken together; of as many, those that fewest of the panel solve."""
        hard = [scene for scene in self.judged if not scene.verdict.stage]
        if not hard:
            return []
        blocks = [self._block(scene.drawn.scenario) for scene in hard]
        pairs = [pair for pair in combinations(range(len(hard)), 2) if _alike(*(hard[each].drawn for each in pair))]
        allowed = [
            (np.array([scene.verdict.scores[name] for scene in hard]), left)
            for name, left in self._left_to_score(()).items()
        ]
        allowed += [
            (np.array([here == block for here in blocks]), self._room_on_a_block) for block in dict.fromkeys(blocks)
        ]
        allowed += [(np.isin(np.arange(len(hard)), pair), 1) for pair in pairs]
        allowed += [(np.ones(len(hard)), self.options.count)]
        rows, most = zip(*allowed, strict=True)
        limits: Any = np.array(most, dtype=float)
        worth = [1000.0 - 10.0 * len(scene.verdict.solved_by) - scene.verdict.mean_score for scene in hard]
        found: Any = milp(
            -np.array(worth), integrality=np.ones(len(hard)), bounds=Bounds(0, 1), options={"mip_rel_gap": 0.0},
            constraints=LinearConstraint(np.array(rows, dtype=float), -np.inf, limits),
        )  # fmt: skip
        return [scene for scene, taken in zip(hard, found.x, strict=True) if taken > 0.5]

    def _is_another(self, drawn: ScenePoint, taken: Sequence[HardScene]) -> bool:
        """Whether a scene lies apart from all that are taken, on a roadblock that has room for another one."""
        here = self._block(drawn.scenario)
        on_block = sum(self._block(each.drawn.scenario) == here for each in taken)
        return on_block < self._room_on_a_block and not any(_alike(each.drawn, drawn) for each in taken)

    @property
    def _room_on_a_block(self) -> int:
        return ceil(self.options.count / self.space.blocks)

    def _block(self, scenario: Scenario) -> str:
        return block_of(scenario, self.maps[scenario.map])

    def _measures(self, draws: Mapping[str, Draw]) -> tuple[float, float]:
        names = (*find_family(self.options.family).telling, *self.space.names[1:], self.space.names[0])
        found = [draws[name].quantile for name in names if name in draws]
        return found[0], found[min(1, len(found) - 1)]


def _alike(one: ScenePoint, other: ScenePoint) -> bool:
    return one.apart(other) < APART


def _spent(left_to_score: Mapping[str, float]) -> frozenset[str]:
    """Who would have too much, were it to solve another scene."""
    return frozenset(name for name, left in left_to_score.items() if left < SOLVED_SCORE)


def _worth(scene: HardScene) -> float:
    """How good a scene is for the search: how badly the panel does, who was not asked any more counts as doing well."""
    if scene.verdict.stage in UNFIT:
        return UNFIT[scene.verdict.stage]
    return sum(1.0 - got for got in scene.verdict.scores.values()) / len(scene.candidate.panel)
