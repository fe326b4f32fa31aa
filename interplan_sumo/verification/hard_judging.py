"""Hard judging: is a scene sound and certified, does a panel of planners fail in it, and does somebody solve it?

Planners drive before a certificate is looked for: all of a panel take as long as a search that finds one at once, and
a search that finds none three times as long. What is easy for most of the panel is told by the first who solve it, and
those for whom a scene must be hard drive first. The drive of somebody who solves it is the first to be tried as a
certificate.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import msgspec
from msgspec.structs import replace as replaced

from interplan_sumo.errors import ScenarioError, TrafficError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.score import score
from interplan_sumo.planner import load_planner
from interplan_sumo.scenario.certificates import CertificateRecord
from interplan_sumo.scenario.nominal_drive import nominal_drive
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.episode import drive
from interplan_sumo.verification.certificates import passing_drive
from interplan_sumo.verification.light_windows import light_problems
from interplan_sumo.verification.replay import reference_drive
from interplan_sumo.verification.solvers import SOLVED_SCORE, solvers, solving_drive
from interplan_sumo.verification.start_checks import start_problems
from interplan_sumo.verification.suite_judging import MOST_SIMULATIONS, TRIVIAL, avoidable_change
from interplan_sumo.verification.surrounding_traffic import traffic_shortcomings
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import EgoTrack, Trace

OTHERS: Final = ("foresight", "foresight?horizon_s=6.0", "foresight?change_time_s=3.0")
"""Who is asked where nobody of the panel solves a scene. Of all that suites ask, the last two solved 18 of the 24 such
scenes that any of seven solved (with foresight in the panel), for a third of the time; nobody solved 236 others."""


@dataclass(frozen=True, slots=True)
class HardCandidate:
    """A scene, and what is asked of it."""

    scenario: Scenario
    panel: tuple[str, ...]
    least_difficulty: float
    """The share of the panel that must fail."""
    must_fail: frozenset[str] = frozenset()
    """Those of the panel of whom each must fail, whatever the others do."""
    alone: frozenset[str] = frozenset()
    """Those of whom each may solve it only if nobody else of the panel does."""

    @property
    def most_solved(self) -> int:
        """So many of the panel may solve it."""
        return int(len(self.panel) * (1.0 - self.least_difficulty) + 1e-9)

    @property
    def order(self) -> tuple[str, ...]:
        """The panel as it drives: first those who must fail, then those who may solve it alone."""
        return tuple(sorted(self.panel, key=lambda name: (name not in self.must_fail, name not in self.alone)))

    def too_easy(self, solved_by: Collection[str]) -> str:
        """Why a scene that these solve is too easy; '' if it is not."""
        if spent := [name for name in solved_by if name in self.must_fail]:
            return f"{spent[0]} solves it, and enough others"
        if len(solved_by) > 1 and (shared := [name for name in solved_by if name in self.alone]):
            return f"{shared[0]} solves it, and not alone"
        return f"{len(solved_by)} of the panel solve it" if len(solved_by) > self.most_solved else ""


class HardVerdict(msgspec.Struct, frozen=True):
    """What was found of a scene."""

    stage: str
    """At which check it failed: start, traffic, easy, open, certificate, trivial, in this order, or `fault` for one of
    the simulator; '' if it is hard and sound."""
    reason: str = ""
    scores: dict[str, float] = {}
    """Of those of the panel who drove, in their order; against the certificate once there is one."""
    certificate: CertificateRecord | None = None
    cpu_s: float = 0.0

    @property
    def solved_by(self) -> tuple[str, ...]:
        """Who of the panel solves it."""
        return tuple(name for name, got in self.scores.items() if got >= SOLVED_SCORE)

    @property
    def difficulty(self) -> float:
        """The share of the panel that fails."""
        return 1.0 - len(self.solved_by) / len(self.scores) if self.scores else 0.0

    @property
    def mean_score(self) -> float:
        """Of those of the panel who drove."""
        return sum(self.scores.values()) / len(self.scores) if self.scores else 1.0


def judged_hard(candidate: HardCandidate) -> HardVerdict:
    """Check a scene, the cheapest checks first. Deterministic but for the time it takes."""
    begun_s = time.process_time()
    try:
        found = _judged(candidate)
    except (ScenarioError, TrafficError) as error:
        found = HardVerdict("fault", str(error))
    return replaced(found, cpu_s=time.process_time() - begun_s)


def quick_problems(scenario: Scenario, roads: Roads) -> list[str]:
    """What is wrong with the geometry of a scene: takes milliseconds and opens no simulator."""
    return avoidable_change(scenario, roads) or start_problems(scenario, roads, with_traffic=False)


def _judged(candidate: HardCandidate) -> HardVerdict:
    scenario = candidate.scenario
    roads = load_roads(scenario.map, scenario.maps_beside)
    if problems := start_problems(scenario, roads) or light_problems(scenario, roads):
        return HardVerdict("start", problems[0])
    reference = reference_drive(scenario)
    if lacking := traffic_shortcomings(scenario, roads, reference):
        return HardVerdict("traffic", lacking[0])
    fastest = nominal_drive(roads, scenario)  # who solves it measured by this does so by any certificate
    driven: dict[str, Trace | None] = {}
    found = HardVerdict("easy")
    for name, trace in _drives(scenario, candidate.order):
        driven[name] = trace
        found = replaced(found, scores={**found.scores, name: _score(trace, roads, fastest, scenario)})
        if easy := candidate.too_easy(found.solved_by):
            return replaced(found, reason=easy)
    solving = {name: trace for name in found.solved_by if (trace := driven[name]) is not None}
    solving = solving or _another(scenario, fastest, candidate.panel)
    if not solving:
        return replaced(found, stage="open", reason="nobody who was asked solves it")
    proof = passing_drive(scenario, MOST_SIMULATIONS, reference, [trace.ego for trace in solving.values()])
    if proof.certificate is None:
        return replaced(found, stage="certificate", reason="; ".join(proof.problems))
    expert = proof.certificate.track
    found = HardVerdict(
        "easy", scores={name: _score(driven[name], roads, expert, scenario) for name in candidate.panel}
    )
    if easy := candidate.too_easy(found.solved_by):
        return replaced(found, reason=easy)
    if solvers(scenario, expert, (TRIVIAL,)):
        return replaced(found, stage="trivial", reason=f"{TRIVIAL} solves it")
    summary = replace(proof.certificate.summary, solved_by=found.solved_by or tuple(solving))
    return replaced(found, stage="", certificate=replace(proof.certificate, summary=summary).record())


def _drives(scenario: Scenario, panel: Sequence[str]) -> Iterator[tuple[str, Trace | None]]:
    """What each planner does; None if it faults."""
    for name in panel:
        episode = drive(scenario, load_planner(name))
        yield name, episode.trace if episode.fault is None else None


def _score(trace: Trace | None, roads: Roads, expert: EgoTrack, scenario: Scenario) -> float:
    return 0.0 if trace is None else round(score(trace, roads, expert, scenario).score, 6)


def _another(scenario: Scenario, expert: EgoTrack, panel: Sequence[str]) -> dict[str, Trace]:
    """The first who solves it of those who are asked next and the panel does not have, and how."""
    for name in OTHERS:
        if name not in panel and (trace := solving_drive(scenario, expert, name)) is not None:
            return {name: trace}
    return {}
