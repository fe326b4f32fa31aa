"""Oracle: what a planner that lets others choose could reach, found by trying the choices out. Privileged.

It drives the scenario many times over before it decides, so it bounds what any
chooser can be worth. Nothing of it can be registered as a planner.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf
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


class OracleChooser(Protocol):
    """Chooses among options in a scene, as the planner has both; says how many seconds it took."""

    def start(self, mission: Mission) -> None: ...

    def choose(self, scene: Any, options: tuple[Any, ...], now: Any) -> tuple[Any, float]: ...


MakePlanner = Callable[[OracleChooser, Sequence[Trajectory]], Planner]
"""A planner for a chooser, and for plans that it may repeat instead of making them again (the same until they end)."""


@dataclass(frozen=True, slots=True)
class Value:
    """What a drive was worth: its score first, then the gates it kept, then how far it got."""

    score: float
    gates: int
    progress: float
    """0 to 1; of a drive that ended in a fault, the share of its time that was driven."""

    @classmethod
    def of(cls, sheet: ScoreSheet) -> Value:
        kept = sum((sheet.metrics[name].score or 0.0) >= 1.0 for name in sheet.gates)
        return cls(sheet.score, kept, sheet.metrics["progress"].score or 0.0)

    @property
    def failed(self) -> bool:
        """Whether the drive ended in a fault: less than any other, the later the better."""
        return self.score < 0.0

    def beats(self, other: Value) -> bool:
        mine, theirs = (self.score, self.gates, self.progress), (other.score, other.gates, other.progress)
        for a, b in zip(mine, theirs, strict=True):
            if abs(a - b) > BETTER:
                return a > b
        return False


@dataclass(frozen=True, slots=True, eq=False)
class OracleChoice:
    """One decision, and what was taken."""

    scene: Any
    options: tuple[Any, ...]
    taken: Any


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """One decision, and what each option led to."""

    scene: Any
    options: tuple[Any, ...]
    values: tuple[Value, ...]
    held: Any
    """The option of the best drive until then."""
    best: Any
    """An option of the highest value; the one that was held if no other is better."""


def _always(_scene: Any, _options: tuple[Any, ...], _before: Sequence[Tried]) -> bool:
    return True


@dataclass(frozen=True, slots=True)
class Effort:
    """How much is tried."""

    every: int = 1
    """Every n-th decision is looked at."""
    hold: int = 1
    """An option that is tried is kept for so many decisions, as long as it is offered; then the policy chooses."""
    most_drives: float = inf
    """After so many no further decision is looked at."""
    enough: float = ENOUGH
    """A drive with this score ends it; above 1, all decisions are looked at whatever the score."""
    after_s: float = 0.0
    """Decisions before this time are left to the policy."""
    worth: Callable[[Any, tuple[Any, ...], Sequence[Tried]], bool] = _always
    """Whether a decision is looked at, by its scene, its options and those that were looked at before."""

    def __post_init__(self) -> None:
        for name in ("every", "hold", "most_drives"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}, expected 1 or more")


@dataclass(frozen=True, slots=True, eq=False)
class OracleDrive:
    """The best drive that was found."""

    episode: Episode
    value: Value
    choices: tuple[OracleChoice, ...]
    """Its decisions."""
    tried: tuple[Tried, ...]
    """Those that were looked at, in order of time; none after the drive was good enough."""
    drives: int
    """How many it took."""


EFFORT = Effort()


@dataclass(slots=True)
class _Script:
    """Plays choices, keeps the last one for a while where it is offered, then goes on with a policy.

    Remembers what was asked, and what was taken.
    """

    choices: tuple[Any, ...]
    policy: OracleChooser
    hold: int = 1
    asked: list[tuple[Any, tuple[Any, ...]]] = field(default_factory=list[tuple[Any, tuple[Any, ...]]])
    taken: list[Any] = field(default_factory=list[Any])
    frames: list[int] = field(default_factory=list[int])
    """Of the decisions."""

    def start(self, mission: Mission) -> None:
        self.asked, self.taken, self.frames = [], [], []
        self.policy.start(mission)

    def choose(self, scene: Any, options: tuple[Any, ...], now: Any) -> tuple[Any, float]:
        own, _ = self.policy.choose(scene, options, now)  # always asked, so that it knows what it would
        self.taken.append(self._scripted(len(self.asked), options, own))
        self.asked.append((scene, options))
        self.frames.append(round(scene.time_s / DT_S))
        return self.taken[-1], 0.0

    @property
    def made(self) -> tuple[OracleChoice, ...]:
        return tuple(OracleChoice(*asked, option) for asked, option in zip(self.asked, self.taken, strict=True))

    def _scripted(self, k: int, options: tuple[Any, ...], own: Any) -> Any:
        if k < len(self.choices):
            return self.choices[k]
        kept = bool(self.choices) and k < len(self.choices) + self.hold - 1 and self.choices[-1] in options
        return self.choices[-1] if kept else own


def oracle_drive(
    scenario: Scenario,
    expert: EgoTrack,
    make: MakePlanner,
    policy: OracleChooser,
    *,
    seed: int = 0,
    effort: Effort = EFFORT,
) -> OracleDrive:
    """The best drive that is found by changing one choice after the other, in order of time.

    Each option of a decision is tried by a whole drive: the choices so far, the
    option, and then the policy until the end; the plans until the decision are
    repeated, not made again. The choice that led to the best drive
    stands, and the next decision is that of this drive. So the result is never worse
    than the policy. InputError if the scenario's map cannot be used.
    """
    trial = _Trial(scenario, expert, make, policy, seed)
    best = trial.driven((), ())
    tried: list[Tried] = []
    k = sum(scene.time_s < effort.after_s for scene, _ in best.script.asked)
    while k < len(best.script.asked) and best.value.score < effort.enough and trial.drives < effort.most_drives:
        if effort.worth(*best.script.asked[k], tried):
            found, best = trial.tried(best, k, effort.hold)
            tried.append(found)
        k += effort.every
    return OracleDrive(best.episode, best.value, best.script.made, tuple(tried), trial.drives)


@dataclass(frozen=True, slots=True, eq=False)
class _Driven:
    """One drive by script."""

    episode: Episode
    script: _Script
    value: Value


@dataclass(slots=True)
class _Trial:
    """Drives a scenario by scripts, over and over."""

    scenario: Scenario
    expert: EgoTrack
    make: MakePlanner
    policy: OracleChooser
    seed: int
    drives: int = 0

    def tried(self, best: _Driven, k: int, hold: int) -> tuple[Tried, _Driven]:
        """The k-th decision of the best drive, and the best drive once its options have been tried."""
        (scene, options), held = best.script.asked[k], best.script.taken[k]
        plans = () if best.episode.trace is None else best.episode.trace.plans[: best.script.frames[k]]
        before = tuple(best.script.taken[:k])
        values, better = {held: best.value}, best
        for option in options:
            if option == held:
                continue
            found = self.driven((*before, option), plans, hold)
            values[option] = found.value
            better = found if found.value.beats(better.value) else better
        tried = Tried(scene, options, tuple(values[option] for option in options), held, better.script.taken[k])
        return tried, better

    def driven(self, choices: tuple[Any, ...], plans: Sequence[Trajectory], hold: int = 1) -> _Driven:
        self.drives += 1
        script = _Script(choices, self.policy, hold)
        episode = drive(self.scenario, self.make(script, plans), seed=self.seed)
        if episode.trace is None or episode.fault is not None:
            frames = 0 if episode.trace is None else len(episode.trace)
            return _Driven(episode, script, Value(-1.0, 0, frames * DT_S / self.scenario.duration_s))
        roads = load_roads(self.scenario.map, self.scenario.maps_beside)
        return _Driven(episode, script, Value.of(score(episode.trace, roads, self.expert, self.scenario)))
