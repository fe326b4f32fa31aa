"""Certificates: finding a drive that proves a scenario solvable, and checking one that was found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from interplan_sumo.families import names
from interplan_sumo.maps.store import load_roads
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.score import ScoreSheet, score_facts
from interplan_sumo.scenario.certificates import Certificate, Summary
from interplan_sumo.scenario.route import goal_arc_m, route_centerline
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.simulation.setup import start_state
from interplan_sumo.verification.certificate_search import attempts
from interplan_sumo.verification.clearances import NearestApproach, nearest_approach
from interplan_sumo.verification.privileged_rollout import rounded
from interplan_sumo.verification.reachability import unreachable
from interplan_sumo.verification.replay import reference_drive, replay, route_distance_m
from interplan_sumo.verification.solvers import solvers
from interplan_sumo.verification.start_checks import validate
from interplan_sumo.world.trace import EgoTrack, Trace

FLAWLESS = ("time_to_collision", "courtesy")
"""No gates, but no certificate loses a point in them: it comes near nobody, and forces nobody to brake hard."""
CLEARANCE_M, PEDESTRIAN_CLEARANCE_M = 0.3, 0.5
"""Room kept to everything, and to people on foot."""
LEAST_SCORE = 0.95
LEAST_SHARE = 0.7
"""A drive that does not reach the goal line gets at least this share of the reference distance."""
GOOD_ENOUGH = 0.98
"""From this score on nothing better is looked for."""
MORE_SIMULATIONS = 6
"""How long something better is looked for once a drive passes."""
MOST_SIMULATIONS = 40
DECIMALS = 6


@dataclass(frozen=True, slots=True, eq=False)
class Proof:
    """How one scenario fared."""

    scenario: Scenario
    certificate: Certificate | None
    """What was found, or was checked and holds."""
    problems: tuple[str, ...]
    """Why there is none, of a search the shortcomings of the best try; empty if there is one."""
    simulations: int
    wall_s: float = 0.0


def certify(
    scenario: Scenario, *, panel: Sequence[str] | None = None, most_simulations: int = MOST_SIMULATIONS
) -> Proof:
    """Look for a drive that passes every test under the official traffic, if the start is sound. Deterministic.

    With a panel of planners the certificate says which of them solve the scenario.
    InputError if the scenario cannot be staged, TrafficError if SUMO fails.
    """
    unsound = validate(scenario)
    if unsound:
        return Proof(scenario, None, tuple(unsound), 0)
    proof = passing_drive(scenario, most_simulations)
    best = proof.certificate
    if best is None or panel is None:
        return proof
    summary = replace(best.summary, solved_by=solvers(scenario, best.track, panel))
    return replace(proof, certificate=replace(best, summary=summary))


def passing_drive(
    scenario: Scenario, most_simulations: int, reference: Trace | None = None, known: Sequence[EgoTrack] = ()
) -> Proof:
    """The best drive of a search, whether or not the start is sound; `reference` is that drive, if it is known.

    The search begins with drives that are `known`, those of planners for instance.
    """
    reference = reference or reference_drive(scenario)
    best: Certificate | None = None
    best_faults: list[str] = []
    simulations = 1  # the reference
    passed_after = most_simulations
    for track, trace in _tries(scenario, reference, known):
        simulations += 1
        sheet, summary, nearest = _judged(scenario, trace, reference)
        faults = shortcomings(scenario, sheet, summary, nearest)
        if not faults and (best is None or summary.score > best.summary.score):
            best = Certificate(summary, track)
            passed_after = min(passed_after, simulations)
        elif faults and (not best_faults or len(faults) < len(best_faults)):
            best_faults = faults
        enough = best is not None and best.summary.score >= GOOD_ENOUGH
        if enough or simulations >= most_simulations or simulations >= passed_after + MORE_SIMULATIONS:
            break
    if best is not None:
        return Proof(scenario, best, (), simulations)
    return Proof(scenario, None, tuple(best_faults) or ("no drive was found that avoids everybody",), simulations)


def _tries(scenario: Scenario, reference: Trace, known: Sequence[EgoTrack]) -> Iterator[tuple[EgoTrack, Trace]]:
    for track in known:
        kept = EgoTrack.of([rounded(track.state(frame)) for frame in range(len(track))])
        yield kept, replay(scenario, kept)
    for attempt in attempts(scenario, reference):
        yield attempt.track, attempt.trace


def check_certificate(scenario: Scenario, certificate: Certificate | None) -> list[str]:
    """What is wrong with a certificate, one sentence each; nothing if it holds.

    The scenario must be sound at its start. The drive must begin where the scenario does, every state must follow from
    the one before by the bicycle model, and its replay through the official
    traffic must give the stored trace hash, distance and score, and pass.
    TrafficError if SUMO fails.
    """
    if certificate is None:
        return ["no certificate is stored"]
    stored = certificate.summary
    if (stored.scenario_id, stored.scenario_hash) != (scenario.id, scenario.hash()):
        return [f"it is for another scenario: {stored.scenario_id} with hash {stored.scenario_hash[:12]}"]
    start = start_state(scenario, load_roads(scenario.map, scenario.maps_beside))
    wrong = validate(scenario) or unreachable(start, certificate.track, scenario.duration_s)
    if wrong:
        return wrong
    trace = replay(scenario, certificate.track)
    sheet, found, nearest = _judged(scenario, trace, reference_drive(scenario))
    wrong = [
        f"its replay gives {name} {getattr(found, name)}, stored is {getattr(stored, name)}"
        for name in ("trace_hash", "score", "reference_distance_m", "distance_m", "reached_goal")
        if getattr(found, name) != getattr(stored, name)
    ]
    return wrong + shortcomings(scenario, sheet, found, nearest)


def shortcomings(scenario: Scenario, sheet: ScoreSheet, summary: Summary, nearest: NearestApproach) -> list[str]:
    """Why a drive is no certificate, one sentence each; nothing if it is one."""
    judged = {name: sheet.metrics[name].score for name in (*sheet.gates, *FLAWLESS)}
    reasons = sheet.reasons()
    faults = [f"{name}: {reasons.get(name, 'not fulfilled')}" for name, got in judged.items() if got not in (None, 1.0)]
    for found, least_m in ((nearest.others, CLEARANCE_M), (nearest.pedestrians, PEDESTRIAN_CLEARANCE_M)):
        if found.distance_m < least_m:
            faults.append(
                f"comes within {found.distance_m:.2f} m of {found.track} at {found.time_s:.1f} s, not {least_m:g} m"
            )
    if not summary.reached_goal and scenario.family in names(ordinary=False):
        faults.append(f"stays short of the goal line: {summary.distance_m:.1f} m in the time")
    least_m = LEAST_SHARE * summary.reference_distance_m
    if not summary.reached_goal and summary.distance_m < least_m:
        faults.append(f"advanced {summary.distance_m:.1f} m in the time, expected {least_m:.1f} m or the goal line")
    if summary.score < LEAST_SCORE:
        lost = "; ".join(f"{name}: {why}" for name, why in reasons.items()) or "nothing lost points"
        faults.append(f"score {summary.score:.3f}, expected {LEAST_SCORE:g} ({lost})")
    return faults


def _judged(scenario: Scenario, trace: Trace, reference: Trace) -> tuple[ScoreSheet, Summary, NearestApproach]:
    """The drive scored against itself: it is what others are measured by."""
    roads = load_roads(scenario.map, scenario.maps_beside)
    facts = Facts(trace, roads, trace.ego, scenario)
    sheet = score_facts(facts)
    line, goal_m = route_centerline(roads, scenario), goal_arc_m(roads, scenario)
    last = trace.ego.state(len(trace) - 1)
    summary = Summary(
        scenario_id=scenario.id,
        scenario_hash=scenario.hash(),
        score=round(sheet.score, DECIMALS),
        reference_distance_m=round(route_distance_m(roads, scenario, reference.ego), DECIMALS),
        distance_m=round(route_distance_m(roads, scenario, trace.ego), DECIMALS),
        reached_goal=line.project_point(last.x_m, last.y_m)[0] > goal_m,
        trace_hash=trace.hash(),
    )
    return sheet, summary, nearest_approach(facts)
