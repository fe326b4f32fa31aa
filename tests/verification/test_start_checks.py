"""Start checks: each rule says what is wrong on one side of its threshold and nothing on the other."""

from __future__ import annotations

from dataclasses import replace

import pytest
from stages import ONE_LANE, TWO_LANES, car, cone, narrowed, staged
from worlds import straight_road

from interplan_sumo.scenario.scenario import Jaywalker, LanePosition, Scenario, TrafficDemand
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.verification.start_checks import start_problems, validate


def problems(scenario: Scenario, roads: object = ONE_LANE) -> list[str]:
    return start_problems(scenario, roads, with_traffic=False)  # type: ignore[arg-type]


def only(found: list[str], *words: str) -> None:
    """One problem that says all these words, in one line."""
    assert len(found) == 1, found
    assert all(word in found[0] for word in words), found
    assert "\n" not in found[0]


def test_an_empty_road_is_sound() -> None:
    assert problems(staged()) == []


# --- route and goal ------------------------------------------------------------------------------


def test_what_does_not_fit_the_map_is_the_only_thing_said() -> None:
    wrong = staged(start=LanePosition("99", 1.0), start_speed_mps=50.0)
    only(problems(wrong), "start: map tiny_road has no lane '99'")
    cut = straight_road(lanes=1, length_m=300.0, cuts_m=((100.0, 110.0),))
    jump = staged(route=("1", "3"), goal=LanePosition("31", 50.0))
    only(problems(jump, cut), "route jumps from roadblock 1 to 3")


def test_the_goal_lane_must_be_within_reach_of_the_start_lane() -> None:
    cut = straight_road(lanes=2, length_m=300.0, cuts_m=((100.0, 110.0),))
    astray = staged(start=LanePosition("31", 10.0), goal=LanePosition("11", 50.0), route=("1", "2", "3"))
    assert "route: no way leads from the start on lane 31 to the goal on lane 11" in problems(astray, cut)[0]


def test_a_lane_change_needs_a_change_of_lanes() -> None:
    only(problems(staged("lane_change_ltd"), TWO_LANES), "goal.lane: it can be reached without a lane change")
    assert problems(staged("lane_change_ltd", goal=LanePosition("12", 200.0)), TWO_LANES) == []


@pytest.mark.parametrize(("start_m", "sound"), [(69.0, True), (71.0, False)])
def test_a_lane_change_needs_a_lane_beside_for_three_seconds(start_m: float, sound: bool) -> None:
    merge = staged("lane_change_ltd", goal=LanePosition("32", 120.0), route=("1", "2", "3"))
    found = problems(replace(merge, start=LanePosition("11", start_m)), narrowed("12"))
    if sound:
        assert found == []
    else:
        only(found, "start: no lane lies beside lane 11 from 29.0 m ahead on", "expected one for 30.0 m or more")


def test_the_goal_lies_ahead_of_the_start() -> None:
    only(problems(staged(goal=LanePosition("11", 25.0))), "goal: it lies 5.0 m ahead of the start", "5.2 m")
    assert problems(staged(goal=LanePosition("11", 25.2))) == []


@pytest.mark.parametrize(("goal_m", "sound"), [(120.25, True), (120.15, False)])
def test_the_goal_lies_20_m_past_the_last_obstacle(goal_m: float, sound: bool) -> None:
    found = problems(staged(obstacles=(cone(100.0), cone(90.0)), goal=LanePosition("11", goal_m)))
    if sound:
        assert found == []
    else:
        only(found, "goal: it lies 19.9 m past obstacles[0]", "expected at least 20 m; move it 0.1 m on")


@pytest.mark.parametrize(("goal_m", "sound"), [(120.0, True), (119.8, False)])
def test_the_goal_lies_20_m_past_the_last_crossing(goal_m: float, sound: bool) -> None:
    walker = Jaywalker(LanePosition("11", 90.0, -5.0), LanePosition("11", 100.0, 5.0), 1.5)
    found = [p for p in problems(staged(jaywalkers=(walker,), goal=LanePosition("11", goal_m))) if p.startswith("goal")]
    assert (not found) == sound
    if not sound:
        only(found, "19.8 m past jaywalkers[0]")


# --- the ego -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("speed_mps", "sound"), [(13.94, True), (13.96, False)])
def test_the_ego_starts_within_the_limit(speed_mps: float, sound: bool) -> None:
    found = problems(staged(start_speed_mps=speed_mps))
    assert (not found) == sound
    if not sound:
        only(found, "start_speed_mps: 14.0 is above the limit of lane 11, expected at most 13.9")


@pytest.mark.parametrize(("left_m", "sound"), [(0.60, True), (0.61, False)])
def test_the_ego_starts_on_the_drivable_area(left_m: float, sound: bool) -> None:
    """3.5 m of lane and 2.297 m of car leave 0.6015 m."""
    found = problems(staged(start=LanePosition("11", 20.0, left_m)))
    assert (not found) == sound
    if not sound:
        only(found, "start: the ego's box is not wholly on the drivable area")


@pytest.mark.parametrize(("arc_m", "sound"), [(52.82, True), (52.74, False)])
def test_nothing_lies_within_3_s_of_the_ego(arc_m: float, sound: bool) -> None:
    """The front gets to 20 + 30 + 2.588 m; a cone of 0.5 m that stands 5 cm inside of that is reached."""
    found = problems(staged(obstacles=(cone(arc_m),)))
    assert (not found) == sound
    if not sound:
        only(found, "start: holding lane and speed the ego hits obstacles[0] after 3.0 s")


def test_the_ego_does_not_start_in_an_obstacle() -> None:
    only(problems(staged(obstacles=(cone(22.0),))), "start: the ego overlaps obstacles[0]")


# --- what stands ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("apart_m", "sound"), [(0.46, True), (0.44, False)])
def test_obstacles_overlap_by_no_more_than_5_cm(apart_m: float, sound: bool) -> None:
    found = problems(staged(obstacles=(cone(100.0), cone(100.0 + apart_m))))
    assert (not found) == sound
    if not sound:
        only(found, "obstacles[1]: overlaps obstacles[0] by 6 cm, expected at most 5")


def test_a_pedestrian_does_not_wait_inside_an_obstacle() -> None:
    walker = Jaywalker(LanePosition("11", 100.0, -5.0), LanePosition("11", 100.0, 5.0), 1.5)
    found = problems(staged(obstacles=(cone(100.0, -5.1),), jaywalkers=(walker,), start_speed_mps=5.0))
    only(found, "jaywalkers[0]: overlaps obstacles[0]")


def test_only_crashed_cars_may_overlap() -> None:
    wreck = (car(100.0), car(104.0, 0.4, 0.3))
    assert any("overlaps" in text for text in problems(staged(obstacles=wreck), TWO_LANES))
    assert not any("overlaps" in text for text in problems(staged("accident", obstacles=wreck), TWO_LANES))
    buried = (*wreck, cone(100.0))
    assert any("obstacles[2]: overlaps" in text for text in problems(staged("accident", obstacles=buried), TWO_LANES))


# --- whole scenarios -----------------------------------------------------------------------------


def test_a_map_that_is_not_there_is_a_problem_like_others() -> None:
    only(validate(staged(map="stripp")), "map: no map named 'stripp'. Did you mean 'strip'?")


def test_a_vehicle_type_file_that_is_not_there_is_a_problem_like_others() -> None:
    wild = replace(find_scenario("lane_change_ltd/0"), traffic=TrafficDemand("low", "wild"))  # type: ignore[arg-type]
    only(validate(wild), "wild")
    assert validate(wild, with_traffic=False) == []
