"""Labels by rollout: what each option of a decision leads to, found by driving on with it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from interplan_llm.hybrid.behaviours import Behaviour
from interplan_llm.hybrid.choosers import ModelChooser, RandomChooser, RuleChooser
from interplan_llm.hybrid.planner import HybridPlanner
from interplan_llm.hybrid.scene import DecisionScene
from interplan_llm.models.scripted import ScriptedModel
from interplan_sumo.errors import ScenarioError
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.verification.replay import reference_drive
from interplan_sumo.world.trajectory import Trajectory
from tools.oracle import ENOUGH, Effort, OracleChooser, Tried, Value, oracle_drive
from tools.tune_llm.scenes import TrainingScene

STEPS_PER_PLAN: Final = 5
"""In rollouts a plan is followed this long: at a third of the time 15 of 16 scenes, two of each family, scored the same
to 0.002 as with a plan per step, and of 44 decisions 41 got the same label."""
MARGIN: Final = 0.02
"""Scores nearer to one another than this are taken for equal."""
STRAY_S: Final = (1.0, 5.0)
"""For how long a coin chooses where a drive shall go astray: least and most."""
HOPELESS: Final = 4
"""After so many decisions that all came to nothing a scene is given up."""
EVERYTHING: Final = 2.0
"""No score is enough: decisions of perfect drives are looked at as well."""
_ASKING: Final = ModelChooser(ScriptedModel(()))
"""Puts the questions as any model gets them: without memory, and without room for thoughts."""


@dataclass(frozen=True, slots=True)
class Labelled:
    """What came of one scene."""

    examples: tuple[dict[str, Any], ...]
    """As they are written, in order of time."""
    drives: int
    reason: str | None = None
    """Why there are none."""


def labelled(training: TrainingScene, *, every: int, hold: int, most_drives: int) -> Labelled:
    """The decisions of a scene that teach something; the same every time.

    `hold` and `most_drives` as in `Effort`; after a decision whose options came
    to the same, the `every`-th is the next one that is looked at. A decision is
    decisive if its options led to scores that differ. Others are kept only if the
    whole drive scored full marks: then nothing was wrong with them, and it does not
    matter whether their options were tried. No question comes twice.
    """
    scenario, policy = training.scenario, StrayingChooser(training)
    try:
        expert = reference_drive(scenario).ego
    except ScenarioError as error:
        return Labelled((), 1, str(error))
    effort = Effort(1, hold, most_drives, EVERYTHING, policy.until_s, Curiosity(every).wants)
    found = oracle_drive(scenario, expert, sparing_planner, policy, seed=training.seed, effort=effort)
    if found.value.failed:
        return Labelled((), found.drives, found.episode.fault.message if found.episode.fault else "nothing was driven")
    made = [tried_example(tried, training) for tried in found.tried if not any(v.failed for v in tried.values)]
    perfect = found.value.score >= ENOUGH
    kept = {_question(each): each for each in made if perfect or each["about"]["decisive"]}
    if perfect:
        looked_at = {tried.scene.time_s for tried in found.tried}
        for choice in found.choices:
            if choice.scene.time_s >= policy.until_s and choice.scene.time_s not in looked_at:
                taken = _example(choice.scene, choice.options, choice.taken, training, {}, held=choice.taken)
                kept.setdefault(_question(taken), taken)
    return Labelled(tuple(sorted(kept.values(), key=lambda each: each["about"]["time_s"])), found.drives)


def _question(example: dict[str, Any]) -> str:
    return example["messages"][1]["content"]


def tried_example(tried: Tried, training: TrainingScene) -> dict[str, Any]:
    """A decision as a question; the answer is the option that was held, unless another one is clearly better."""
    values = dict(zip(tried.options, tried.values, strict=True))
    better = values[tried.best].score - values[tried.held].score >= MARGIN
    return _example(tried.scene, tried.options, tried.best if better else tried.held, training, values, tried.held)


def _example(
    scene: DecisionScene, options: tuple[Behaviour, ...], answer: Behaviour, training: TrainingScene,
    values: Mapping[Behaviour, Value], held: Behaviour,
) -> dict[str, Any]:  # fmt: skip
    request = _ASKING.request(scene, options)
    asked = [{"role": message.role, "content": message.text} for message in request.messages]
    scenario = training.scenario
    return {
        "messages": [*asked, {"role": "assistant", "content": str(answer)}],
        "choices": list(request.choices or ()),
        "about": {
            "scenario": scenario.id, "family": scenario.family, "map": scenario.map, "seed": training.seed,
            "time_s": round(scene.time_s, 3), "strays": training.strays, "held": str(held),
            "values": {str(option): in_numbers(value) for option, value in values.items()},
            "decisive": decides(values.values()), "split": training.split,
        },
    }  # fmt: skip


def in_numbers(value: Value) -> dict[str, float]:
    return {"score": round(value.score, 6), "gates": value.gates, "progress": round(value.progress, 6)}


def decides(values: Iterable[Value]) -> bool:
    """Whether these differ by more than chance."""
    scores = [value.score for value in values]
    return bool(scores) and max(scores) - min(scores) >= MARGIN


class Curiosity:
    """Which decisions of a drive are looked at: new ones, more of them where they matter, none where nothing helps."""

    def __init__(self, every: int) -> None:
        self._every = every
        self._left_out = 0
        self._known: set[str] = set()

    def wants(self, scene: DecisionScene, options: tuple[Behaviour, ...], before: Sequence[Tried]) -> bool:
        question = _ASKING.request(scene, options).messages[-1].text
        is_new = question not in self._known
        self._known.add(question)
        dull = bool(before) and not decides(before[-1].values) and self._left_out < self._every - 1
        hopeless = len(before) >= HOPELESS and all(value.score <= 0.0 for tried in before for value in tried.values)
        wanted = is_new and not dull and not hopeless
        self._left_out = 0 if wanted else self._left_out + 1
        return wanted


class StrayingChooser:
    """A few rules; before them, in scenes that stray, a coin for some seconds."""

    def __init__(self, training: TrainingScene) -> None:
        rng = np.random.default_rng(training.seed)
        self.until_s = float(rng.uniform(*STRAY_S)) if training.strays else 0.0
        self._coin, self._rules = RandomChooser(training.seed), RuleChooser()

    def start(self, mission: Mission) -> None:
        self._coin.start(mission)
        self._rules.start(mission)

    def choose(
        self, scene: DecisionScene, options: tuple[Behaviour, ...], now: Behaviour | None
    ) -> tuple[Behaviour, float]:
        chooser = self._coin if scene.time_s < self.until_s else self._rules
        return chooser.choose(scene, options, now)


class SparingPlanner:
    """The hybrid, asked for a plan only every few steps; in between the last one is followed."""

    def __init__(self, chooser: OracleChooser, recorded: Sequence[Trajectory] = ()) -> None:
        """`recorded` are plans, one per step, of an earlier drive that was the same until they end."""
        self._hybrid = HybridPlanner(chooser, recorded=recorded[::STEPS_PER_PLAN])
        self._step = 0

    def start(self, mission: Mission) -> None:
        self._step = 0
        self._hybrid.start(mission)

    def plan(self, observation: Observation) -> Trajectory:
        if self._step % STEPS_PER_PLAN == 0:
            self._plan = self._hybrid.plan(observation)
        self._step += 1
        return self._plan


def sparing_planner(chooser: OracleChooser, recorded: Sequence[Trajectory]) -> SparingPlanner:
    """Makes the planner that the rollouts drive with."""
    return SparingPlanner(chooser, recorded)
