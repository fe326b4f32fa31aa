"""The score of a drive: one table of gates and weights per profile, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import prod
from typing import Any, Final

from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.metrics.comfort import comfort
from interplan_sumo.metrics.diagnostics import diagnostics
from interplan_sumo.metrics.drivable_area import drivable_area
from interplan_sumo.metrics.driving_direction import driving_direction
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.lane_changes import lane_changes
from interplan_sumo.metrics.lane_crossings import lane_crossings
from interplan_sumo.metrics.no_collision import no_collision, nuplan_no_collision
from interplan_sumo.metrics.obstacle_passed import obstacle_passed
from interplan_sumo.metrics.progress import making_progress, nuplan_making_progress, nuplan_progress, progress
from interplan_sumo.metrics.published import published_lane_changes, published_obstacle_passed
from interplan_sumo.metrics.result import MetricResult, plain
from interplan_sumo.metrics.speed_limit import speed_limit
from interplan_sumo.metrics.time_to_collision import time_to_collision
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import EgoTrack, Trace

SCORING_VERSION: Final = 1
"""Goes up with any change that can change a score."""

Metric = Callable[[Facts], MetricResult]
Condition = Callable[[Facts], bool]


def always(facts: Facts) -> bool:  # noqa: ARG001
    """Judged in every drive."""
    return True


def with_obstacles(facts: Facts) -> bool:
    """Judged where something must be passed."""
    return bool(facts.obstacle_corners)


def blocked_lane(facts: Facts) -> bool:
    """The families for which the published code turns the driving-direction gate into a weighted term."""
    return facts.staged.family in ("construction", "accident", "nudge", "overtake")


def free_lane(facts: Facts) -> bool:
    """The other families."""
    return not blocked_lane(facts)


@dataclass(frozen=True, slots=True)
class Gate:
    """A factor of the score."""

    name: str
    metric: Metric
    judged: Condition = always


@dataclass(frozen=True, slots=True)
class Weighted:
    """A term of the weighted mean."""

    name: str
    metric: Metric
    weight: float
    judged: Condition = always


@dataclass(frozen=True, slots=True)
class Profile:
    """Which terms make the score."""

    terms: tuple[Gate | Weighted, ...]
    needs_scenario: bool
    honours_exemptions: bool
    """Whether gates that `Scenario.exempt` names are left out."""


PROFILES: Final[Mapping[str, Profile]] = {
    "interplan-paper": Profile(
        (
            Gate("no_collision", no_collision),
            Gate("drivable_area", drivable_area),
            Gate("making_progress", making_progress),
            Gate("driving_direction", driving_direction),
            Gate("obstacle_passed", obstacle_passed, with_obstacles),
            Weighted("progress", progress, weight=5.0),
            Weighted("time_to_collision", time_to_collision, weight=5.0),
            Weighted("lane_changes", lane_changes, weight=4.0),
            Weighted("speed_limit", speed_limit, weight=4.0),
            Weighted("comfort", comfort, weight=2.0),
        ),
        needs_scenario=True,
        honours_exemptions=True,
    ),
    "interplan-code": Profile(
        (
            Gate("no_collision", nuplan_no_collision),
            Gate("drivable_area", drivable_area),
            Gate("making_progress", nuplan_making_progress),
            Gate("driving_direction", driving_direction, free_lane),
            Gate("obstacle_passed", published_obstacle_passed, with_obstacles),
            Weighted("progress", nuplan_progress, weight=5.0),
            Weighted("time_to_collision", time_to_collision, weight=5.0),
            Weighted("lane_changes", published_lane_changes, weight=4.0),
            Weighted("speed_limit", speed_limit, weight=4.0),
            Weighted("comfort", comfort, weight=2.0),
            Weighted("driving_direction", driving_direction, weight=1.0, judged=blocked_lane),
        ),
        needs_scenario=True,
        honours_exemptions=False,
    ),
    "nuplan": Profile(
        (
            Gate("no_collision", nuplan_no_collision),
            Gate("drivable_area", drivable_area),
            Gate("making_progress", nuplan_making_progress),
            Gate("driving_direction", driving_direction),
            Weighted("progress", nuplan_progress, weight=5.0),
            Weighted("time_to_collision", time_to_collision, weight=5.0),
            Weighted("speed_limit", speed_limit, weight=4.0),
            Weighted("comfort", comfort, weight=2.0),
        ),
        needs_scenario=False,
        honours_exemptions=False,
    ),
}
"""Thresholds are in the metrics' modules. Weights of interPlan: 5, 5, 4, 4, 2; of nuPlan: 5, 5, 4, 2."""

INFORMATIVE: Final[Mapping[str, Metric]] = {"lane_crossings": lane_crossings, "diagnostics": diagnostics}
"""Reported beside the score, never in it."""

DEFAULT_PROFILE: Final = "interplan-paper"


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

    def as_json(self) -> dict[str, Any]:
        """Plain data for results.jsonl: finite numbers, or None for those that are not."""
        return {
            "score": plain(self.score),
            "profile": self.profile,
            "version": self.version,
            "gates": list(self.gates),
            "weights": dict(self.weights),
            "metrics": {name: result.as_json() for name, result in self.metrics.items()},
        }


def score(
    trace: Trace,
    roads: Roads,
    expert: EgoTrack,
    scenario: Scenario | None = None,
    profile: str = DEFAULT_PROFILE,
) -> ScoreSheet:
    """The score of a trace, however short.

    UnknownNameError for a profile that does not exist, InputError if it needs
    the scenario and there is none. A trace that a planner's fault cut short is
    scored like any other: that such a job counts 0 is decided where faults are known.
    """
    return score_facts(Facts(trace, roads, expert, scenario), profile)


def score_facts(facts: Facts, profile: str = DEFAULT_PROFILE) -> ScoreSheet:
    """`score` of facts at hand."""
    if profile not in PROFILES:
        raise UnknownNameError("scoring profile", profile, PROFILES)
    table = PROFILES[profile]
    if table.needs_scenario and facts.scenario is None:
        raise InputError(f"profile {profile} needs the scenario of the trace; give it, or use profile nuplan")
    exempt = facts.staged.exempt if table.honours_exemptions else ()
    metrics: dict[str, MetricResult] = {}
    gates: list[str] = []
    weights: dict[str, float] = {}
    for term in table.terms:
        if not term.judged(facts):
            continue
        metrics[term.name] = term.metric(facts)
        if metrics[term.name].score is None or term.name in exempt:
            continue
        if isinstance(term, Gate):
            gates.append(term.name)
        else:
            weights[term.name] = term.weight
    value = weighted_score({n: metrics[n].score or 0.0 for n in (*gates, *weights)}, gates, weights)
    metrics |= {name: metric(facts) for name, metric in INFORMATIVE.items()}
    return ScoreSheet(value, profile, SCORING_VERSION, metrics, tuple(gates), weights)


def weighted_score(scores: Mapping[str, float], gates: list[str], weights: Mapping[str, float]) -> float:
    """Product of the gates times the weighted mean of the rest; 0 where nothing has a weight."""
    total = sum(weights.values())
    mean = sum(weight * scores[name] for name, weight in weights.items()) / total if total else 0.0
    return prod(scores[name] for name in gates) * mean
