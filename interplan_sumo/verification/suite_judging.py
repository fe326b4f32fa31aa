"""Judging a candidate of a suite: sound, in traffic, certified, not trivial, and solved by somebody."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import msgspec

from interplan_sumo.errors import ScenarioError, TrafficError
from interplan_sumo.families import find_family
from interplan_sumo.families.lane_change import dead_end
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.certificates import CertificateRecord
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.verification.certificates import passing_drive
from interplan_sumo.verification.ordinary_types import shows_its_type
from interplan_sumo.verification.replay import reference_drive, replay
from interplan_sumo.verification.solvers import PANEL, solvers
from interplan_sumo.verification.start_checks import start_problems
from interplan_sumo.verification.suite_candidates import Candidate
from interplan_sumo.verification.suite_slots import Slot
from interplan_sumo.verification.surrounding_traffic import (
    SurroundingTraffic,
    surrounding_traffic,
    traffic_shortcomings,
)
from interplan_sumo.world.lane_changes import lane_changes_needed
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import EgoTrack

MOST_SIMULATIONS: Final = 8
"""Another place is quicker found than a passing drive that does not turn up in so many tries."""
ASKED: Final = (*PANEL, "idm_mobil?published=true")
"""Who may solve a scene of a suite."""
ASKED_NEXT: Final = (
    "foresight?horizon_s=6.0",
    "foresight?change_time_s=3.0",
    "foresight?replan_s=0.4",
    "idm_mobil?change_time_s=3.0",
    "pdm_closed?min_gap_m=2.0",
)
"""Who may if none of them does: the same planners with other options. Where only those are taken that the best planner
solves as it stands, its score on the suite says how they were chosen, not how well it drives."""
TRIVIAL: Final = "straight_ahead"
"""What a planner that looks at nothing solves asks nothing."""


class Verdict(msgspec.Struct, frozen=True):
    """What was found of a candidate."""

    stage: str
    """At which check it failed: start, traffic, certificate, type, trivial, open, or a fault; '' if it is taken."""
    reason: str = ""
    scenario: str = ""
    """Which of its scenes failed."""
    certificates: tuple[CertificateRecord, ...] = ()
    """Of each of its scenes, in order."""
    traffic: tuple[SurroundingTraffic, ...] = ()
    """Whom the reference driver meets in each."""

    @property
    def taken(self) -> bool:
        """Whether it becomes part of the suite."""
        return not self.stage


def judged(candidate: Candidate) -> Verdict:
    """Check a candidate: all starts, then its scenes, the densest first, up to the first that fails. Deterministic."""
    passed: list[tuple[CertificateRecord, SurroundingTraffic]] = []
    try:
        for scenario in candidate.scenarios:
            if problems := _start_problems(scenario):
                return Verdict("start", problems[0], scenario.id)
        for scenario in reversed(candidate.scenarios):
            found = _proved(scenario, candidate.slot)
            if isinstance(found, Verdict):
                return found
            passed.insert(0, found)
    except (ScenarioError, TrafficError) as error:
        return Verdict("fault", str(error), candidate.scenarios[0].id)
    return Verdict("", certificates=tuple(each for each, _ in passed), traffic=tuple(each for _, each in passed))


def _proved(scenario: Scenario, slot: Slot) -> tuple[CertificateRecord, SurroundingTraffic] | Verdict:
    """The certificate of a scene that is sound at its start, and whom one meets in it; or why it does not do."""
    reference = reference_drive(scenario)
    if lacking := traffic_shortcomings(scenario, load_roads(scenario.map, scenario.maps_beside), reference):
        return Verdict("traffic", lacking[0], scenario.id)
    proof = passing_drive(scenario, MOST_SIMULATIONS, reference)
    if proof.certificate is None:
        return Verdict("certificate", "; ".join(proof.problems), scenario.id)
    track = proof.certificate.track
    shown = (reference, replay(scenario, track)) if slot.is_ordinary else ()  # who knows the lights need not stop
    if slot.is_ordinary and not any(shows_its_type(scenario, trace) for trace in shown):
        return Verdict("type", f"neither driver shows anything of {scenario.family}", scenario.id)
    if not slot.is_ordinary and solvers(scenario, track, (TRIVIAL,)):
        return Verdict("trivial", f"{TRIVIAL} solves it", scenario.id)
    solved_by = solvers(scenario, track, ASKED) or _first_solver(scenario, track)
    if not solved_by and not slot.may_be_open:
        return Verdict("open", f"none of {', '.join((*ASKED, *ASKED_NEXT))} solves it", scenario.id)
    summary = replace(proof.certificate.summary, solved_by=solved_by)
    return replace(proof.certificate, summary=summary).record(), surrounding_traffic(reference)


def _first_solver(scenario: Scenario, track: EgoTrack) -> tuple[str, ...]:
    """The first of those asked next who solves it."""
    tried = (solvers(scenario, track, (name,)) for name in ASKED_NEXT)
    return next((found for found in tried if found), ())


def _start_problems(scenario: Scenario) -> list[str]:
    """What is wrong before anybody drives, the quick checks first."""
    roads = load_roads(scenario.map, scenario.maps_beside)
    return (
        avoidable_change(scenario, roads)
        or start_problems(scenario, roads, with_traffic=False)
        or start_problems(scenario, roads)
    )


def avoidable_change(scenario: Scenario, roads: Roads) -> list[str]:
    """Whether who keeps its lane can go on along the route, though the family asks for a lane change."""
    if not find_family(scenario.family).changes_lanes:
        return []
    need = lane_changes_needed(roads, scenario.route, scenario.goal.lane)
    if dead_end(roads, need, scenario.start.lane, roads[scenario.goal.lane].roadblock_id) is not None:
        return []
    return [f"route: it goes on for who keeps to lane {scenario.start.lane}, expected its end before the goal"]
