"""Profile interplan-strict: what is unsafe, what is done, and what the rest is worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.forced_braking import (
    COURTEOUS_MPS2,
    EGO_BRAKES_MPS2,
    HARDEST_MPS2,
    LEAST_FORCED_MPS2,
    courtesy,
    forced_braking,
)
from interplan_sumo.metrics.no_collision import no_collision, strict_no_collision
from interplan_sumo.metrics.red_lights import HARDEST_STOP_MPS2, red_lights
from interplan_sumo.metrics.score import points_lost, score_facts
from interplan_sumo.metrics.speeding import slowing_limits_mps, speeding
from interplan_sumo.metrics.task import UNDONE, strict_making_progress, strict_progress, task_done
from interplan_sumo.scenario.scenario import LanePosition, Obstacle, Scenario
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Pose
from interplan_sumo.world.signals import Signals
from interplan_sumo.world.trace import ActorTable, EgoTrack, Trace
from tests.metrics.staging import drive_at, facts_of, lane_y_m, scenario_on
from tests.worlds import cars, drive, junction, signals, straight_road

ROAD = straight_road(lanes=2, length_m=600.0)
SCENE = scenario_on(ROAD, ("11", 20.0), ("11", 220.0))
AT_START = Pose(20.0, 0.0, 0.0)
CERTIFICATE = drive(*[10.0] * 202, start=AT_START).ego
"""200 m in 20 s: past the goal line."""


def judged(trace: Trace, scene: Scenario = SCENE, expert: EgoTrack = CERTIFICATE) -> Facts:
    return Facts(trace, ROAD, expert, scene)


# --- collisions ----------------------------------------------------------------------------------


def creeping(last_mps: float, other: list[Actors] | Actors) -> Facts:
    """An ego that rolls at 0.5 m/s up to x = 30 m, where its front bumper comes to 30.02 m, at a last speed."""
    x_m = np.array([30.0 - PACIFICA.length_m / 2 - 0.03, 30.0 - PACIFICA.length_m / 2 + 0.02])
    return judged(drive_at(x_m, speed_mps=[0.5, last_mps], actors=other))


def test_who_comes_to_rest_against_what_stood_there_is_at_fault():
    standing = cars((30.0 + 2.4, 0.0))
    assert no_collision(creeping(0.05, standing)).score == 1.0
    found = strict_no_collision(creeping(0.05, standing))
    assert found.score == 0.0
    assert "came to rest against vehicle car00 at 0.1 s" in str(found.reason)


def test_who_stands_while_another_one_comes_is_not():
    rolling = [cars((30.0 + 2.6, 0.0, 2.0, np.pi)), cars((30.0 + 2.4, 0.0, 2.0, np.pi))]
    assert strict_no_collision(creeping(0.0, rolling)).score == 1.0
    crept = [cars((30.0 + 2.5, 0.0, 0.05, np.pi)), cars((30.0 + 2.4, 0.0, 0.05, np.pi))]
    assert strict_no_collision(creeping(0.0, crept)).score == 1.0


# --- red lights ----------------------------------------------------------------------------------


def through_light(speed_mps: float, turned_m: float, before: Signals) -> float | None:
    """Over the line with red, which followed something else when the bumper was some way before it."""
    line_m = -12.0 - PACIFICA.length_m / 2
    x_m = np.arange(line_m - turned_m - 3.0 * speed_mps * 0.1, 30.0, speed_mps * 0.1)
    red = signals(red=("13",))
    shown = tuple(before if x < line_m - turned_m - 1e-9 else red for x in x_m)
    trace = replace(drive_at(x_m, -1.75, speed_mps), signals=shown)
    return red_lights(facts_of(trace, junction())).score


@pytest.mark.parametrize(("margin_m", "score"), [(0.6, 0.0), (-0.6, 1.0)])
def test_a_red_light_counts_where_one_could_have_stopped(margin_m: float, score: float):
    stops_m = 10.0**2 / (2.0 * HARDEST_STOP_MPS2)
    assert through_light(10.0, stops_m + margin_m, signals(green=("13",))) == score


def test_what_counts_is_where_it_was_when_yellow_began():
    line_m, stops_m = -12.0 - PACIFICA.length_m / 2, 10.0**2 / (2.0 * HARDEST_STOP_MPS2)
    x_m = np.arange(line_m - 40.0, 30.0, 1.0)
    lights = {"green": signals(green=("13",)), "yellow": signals(yellow=("13",)), "red": signals(red=("13",))}

    def at(x: float, yellow_m: float) -> Signals:
        return lights["green" if x < line_m - yellow_m else "yellow" if x < line_m - 3.5 else "red"]

    for yellow_m, score in ((stops_m + 1.5, 0.0), (stops_m - 1.5, 1.0)):
        shown = tuple(at(x, yellow_m) for x in x_m)
        facts = facts_of(replace(drive_at(x_m, -1.75), signals=shown), junction())
        assert red_lights(facts).score == score


# --- speed ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("speeds_mps", "score"),
    [
        ([15.0 * 1.5] * 5, 1.0),
        ([15.0 * 1.5 + 0.01], 0.0),
        ([15.0 * 1.25 + 0.01] * 10, 1.0),
        ([15.0 * 1.25 + 0.01] * 11, 0.0),
        ([15.0 * 1.25] * 40, 1.0),
    ],
)
def test_the_bounds_of_speed(speeds_mps: list[float], score: float):
    assert speeding(judged(drive(*speeds_mps, *[10.0] * 20, start=AT_START))).score == score


def test_off_the_lanes_the_limit_of_the_route_holds():
    trace = drive(*[30.0] * 20, start=Pose(20.0, 40.0, 0.0))
    assert speeding(judged(trace)).score == 0.0
    assert speeding(facts_of(trace, ROAD)).score == 1.0  # without a route nobody knows one


def test_for_three_seconds_after_a_drop_the_limit_is_what_gentle_braking_allows():
    limit = np.array([20.0] * 5 + [5.0] * 40)
    met = slowing_limits_mps(limit, 0.1)
    assert met[4:7].tolist() == [20.0, 19.75, 19.5]
    assert met[34] == pytest.approx(12.5)
    assert met[35] == 5.0
    assert slowing_limits_mps(np.array([20.0, 19.9, 19.9]), 0.1).tolist() == [20.0, 19.9, 19.9]


# --- forced braking ------------------------------------------------------------------------------


def behind(
    braking_mps2: float, without_mps2: float = 0.0, *, frame: int = 50, first: int = 0, ego_ax_mps2: float = 0.0,
    since: int = 0,
) -> Facts:  # fmt: skip
    """A car 20 m behind that brakes in one frame; the ego is in its lane from frame `since` on, in the next before."""
    frames = 60
    ego = drive_at(100.0 + np.arange(frames), [lane_y_m(0) if k >= since else lane_y_m(1) for k in range(frames)])
    speeds = [10.0 if k < frame else 10.0 - braking_mps2 * 0.1 for k in range(frames)]
    others = [cars((80.0 + k, 0.0, speeds[k])) if k >= first else Actors.none() for k in range(frames)]
    asked = [{"car00": -without_mps2} if k == frame else {} for k in range(frames)]
    ax = np.where(np.arange(frames) == frame, ego_ax_mps2, 0.0)
    track = replace(ego.ego, ax_mps2=ax)
    return judged(replace(ego, ego=track, actors=ActorTable.of(others, None, asked)))


@pytest.mark.parametrize(
    ("braking", "gate", "kind"),
    [
        (COURTEOUS_MPS2 - 0.01, 1.0, 1.0),
        ((COURTEOUS_MPS2 + HARDEST_MPS2) / 2, 1.0, 0.5),
        (HARDEST_MPS2 - 0.01, 1.0, 0.01 / 3),
        (HARDEST_MPS2 + 0.01, 0.0, 0.0),
    ],
)
def test_forced_braking_costs_courtesy_and_then_everything(braking: float, gate: float, kind: float):
    facts = behind(braking, since=40)
    assert forced_braking(facts).score == gate
    assert courtesy(facts).score == pytest.approx(kind)


def test_braking_that_would_have_been_all_but_as_hard_without_the_ego_is_not_forced():
    assert courtesy(behind(5.0, 5.0 - LEAST_FORCED_MPS2 + 0.01, since=40)).score == 1.0
    assert courtesy(behind(5.0, 5.0 - LEAST_FORCED_MPS2 - 0.01, since=40)).score == pytest.approx(1.0 / 3.0)


def test_who_has_just_come_is_not_counted():
    assert courtesy(behind(5.0, since=45, first=41)).score == 1.0
    assert courtesy(behind(5.0, since=45, first=40)).score == pytest.approx(1.0 / 3.0)


def test_an_old_follower_counts_only_where_the_ego_brakes_hard():
    assert courtesy(behind(5.0, ego_ax_mps2=-EGO_BRAKES_MPS2)).score == 1.0
    assert courtesy(behind(5.0, ego_ax_mps2=-EGO_BRAKES_MPS2 - 0.01)).score == pytest.approx(1.0 / 3.0)
    assert courtesy(behind(5.0, since=20)).score == 1.0
    assert courtesy(behind(5.0, since=21)).score == pytest.approx(1.0 / 3.0)


def test_the_reason_names_who_braked_how_hard_and_what_the_ego_did():
    said = str(courtesy(behind(5.0, 1.0, since=40)).reason)
    assert said == "vehicle car00 braked with 5.0 m/s2 at 5.0 s, without the ego with 1.0 m/s2; the ego was at 10.0 m/s"


def test_recorded_road_users_cannot_be_asked_and_so_it_is_not_judged():
    sheet = score_facts(judged(drive(*[10.0] * 202, start=AT_START)), "interplan-strict")
    assert sheet.metrics["courtesy"].score is None
    assert "recorded" in str(sheet.metrics["courtesy"].reason)
    assert "courtesy" not in sheet.weights
    assert "forced_braking" not in sheet.gates
    assert sheet.score == 1.0


# --- the task ------------------------------------------------------------------------------------


def test_who_passes_the_goal_line_in_time_has_done_it():
    done = task_done(judged(drive(*[10.0] * 202, start=AT_START)))
    short = task_done(judged(drive(*[10.0] * 200, start=AT_START)))
    assert (done.score, short.score) == (1.0, UNDONE)
    assert short.reason == "the goal line was still 1.0 m ahead; it drove 10.0 m/s on average"


def test_where_lane_changes_are_needed_it_must_be_in_the_goal_lane():
    scene = replace(SCENE, goal=LanePosition("12", 220.0))
    found = task_done(judged(drive(*[10.0] * 202, start=AT_START), scene))
    assert found.score == UNDONE
    assert "it passed the goal line but ended 1 lane beside the goal lane" in str(found.reason)
    beside = drive(*[10.0] * 202, start=Pose(20.0, lane_y_m(1), 0.0))
    assert task_done(judged(beside, scene)).score == 1.0
    free = replace(SCENE, family="jaywalker")  # where none is needed nobody asks
    assert task_done(judged(beside, free)).score == 1.0


def test_what_must_be_passed_must_be():
    scene = replace(SCENE, obstacles=(Obstacle(LanePosition("11", 218.0, 3.0)),))
    found = task_done(judged(drive(*[10.0] * 202, start=AT_START), scene))
    assert found.score == UNDONE
    assert "m were left to clear the last obstacle" in str(found.reason)


@pytest.mark.parametrize(("frames", "score"), [(191, 1.0), (189, UNDONE)])
def test_where_the_certificate_does_not_reach_the_line_most_of_its_way_is_asked(frames: int, score: float):
    far = replace(SCENE, goal=LanePosition("11", 500.0))
    expert = drive(*[10.0] * 201, start=AT_START).ego
    assert task_done(judged(drive(*[10.0] * frames, start=AT_START), far, expert)).score == score


def test_a_task_done_slowly_loses_quality():
    assert strict_progress(judged(drive(*[8.04] * 252, start=AT_START))).score == pytest.approx(1.0, abs=0.002)
    slow = strict_progress(judged(drive(*[6.7] * 301, start=AT_START)))
    assert slow.score == pytest.approx(1.25 * 20.1 / 30.0)
    assert "took 30.0 s, the reference drive 20.1 s" in str(slow.reason)


def test_an_undone_task_counts_by_the_way():
    assert strict_progress(judged(drive(*[10.0] * 101, start=AT_START))).score == pytest.approx(0.5)


def test_who_has_not_begun_scores_nothing():
    assert strict_making_progress(judged(drive(*[10.0] * 41, start=AT_START))).score == 1.0
    assert strict_making_progress(judged(drive(*[10.0] * 40, start=AT_START))).score == 0.0
    scene = replace(SCENE, obstacles=(Obstacle(LanePosition("11", 60.0 + 2.3)),))  # 40 m ahead: 25 m are enough
    assert strict_making_progress(judged(drive(*[10.0] * 27, start=AT_START), scene)).score == 1.0
    assert strict_making_progress(judged(drive(*[10.0] * 25, start=AT_START), scene)).score == 0.0


def test_who_stands_is_told_since_when_and_behind_whom():
    x_m = np.minimum(20.0 + np.arange(150), 60.0)
    speed = np.where(x_m < 60.0, 10.0, 0.0)
    found = task_done(judged(drive_at(x_m, speed_mps=speed, actors=cars((70.0, 0.0)))))
    assert "it stood from 4.0 s to the end behind standing vehicle car00, 5.0 m ahead" in str(found.reason)


# --- the score -----------------------------------------------------------------------------------


def test_a_drive_is_unsafe_or_undone_and_tells_its_score_by_the_paper_too():
    done = score_facts(judged(drive(*[10.0] * 202, start=AT_START)))
    assert (done.profile, done.score, done.done, done.unsafe) == ("interplan-strict", 1.0, True, False)
    assert done.beside == {"interplan-paper": 1.0}
    raced = score_facts(judged(drive(*[24.0] * 90, start=AT_START)))
    assert (raced.score, raced.done, raced.unsafe) == (0.0, True, True)
    assert raced.beside["interplan-paper"] > 0.0
    parked = score_facts(judged(drive(*[10.0] * 50, *[0.0] * 100, start=AT_START)))
    assert (parked.done, parked.unsafe) == (False, False)
    assert 0.0 < parked.score < UNDONE


def test_points_lost_add_up_to_what_is_missing():
    scores = {"gate": 0.5, "task": 0.25, "a": 0.0, "b": 0.5}
    lost = points_lost(scores, ("gate", "task"), {"a": 3.0, "b": 1.0})
    assert lost == {"gate": 50.0, "task": 37.5, "a": 9.375, "b": 1.5625}
    assert sum(lost.values()) == pytest.approx(100.0 * (1.0 - 0.5 * 0.25 * 0.5 / 4.0))


def test_gates_at_zero_share_all_points():
    lost = points_lost({"one": 0.0, "two": 0.0, "half": 0.5, "a": 0.2}, ("one", "two", "half"), {"a": 1.0})
    assert lost == {"one": 50.0, "two": 50.0, "half": 0.0, "a": 0.0}
