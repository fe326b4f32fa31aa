"""Start checks: each rule says what is wrong on one side of its threshold and nothing on the other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from stages import ONE_LANE, TWO_LANES, car, cone, narrowed, staged
from worlds import straight_road

from interplan_sumo.errors import TrafficError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.scenario.scenario import Jaywalker, LanePosition, Scenario, TrafficDemand
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.simulation.setup import open_traffic
from interplan_sumo.verification.start_checks import start_problems, validate
from interplan_sumo.world.roads import Roads


def problems(scenario: Scenario, roads: Roads = ONE_LANE) -> list[str]:
    return start_problems(scenario, roads, with_traffic=False)


def only(found: list[str], said: str) -> None:
    """One problem that says this, in one line."""
    assert len(found) == 1, found
    assert said in found[0]
    assert "\n" not in found[0]


CUT = straight_road(lanes=2, length_m=300.0, cuts_m=((100.0, 110.0),))
WALKER = Jaywalker(LanePosition("11", 90.0, -5.0), LanePosition("11", 100.0, 5.0), 1.5)
CHANGE = staged("lane_change_ltd", goal=LanePosition("12", 200.0))
MERGE = staged("lane_change_ltd", goal=LanePosition("32", 120.0), route=("1", "2", "3"))
WRECK = (car(100.0), car(104.0, 0.4, 0.3))


def ending(arc_m: float, **more: Any) -> Scenario:
    return staged(goal=LanePosition("11", arc_m), **more)


def beginning(arc_m: float, left_m: float = 0.0, scenario: Scenario | None = None) -> Scenario:
    return replace(scenario or staged(), start=LanePosition("11", arc_m, left_m))


@pytest.mark.parametrize(
    ("sound", "unsound", "roads", "said"),
    [
        (CHANGE, staged("lane_change_ltd"), TWO_LANES, "goal.lane: it can be reached without a lane change"),
        (
            beginning(69.0, scenario=MERGE),
            beginning(71.0, scenario=MERGE),
            narrowed("12"),
            "start: no lane lies beside lane 11 from 29.0 m ahead on, expected one for 30.0 m or more",
        ),
        (ending(25.2), ending(25.0), ONE_LANE, "goal: it lies 5.0 m ahead of the start"),
        (
            ending(120.25, obstacles=(cone(100.0), cone(90.0))),
            ending(120.15, obstacles=(cone(100.0), cone(90.0))),
            ONE_LANE,
            "19.9 m past obstacles[0] along the route, expected at least 20 m; move it 0.1 m on",
        ),
        (
            staged(start_speed_mps=13.94),
            staged(start_speed_mps=13.96),
            ONE_LANE,
            "start_speed_mps: 14.0 is above the limit of lane 11, expected at most 13.9",
        ),
        # 3.5 m of lane and 2.297 m of car leave 0.6015 m
        (beginning(20.0, 0.60), beginning(20.0, 0.61), ONE_LANE, "start: the ego's box is not wholly on the drivable"),
        # the front gets to 20 + 30 + 2.588 m; a cone of 0.5 m that stands 5 cm inside of that is reached
        (
            staged(obstacles=(cone(52.82),)),
            staged(obstacles=(cone(52.74),)),
            ONE_LANE,
            "start: holding lane and speed the ego hits obstacles[0] after 3.0 s",
        ),
        (staged(), staged(obstacles=(cone(22.0),)), ONE_LANE, "start: the ego overlaps obstacles[0]"),
        (
            staged(obstacles=(cone(100.0), cone(100.46))),
            staged(obstacles=(cone(100.0), cone(100.44))),
            ONE_LANE,
            "obstacles[1]: overlaps obstacles[0] by 6 cm, expected at most 5",
        ),
    ],
)
def test_a_start_is_sound_on_one_side_of_a_threshold_only(
    sound: Scenario, unsound: Scenario, roads: Roads, said: str
) -> None:
    assert problems(sound, roads) == []
    only(problems(unsound, roads), said)


def test_what_does_not_fit_the_map_is_the_only_thing_said() -> None:
    wrong = staged(start=LanePosition("99", 1.0), start_speed_mps=50.0)
    only(problems(wrong), "start: map tiny_road has no lane '99'")
    only(problems(staged(route=("1", "3"), goal=LanePosition("31", 50.0)), CUT), "route jumps from roadblock 1 to 3")


def test_the_goal_lane_must_be_within_reach_of_the_start_lane() -> None:
    astray = staged(start=LanePosition("31", 10.0), goal=LanePosition("11", 50.0), route=("1", "2", "3"))
    assert "route: no way leads from the start on lane 31 to the goal on lane 11" in problems(astray, CUT)[0]


def test_the_goal_lies_20_m_past_the_last_crossing() -> None:
    assert not any(said.startswith("goal") for said in problems(ending(120.0, jaywalkers=(WALKER,))))
    assert any("19.8 m past jaywalkers[0]" in said for said in problems(ending(119.8, jaywalkers=(WALKER,))))


def test_a_pedestrian_does_not_wait_inside_an_obstacle() -> None:
    found = problems(staged(obstacles=(cone(90.0, -5.1),), jaywalkers=(WALKER,), start_speed_mps=5.0))
    only(found, "jaywalkers[0]: overlaps obstacles[0]")


def test_only_crashed_cars_may_overlap() -> None:
    assert any("overlaps" in text for text in problems(staged(obstacles=WRECK), TWO_LANES))
    assert not any("overlaps" in text for text in problems(staged("accident", obstacles=WRECK), TWO_LANES))
    buried = (*WRECK, cone(100.0))
    assert any("obstacles[2]: overlaps" in text for text in problems(staged("accident", obstacles=buried), TWO_LANES))


# --- whole scenarios -----------------------------------------------------------------------------


def test_a_map_that_is_not_there_is_a_problem_like_others() -> None:
    only(validate(staged(map="stripp")), "map: no map named 'stripp'. Did you mean 'strip'?")


def test_a_vehicle_type_file_that_is_not_there_is_a_problem_like_others() -> None:
    wild = replace(find_scenario("lane_change_ltd/0"), traffic=TrafficDemand("low", "wild"))  # type: ignore[arg-type]
    only(start_problems(wild, load_roads(wild.map)), "wild")
    assert validate(wild, with_traffic=False) == []


def test_where_sumo_fails_the_scenario_is_named() -> None:
    scenario = find_scenario("lane_change_ltd/0")
    roads = load_roads(scenario.map)
    with open_traffic(scenario, roads), pytest.raises(TrafficError, match=r"^lane_change_ltd/0: SUMO is already"):
        start_problems(scenario, roads)
