"""Hybrid planner: once a second somebody chooses a behaviour, ten times a second PDM drives it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Protocol

from interplan_llm.hybrid.behaviour_paths import BehaviourPaths
from interplan_llm.hybrid.behaviours import Behaviour, offered
from interplan_llm.hybrid.choosers import ModelChooser, RandomChooser, RuleChooser
from interplan_llm.hybrid.scene import DecisionScene, SceneObserver
from interplan_llm.models.exchanges import Exchange, usage_stats
from interplan_llm.models.spec import open_model
from interplan_llm.models.store import Mode
from interplan_planners.common.pdm import PdmMotion, PdmSettings
from interplan_sumo.errors import InputError
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.trajectory import Trajectory

FALLBACK_LIMIT_MPS = 15.0
"""Where the map knows no limit (the published number)."""


class BehaviourChooser(Protocol):
    """Chooses among behaviours that a scene offers."""

    def start(self, mission: Mission) -> None:
        """A new episode; nothing of the last one may remain."""
        ...

    def choose(
        self, scene: DecisionScene, options: tuple[Behaviour, ...], now: Behaviour | None
    ) -> tuple[Behaviour, float]:
        """One of the options (two or more), and how many seconds from now on it takes until it is known.

        `now` is what is being done; None at the first decision.
        """
        ...


@dataclass(frozen=True, slots=True)
class BehaviourDecision:
    """One choice."""

    time_s: float
    """When it was asked for."""
    options: tuple[Behaviour, ...]
    behaviour: Behaviour


class HybridPlanner:
    """Drives what a chooser chooses; whoever that is: a language model, a coin, an oracle.

    A decision holds for `every_s`, or until the next is known; it takes effect when
    it is known, and until then the last one goes on, if it is still offered. A single option is taken without
    asking. The motion is PDM's on the line that the behaviour leads to.
    """

    def __init__(self, chooser: BehaviourChooser, every_s: float = 1.0, recorded: Sequence[Trajectory] = ()) -> None:
        """`recorded` are plans, one per step, of an earlier drive that was the same until they end."""
        if not every_s > 0.0:
            raise ValueError(f"every_s is {every_s}, expected more than 0")
        self.chooser = chooser
        self.every_s = every_s
        self._recorded = tuple(recorded)
        self.decisions: list[BehaviourDecision] = []

    def start(self, mission: Mission) -> None:
        self._watch = SceneObserver(mission, FALLBACK_LIMIT_MPS)
        self._behaviour_paths = BehaviourPaths(self._watch)
        self._motion = PdmMotion(PdmSettings(), mission.shape)
        self._shape = mission.shape
        self._now: Behaviour | None = None
        self._pending: tuple[float, Behaviour] | None = None
        self._asks_at_s: float | None = None
        self._step = 0
        self.decisions = []
        self.chooser.start(mission)

    def plan(self, observation: Observation) -> Trajectory:
        asks = self._asks_at_s is None or observation.time_s >= self._asks_at_s - 1e-6
        known = self._pending is not None and observation.time_s >= self._pending[0] - 1e-6
        if asks or known:
            self._decide(observation, self._watch.scene(observation), asks)
        self._step += 1
        if self._step <= len(self._recorded):
            return self._recorded[self._step - 1]
        plan, _ = self._motion.plan(observation, self._corridor)
        return plan

    def _decide(self, observation: Observation, scene: DecisionScene, asks: bool) -> None:
        """Ask if it is time to, and set out on what is known now; what is no longer offered gives way."""
        options = offered(scene)
        self._take(observation.time_s)
        if asks:
            self._ask(scene, options)
            self._take(observation.time_s)
        behaviour = self._now if self._now is not None and self._now in options else options[0]
        self._corridor = self._behaviour_paths.corridor(behaviour, scene, observation.ego.rear_axle(self._shape))

    def _ask(self, scene: DecisionScene, options: tuple[Behaviour, ...]) -> None:
        if len(options) == 1:
            chosen, delay_s = options[0], 0.0
        else:
            chosen, delay_s = self.chooser.choose(scene, options, self._now)
        self.decisions.append(BehaviourDecision(scene.time_s, options, chosen))
        if self._now is None:
            delay_s = 0.0
        self._pending = (scene.time_s + delay_s, chosen)
        self._asks_at_s = scene.time_s + max(self.every_s, delay_s)

    def _take(self, time_s: float) -> None:
        """What is known by now takes effect."""
        if self._pending is not None and time_s >= self._pending[0] - 1e-6:
            self._now = self._pending[1]
            self._pending = None


@dataclass(frozen=True, slots=True)
class HybridSettings:
    """Options of `llm_hybrid`."""

    model: str = "embedded"
    store: str | None = None
    """Where answers are recorded or played back, as `mode` says."""
    mode: Mode = "record"
    memory: bool = False
    thoughts: bool = False
    real_time: bool = False
    every_s: float = 1.0
    timeout_s: float = 60.0
    threads: int = 1
    seed: int = 0
    """The coin's, or the model's."""


class HybridLlmPlanner(HybridPlanner):
    """The paper's hybrid: a language model chooses the behaviour, zero-shot; PDM moves the car.

    `model` is what docs/language_models.md says: `embedded`, a URL and a
    model's name, recorded answers, ...; or `random` for a coin and `rules` for a
    few rules in its place. InputError for options that change nothing then.
    """

    paper: ClassVar[str] = "Hallgarten et al. 2024"

    Settings = HybridSettings

    def __init__(self, settings: HybridSettings | None = None) -> None:
        given = settings or HybridSettings()
        super().__init__(_chooser(given), given.every_s)

    @property
    def exchanges(self) -> Sequence[Exchange] | None:
        """What was asked in this episode, and answered; None where no model is asked."""
        return self.chooser.exchanges if isinstance(self.chooser, ModelChooser) else None

    def report(self) -> dict[str, Any]:
        """How often a model was asked in this episode, and how often in vain."""
        return {} if self.exchanges is None else usage_stats(self.exchanges)


def _chooser(given: HybridSettings) -> BehaviourChooser:
    match given.model:
        case "random":
            _refuse_idle(given, "seed")
            return RandomChooser(given.seed)
        case "rules":
            _refuse_idle(given)
            return RuleChooser()
        case model:
            return ModelChooser(
                open_model(model, store=given.store, mode=given.mode, threads=given.threads),
                memory=given.memory, thoughts=given.thoughts, real_time=given.real_time, timeout_s=given.timeout_s,
                seed=given.seed,
            )  # fmt: skip


def _refuse_idle(given: HybridSettings, *used: str) -> None:
    """InputError for options that are for a language model, where none is asked."""
    options = [each for each in fields(given) if each.name not in ("model", "every_s", *used)]
    idle = [each.name for each in options if getattr(given, each.name) != each.default]
    if idle:
        raise InputError(f"model={given.model} is no language model, so leave {', '.join(idle)} away")
