"""The score of a drive: the gates and weights of a profile, and what comes of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from typing import Final

from interplan_sumo.errors import InputError
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import METRICS, MetricResult, informative_metrics
from interplan_sumo.metrics.profile import CONDITIONS, DEFAULT_PROFILE, Profile, find_profile
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import EgoTrack, Trace

SCORING_VERSION: Final = 1
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
    value = weighted_score({n: metrics[n].score or 0.0 for n in (*gates, *weights)}, gates, weights)
    metrics |= {name: METRICS[name](facts) for name in informative_metrics()}
    return ScoreSheet(value, profile.name, SCORING_VERSION, metrics, tuple(gates), weights)


def weighted_score(scores: Mapping[str, float], gates: list[str], weights: Mapping[str, float]) -> float:
    """Product of the gates times the weighted mean of the rest; 0 where nothing has a weight."""
    total = sum(weights.values())
    mean = sum(weight * scores[name] for name, weight in weights.items()) / total if total else 0.0
    return prod(scores[name] for name in gates) * mean
