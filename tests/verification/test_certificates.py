"""Certificates: found for what can be solved, refused for what does not prove it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import pytest

from interplan_sumo.metrics.metric import MetricResult
from interplan_sumo.metrics.score import ScoreSheet
from interplan_sumo.scenario.certificates import Certificate, Summary
from interplan_sumo.scenario.scenario import LanePosition, Obstacle, Scenario
from interplan_sumo.scenario.suite import expert, find_scenario
from interplan_sumo.tiny_worlds import cars, pedestrians, straight_road, together
from interplan_sumo.verification.certificates import certify, check_certificate, passing_drive, shortcomings
from interplan_sumo.verification.clearances import Clearance, NearestApproach, nearest_approach
from interplan_sumo.verification.solvers import solving_drive
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.trace import EgoTrack
from tests.metrics.staging import drive_at, facts_of
from tests.quick import few


@cache
def nudge() -> Scenario:
    return find_scenario("nudge/2")


@pytest.fixture(scope="module")
def proof() -> Certificate:
    found = certify(nudge()).certificate
    assert found is not None
    return found


@pytest.mark.parametrize(
    "scenario_id",
    few(["overtake/1", "jaywalker/5", "accident/9", "lane_change_ltd/6"], 0),
)
def test_a_scenario_of_each_kind_is_certified_and_its_proof_holds(scenario_id: str) -> None:
    scenario = find_scenario(scenario_id)
    verdict = certify(scenario)
    assert verdict.problems == ()
    assert verdict.certificate is not None
    assert verdict.simulations <= 6
    summary = verdict.certificate.summary
    assert summary.score >= 0.95
    assert summary.reached_goal
    assert summary.scenario_hash == scenario.hash()
    assert check_certificate(scenario, verdict.certificate) == []


@pytest.mark.slow
def test_the_search_gives_the_same_drive_again(proof: Certificate) -> None:
    again = certify(nudge()).certificate
    assert again is not None
    assert again.record() == proof.record()


@pytest.mark.slow
def test_a_drive_that_begins_beside_the_middle_of_its_lane_is_found() -> None:
    scenario = find_scenario("lane_change_ltd/0")
    verdict = certify(replace(scenario, start=replace(scenario.start, left_m=0.45), start_speed_mps=6.0))
    assert verdict.certificate is not None, verdict.problems
    assert verdict.certificate.summary.score == pytest.approx(1.0, abs=0.02)


@pytest.mark.slow
def test_the_drive_of_a_planner_that_solves_it_is_a_certificate_and_a_bad_one_is_not() -> None:
    scenario = find_scenario("nudge/0")
    by_planner = solving_drive(scenario, expert(scenario), "idm_mobil")
    assert by_planner is not None
    taken = passing_drive(scenario, 2, known=[by_planner.ego])
    assert taken.certificate is not None
    assert taken.simulations == 2
    assert check_certificate(scenario, taken.certificate) == []
    short = EgoTrack.of([by_planner.ego.state(frame) for frame in range(30)])
    refused = passing_drive(scenario, 2, known=[short])
    assert refused.certificate is None
    assert any("stays short of the goal line" in problem for problem in refused.problems)


def wall(scenario: Scenario) -> tuple[Obstacle, ...]:
    """Trucks side by side where the first obstacle is."""
    place = scenario.obstacles[0].place
    return tuple(Obstacle(replace(place, left_m=left_m), "truck") for left_m in (-4.0, 0.0, 4.0, 8.0))


@pytest.mark.slow
def test_a_scenario_that_cannot_be_solved_has_no_certificate_but_a_reason() -> None:
    verdict = passing_drive(replace(nudge(), obstacles=wall(nudge()), duration_s=10.0), most_simulations=2)
    assert verdict.certificate is None
    assert "obstacle" in "; ".join(verdict.problems)


@pytest.mark.slow
def test_a_scenario_that_is_not_sound_at_its_start_gets_no_certificate_and_keeps_none(proof: Certificate) -> None:
    fast = replace(nudge(), start_speed_mps=40.0)
    verdict = certify(fast)
    assert verdict.certificate is None
    assert any("above the limit" in problem for problem in verdict.problems)
    same_name = replace(proof, summary=replace(proof.summary, scenario_hash=fast.hash()))
    assert any("above the limit" in problem for problem in check_certificate(fast, same_name))


@pytest.mark.slow
def test_where_no_drive_can_be_tried_at_all_there_is_a_reason_too() -> None:
    overtake = find_scenario("overtake/1")
    parked = overtake.obstacles[0].place
    assert overtake.traffic.oncoming != "none"
    late = replace(
        overtake, obstacles=wall(overtake), start=LanePosition(parked.lane, parked.arc_m - 9.0), start_speed_mps=13.0
    )
    verdict = passing_drive(late, most_simulations=3)
    assert verdict.certificate is None
    assert verdict.simulations == 1
    assert verdict.problems == ("no drive was found that avoids everybody",)


def changed(certificate: Certificate, **columns: Any) -> Certificate:
    return replace(certificate, track=replace(certificate.track, **columns))


@pytest.mark.slow
def test_a_drive_that_was_tampered_with_is_refused(proof: Certificate) -> None:
    x_m = proof.track.x_m.copy()
    x_m[50:] += 0.5
    assert "does not follow" in check_certificate(nudge(), changed(proof, x_m=x_m))[0]
    shorter = {name: getattr(proof.track, name)[:-30] for name in proof.track.__dataclass_fields__}
    assert "replay gives" in check_certificate(nudge(), changed(proof, **shorter))[0]


@pytest.mark.slow
def test_a_summary_that_was_tampered_with_is_refused(proof: Certificate) -> None:
    """Each number that does not belong to the drive is named; a hash of another scenario is enough."""
    other = {"trace_hash": "0" * 64, "score": proof.summary.score - 0.01, "reference_distance_m": 1.0}
    found = check_certificate(nudge(), replace(proof, summary=replace(proof.summary, **other)))
    assert len(found) == len(other)
    assert all(name in said for name, said in zip(other, found, strict=True))
    assert "another scenario" in check_certificate(replace(nudge(), start_speed_mps=5.0), proof)[0]


# --- what is asked of a drive ------------------------------------------------------------------


def judged(score: float = 1.0, family: str = "nudge", near: NearestApproach | None = None, **changes: Any) -> list[str]:
    """The shortcomings of a drive that is faultless but for the changes."""
    scenario: Scenario = replace(nudge(), family=family)
    summary = replace(Summary(nudge().id, nudge().hash(), score, 150.0, 150.0, True, "0" * 64), **changes)
    return shortcomings(scenario, sheet(score), summary, near or NearestApproach())


def sheet(score: float, **broken: float) -> ScoreSheet:
    safety = ("no_collision", "drivable_area", "red_lights", "forced_braking", "endangered_people", "speeding")
    gates = (*safety, "task_done")
    weights = ("progress", "time_to_collision", "courtesy", "speed_limit", "comfort")
    metrics = {name: MetricResult(broken.get(name, 1.0)) for name in (*gates, *weights)}
    return ScoreSheet(score, "interplan-strict", 1, metrics, gates, dict.fromkeys(weights, 1.0))


@pytest.mark.parametrize("family", ["nudge", "lane_change_htd", "starting_left_turn"])
def test_a_certificate_scores_0_95_in_every_family(family: str) -> None:
    assert judged(0.95, family) == []
    assert judged(0.95 - 1e-6, family) != []


@pytest.mark.parametrize(
    ("family", "distance_m", "passes"),
    [("nudge", 149.9, False), ("starting_left_turn", 105.0, True), ("starting_left_turn", 104.9, False)],
)
def test_who_does_not_reach_the_goal_line_proves_nothing_but_in_ordinary_scenes_if_it_gets_far_enough(
    family: str, distance_m: float, passes: bool
) -> None:
    assert (judged(family=family, distance_m=distance_m, reached_goal=False) == []) == passes
    assert judged(family=family, distance_m=distance_m, reached_goal=True) == []


@pytest.mark.parametrize(
    "name",
    [
        "no_collision", "drivable_area", "red_lights", "forced_braking", "endangered_people", "task_done",
        "time_to_collision", "courtesy",
    ],
)  # fmt: skip
def test_every_gate_time_to_collision_and_courtesy_are_asked_for(name: str) -> None:
    summary = Summary(nudge().id, nudge().hash(), 0.95, 150.0, 150.0, True, "0" * 64)
    (problem,) = shortcomings(nudge(), sheet(0.95, **{name: 0.5}), summary, NearestApproach())
    assert name in problem


@pytest.mark.parametrize(
    ("near", "problems"),
    [
        (NearestApproach(others=Clearance(0.3, "a1", 3.0), pedestrians=Clearance(0.5, "p1", 4.0)), []),
        (NearestApproach(others=Clearance(0.29, "a1", 3.0)), ["comes within 0.29 m of a1 at 3.0 s, not 0.3 m"]),
        (NearestApproach(pedestrians=Clearance(0.49, "p1", 4.0)), ["comes within 0.49 m of p1 at 4.0 s, not 0.5 m"]),
    ],
)
def test_room_is_kept_to_everything_and_more_to_people_on_foot(near: NearestApproach, problems: list[str]) -> None:
    assert judged(near=near) == problems


def test_the_nearest_approach_is_that_of_the_boxes() -> None:
    """The ego drives past a standing car with 0.4 m between them, and stops 2 m short of a pedestrian."""
    ped_m = 10.0 + PACIFICA.length_m / 2 + 2.0 + 0.35
    crossing = pedestrians((ped_m, 0.0))
    standing = cars((5.0, PACIFICA.width_m / 2 + 0.4 + 1.0), length_m=6.0, width_m=2.0)
    drive = drive_at([0.0, 5.0, 10.0], actors=[crossing, together(crossing, standing), crossing])
    found = nearest_approach(facts_of(drive, straight_road()))
    assert (found.others.track, found.others.time_s) == ("car00", 0.1)
    assert found.others.distance_m == pytest.approx(0.4)
    assert (found.pedestrians.track, found.pedestrians.time_s) == ("ped00", 0.2)
    assert found.pedestrians.distance_m == pytest.approx(2.0)
