"""Oracle: what a planner that lets others choose could reach, found by trying the choices out. Privileged.

It drives the scenario many times over before it decides, so it bounds what any
chooser can be worth. Nothing of it can be registered as a planner.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.score import ScoreSheet, score
from interplan_sumo.planner import Mission, Planner
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import DT_S, Episode, drive
from interplan_sumo.world.trace import EgoTrack
from interplan_sumo.world.trajectory import Trajectory

ENOUGH = 0.999
"""A drive that scores this much needs no better choices."""
BETTER = 1e-6


class Chooser(Protocol):
    """Chooses among options in a scene, as the planner has both; says how many seconds it took."""

    def start(self, mission: Mission) -> None: ...

    def choose(self, scene: Any, options: tuple[Any, ...], now: Any) -> tuple[Any, float]: ...


MakePlanner = Callable[[Chooser, Sequence[Trajectory]], Planner]
"""A planner for a chooser, and for plans that it may repeat instead of making them again (the same until they end)."""


@dataclass(frozen=True, slots=True)
class Value:
    """What a drive was worth: its score first, then the gates it kept, then how far it got."""

    score: float
    gates: int
    progress: float
    """0 to 1."""

    @classmethod
    def of(cls, sheet: ScoreSheet) -> Value:
        kept = sum((sheet.metrics[name].score or 0.0) >= 1.0 for name in sheet.gates)
        return cls(sheet.score, kept, sheet.metrics["progress"].score or 0.0)

    def beats(self, other: Value) -> bool:
        mine, theirs = (self.score, self.gates, self.progress), (other.score, other.gates, other.progress)
        for a, b in zip(mine, theirs, strict=True):
            if abs(a - b) > BETTER:
                return a > b
        return False


FAILED = Value(-1.0, 0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """One decision, and what each option led to."""

    scene: Any
    options: tuple[Any, ...]
    values: tuple[Value, ...]
    best: Any
    """An option of the highest value; of several the one that was being done, or that the policy would take."""


@dataclass(frozen=True, slots=True, eq=False)
class OracleDrive:
    """The best drive that was found."""

    episode: Episode
    value: Value
    tried: tuple[Tried, ...]
    """Decision by decision; none after the drive was good enough."""
    drives: int
    """How many it took."""


@dataclass(slots=True)
class _Script:
    """Plays choices, then goes on with a policy, and remembers what was asked."""

    choices: tuple[Any, ...]
    policy: Chooser
    asked: list[tuple[Any, tuple[Any, ...]]] = field(default_factory=list[tuple[Any, tuple[Any, ...]]])
    taken: list[Any] = field(default_factory=list[Any])
    frames: list[int] = field(default_factory=list[int])
    """Of the decisions."""

    def start(self, mission: Mission) -> None:
        self.asked, self.taken, self.frames = [], [], []
        self.policy.start(mission)

    def choose(self, scene: Any, options: tuple[Any, ...], now: Any) -> tuple[Any, float]:
        k = len(self.asked)
        own, _ = self.policy.choose(scene, options, now)  # always asked, so that it knows what it would
        self.asked.append((scene, options))
        self.taken.append(self.choices[k] if k < len(self.choices) else own)
        self.frames.append(round(scene.time_s / DT_S))
        return self.taken[-1], 0.0


def oracle_drive(
    scenario: Scenario, expert: EgoTrack, make: MakePlanner, policy: Chooser, *, seed: int = 0, every: int = 1
) -> OracleDrive:
    """The best drive that is found by changing one choice after the other, in order of time.

    Each option of a decision is tried by a whole drive: the choices so far, the
    option, and then the policy until the end; the plans until the decision are
    repeated, not made again. The choice that led to the best drive
    stands, and the next decision is that of this drive. So the result is never worse
    than the policy. `every` n-th decision is looked at (1: each).
    """
    best, best_script, best_value = _driven(scenario, expert, make, (), policy, (), seed)
    tried: list[Tried] = []
    drives = 1
    k = 0
    while k < len(best_script.asked) and best_value.score < ENOUGH:
        scene, options = best_script.asked[k]
        held = best_script.taken[k]
        plans = () if best.trace is None else best.trace.plans[: best_script.frames[k]]
        values = {held: best_value}
        before = tuple(best_script.taken[:k])
        for option in options:
            if option == held:
                continue
            drives += 1
            episode, script, value = _driven(scenario, expert, make, (*before, option), policy, plans, seed)
            values[option] = value
            if value.beats(best_value):
                best, best_script, best_value = episode, script, value
        tried.append(Tried(scene, options, tuple(values[option] for option in options), best_script.taken[k]))
        k += every
    return OracleDrive(best, best_value, tuple(tried), drives)


def _driven(
    scenario: Scenario,
    expert: EgoTrack,
    make: MakePlanner,
    choices: tuple[Any, ...],
    policy: Chooser,
    plans: Sequence[Trajectory],
    seed: int,
) -> tuple[Episode, _Script, Value]:
    script = _Script(choices, policy)
    episode = drive(scenario, make(script, plans), seed=seed)
    if episode.trace is None or episode.fault is not None:
        return episode, script, FAILED
    roads = load_roads(scenario.map, scenario.maps_beside)
    return episode, script, Value.of(score(episode.trace, roads, expert, scenario))
