"""The score of a drive: the gates and weights of a profile, and what comes of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import prod
from typing import Final

from interplan_sumo.errors import InputError
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import METRICS, MetricResult, informative_metrics
from interplan_sumo.metrics.profile import CONDITIONS, DEFAULT_PROFILE, Profile, Role, find_profile
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import EgoTrack, Trace

SCORING_VERSION: Final = 3
"""Goes up with any change that can change a score."""


@dataclass(frozen=True, eq=False)
class ScoreSheet:
    """The score of one drive with everything behind it."""

    score: float
    profile: str
    version: int
    metrics: Mapping[str, MetricResult]
    """Every metric of the profile that applies, judged or not, and the informative ones."""
    gates: tuple[str, ...]
    """Metrics that multiply the score."""
    weights: Mapping[str, float]
    """Metrics in the weighted mean."""
    roles: Mapping[str, Role] = field(default_factory=dict[str, "Role"])
    """What the loss of a gate means, of those where it means something."""
    beside: Mapping[str, float] = field(default_factory=dict[str, float])
    """The scores by other profiles that are told beside this one."""

    @property
    def unsafe(self) -> bool | None:
        """Whether a gate of safety took points; None where the profile has none."""
        return self._lost("safety")

    @property
    def done(self) -> bool | None:
        """Whether the task was done; None where no gate says so."""
        undone = self._lost("task")
        return None if undone is None else not undone

    def _lost(self, role: Role) -> bool | None:
        scores = [self.metrics[name].score for name, its in self.roles.items() if its == role]
        return any(score != 1.0 for score in scores) if scores else None

    def reasons(self) -> dict[str, str]:
        """One sentence for each judged metric that lost points."""
        judged = (*self.gates, *self.weights)
        return {n: r for n in judged if (r := self.metrics[n].reason) is not None}


def score(
    trace: Trace,
    roads: Roads,
    expert: EgoTrack,
    scenario: Scenario | None = None,
    profile: str | Profile = DEFAULT_PROFILE,
) -> ScoreSheet:
    """The score of a trace, however short.

    Errors as from `find_profile`; InputError if the profile needs the scenario
    and there is none. A trace that a planner's fault cut short is scored like
    any other: that such a job counts 0 is decided where faults are known.
    """
    return score_facts(Facts(trace, roads, expert, scenario), profile)


def score_facts(facts: Facts, profile: str | Profile = DEFAULT_PROFILE) -> ScoreSheet:
    """`score` of facts at hand."""
    profile = find_profile(profile)
    judged = _judged(facts, profile)
    metrics, others = dict(judged.metrics), {name: _judged(facts, find_profile(name)) for name in profile.beside}
    for other in others.values():
        metrics = {**other.metrics, **metrics}
    metrics |= {name: METRICS[name](facts) for name in informative_metrics()}
    in_force = [term for term in profile.gates if term.name in judged.gates]
    roles: dict[str, Role] = {term.name: term.role for term in in_force if term.role is not None}
    return ScoreSheet(
        judged.score, profile.name, SCORING_VERSION, metrics, judged.gates, judged.weights, roles,
        {name: other.score for name, other in others.items()},
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Judged:
    """What one profile makes of a drive."""

    score: float
    metrics: Mapping[str, MetricResult]
    gates: tuple[str, ...]
    weights: Mapping[str, float]


def _judged(facts: Facts, profile: Profile) -> _Judged:
    if profile.needs_scenario and facts.scenario is None:
        raise InputError(f"profile {profile.name} needs the scenario of the trace; give it, or use profile nuplan")
    exempt = facts.staged.exempt if profile.honours_exemptions else ()
    metrics: dict[str, MetricResult] = {}
    gates: list[str] = []
    weights: dict[str, float] = {}
    for term in profile.terms:
        if not CONDITIONS[term.when](facts):
            continue
        result = metrics[term.name] = METRICS[term.metric](facts)
        if result.score is None or term.name in exempt:
            continue
        if not 0.0 <= result.score <= 1.0:
            raise InputError(f"metric {term.metric} gave the score {result.score}, expected 0 to 1, or None")
        if term.weight is None:
            gates.append(term.name)
        else:
            weights[term.name] = term.weight
    score = weighted_score({n: metrics[n].score or 0.0 for n in (*gates, *weights)}, gates, weights)
    return _Judged(score, metrics, tuple(gates), weights)


def weighted_score(scores: Mapping[str, float], gates: Sequence[str], weights: Mapping[str, float]) -> float:
    """Product of the gates times the weighted mean of the rest; 0 where nothing has a weight."""
    total = sum(weights.values())
    mean = sum(weight * scores[name] for name, weight in weights.items()) / total if total else 0.0
    return prod(scores[name] for name in gates) * mean


def points_lost(scores: Mapping[str, float], gates: Sequence[str], weights: Mapping[str, float]) -> dict[str, float]:
    """How many of the 100 points each metric cost; together what is missing.

    Gates at 0 share all points among them, for with any of them the rest is
    worth nothing. Else gates take their share one after the other, and what the
    weighted metrics miss counts as far as the gates leave it.
    """
    cost = dict.fromkeys((*gates, *weights), 0.0)
    shut = [name for name in gates if scores[name] == 0.0]
    if shut:
        return cost | dict.fromkeys(shut, 100.0 / len(shut))
    left = 100.0
    for name in gates:
        cost[name] = left * (1.0 - scores[name])
        left *= scores[name]
    total = sum(weights.values())
    for name, weight in weights.items():
        cost[name] = left * weight / total * (1.0 - scores[name])
    return cost
