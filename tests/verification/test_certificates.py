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
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.verification.certificates import certify, check_certificate, passing_drive, shortcomings


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
    [
        "overtake/5",  # the ego has to count on an oncoming driver to let it pass
        *(pytest.param(id, marks=pytest.mark.slow) for id in ("accident/9", "jaywalker/5", "lane_change_ltd/6")),
    ],
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


def wall(scenario: Scenario) -> tuple[Obstacle, ...]:
    """Trucks side by side where the first obstacle is."""
    place = scenario.obstacles[0].place
    return tuple(Obstacle(replace(place, left_m=left_m), "truck") for left_m in (-4.0, 0.0, 4.0, 8.0))


def test_a_scenario_that_cannot_be_solved_has_no_certificate_but_a_reason() -> None:
    verdict = passing_drive(replace(nudge(), obstacles=wall(nudge()), duration_s=10.0), most_simulations=2)
    assert verdict.certificate is None
    assert "obstacle" in "; ".join(verdict.problems)


def test_a_scenario_that_is_not_sound_at_its_start_gets_no_certificate_and_keeps_none(proof: Certificate) -> None:
    fast = replace(nudge(), start_speed_mps=40.0)
    verdict = certify(fast)
    assert verdict.certificate is None
    assert any("above the limit" in problem for problem in verdict.problems)
    same_name = replace(proof, summary=replace(proof.summary, scenario_hash=fast.hash()))
    assert any("above the limit" in problem for problem in check_certificate(fast, same_name))


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


def test_a_drive_that_was_tampered_with_is_refused(proof: Certificate) -> None:
    x_m = proof.track.x_m.copy()
    x_m[50:] += 0.5
    assert "does not follow" in check_certificate(nudge(), changed(proof, x_m=x_m))[0]
    shorter = {name: getattr(proof.track, name)[:-30] for name in proof.track.__dataclass_fields__}
    assert "replay gives" in check_certificate(nudge(), changed(proof, **shorter))[0]


def test_a_summary_that_was_tampered_with_is_refused(proof: Certificate) -> None:
    """Each number that does not belong to the drive is named; a hash of another scenario is enough."""
    other = {"trace_hash": "0" * 64, "score": proof.summary.score - 0.01, "reference_distance_m": 1.0}
    found = check_certificate(nudge(), replace(proof, summary=replace(proof.summary, **other)))
    assert len(found) == len(other)
    assert all(name in said for name, said in zip(other, found, strict=True))
    assert "another scenario" in check_certificate(replace(nudge(), start_speed_mps=5.0), proof)[0]


# --- what is asked of a drive ------------------------------------------------------------------


def judged(score: float = 1.0, family: str = "nudge", **changes: Any) -> list[str]:
    """The shortcomings of a drive that is faultless but for the changes."""
    scenario: Scenario = replace(nudge(), family=family)
    summary = replace(Summary(nudge().id, nudge().hash(), score, 150.0, 150.0, True, "0" * 64), **changes)
    return shortcomings(scenario, sheet(score), summary)


def sheet(score: float, **broken: float) -> ScoreSheet:
    gates = ("no_collision", "drivable_area", "making_progress", "driving_direction", "obstacle_passed")
    weights = ("progress", "time_to_collision", "lane_changes", "speed_limit", "comfort")
    metrics = {name: MetricResult(broken.get(name, 1.0), {"contacts": []}) for name in (*gates, *weights)}
    return ScoreSheet(score, "interplan-paper", 1, metrics, gates, dict.fromkeys(weights, 1.0))


@pytest.mark.parametrize(("family", "bar"), [("nudge", 0.9), ("lane_change_mtd", 0.9), ("lane_change_htd", 0.8)])
def test_the_bar_is_0_9_and_0_8_in_dense_lane_changes(family: str, bar: float) -> None:
    assert judged(bar, family) == []
    assert judged(bar - 1e-6, family) != []


@pytest.mark.parametrize(("distance_m", "passes"), [(105.0, True), (104.9, False)])
def test_seven_tenths_of_the_reference_distance_are_asked_for_short_of_the_goal(
    distance_m: float, passes: bool
) -> None:
    assert (judged(distance_m=distance_m, reached_goal=False) == []) == passes
    assert judged(distance_m=distance_m, reached_goal=True) == []


@pytest.mark.parametrize(
    "name", ["no_collision", "drivable_area", "making_progress", "obstacle_passed", "time_to_collision", "lane_changes"]
)
def test_every_gate_time_to_collision_and_the_goal_lane_are_asked_for(name: str) -> None:
    summary = Summary(nudge().id, nudge().hash(), 0.95, 150.0, 150.0, True, "0" * 64)
    (problem,) = shortcomings(nudge(), sheet(0.95, **{name: 0.5}), summary)
    assert name in problem


def test_nobody_may_touch_the_ego() -> None:
    touched = sheet(1.0)
    contact = {"track": "a1", "time_s": 3.0}
    touched.metrics["no_collision"].detail["contacts"] = [contact]  # type: ignore[index]
    (problem,) = shortcomings(nudge(), touched, Summary(nudge().id, nudge().hash(), 1.0, 150.0, 150.0, True, "0" * 64))
    assert problem == "touched by a1 at 3.0 s"
