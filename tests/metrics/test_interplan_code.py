"""The published code's terms: index differences, its constants, and the ratio that passes an obstacle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from interplan_sumo.metrics.interplan_code import published_lane_changes, published_obstacle_passed
from interplan_sumo.scenario.scenario import Jaywalker, LanePosition, Obstacle, Scenario
from tests.metrics.staging import NOBODY, drive_at, facts_of, lane_y_m, scenario_on
from tests.worlds import straight_road

ROAD = straight_road(lanes=4, length_m=300.0, cuts_m=((100.0, 120.0),))


def ending(x_m: float, lane: int, *, start: str = "11", goal: str = "34"):
    scenario = scenario_on(ROAD, (start, 20.0), (goal, 150.0))
    trace = drive_at([20.0, x_m], [lane_y_m(int(start[1]) - 1), lane_y_m(lane)])
    return published_lane_changes(facts_of(trace, ROAD, NOBODY, scenario))


@pytest.mark.parametrize(("lane", "score"), [(0, 0.0), (1, 1 / 3), (2, 2 / 3), (3, 1.0)])
def test_the_share_of_index_steps_counts(lane: int, score: float):
    assert ending(250.0, lane).score == pytest.approx(score)


@pytest.mark.parametrize(("lane", "score"), [(1, 1.0), (0, 0.5), (3, 0.5)])
def test_where_nothing_is_needed_another_lane_is_worth_a_half(lane: int, score: float):
    assert ending(250.0, lane, start="12", goal="32").score == score


def test_off_the_route_the_last_roadblock_of_the_route_counts():
    scenario = scenario_on(ROAD, ("11", 20.0), ("34", 150.0))
    trace = drive_at([20.0, 250.0, 260.0], [0.0, lane_y_m(2), 50.0])
    assert published_lane_changes(facts_of(trace, ROAD, NOBODY, scenario)).score == pytest.approx(2 / 3)


def test_never_on_the_route_is_a_lost_run():
    scenario = scenario_on(ROAD, ("11", 20.0), ("34", 150.0))
    result = published_lane_changes(facts_of(drive_at([20.0, 30.0], 50.0), ROAD, NOBODY, scenario))
    assert result.score == 0.0
    assert result.reason is not None
    assert "loses such a run" in result.reason


def test_a_start_beside_the_route_gives_the_constant_of_the_published_code():
    scenario = replace(scenario_on(ROAD, ("11", 20.0), ("34", 150.0)), route=("2", "3"))
    result = published_lane_changes(facts_of(drive_at([130.0, 250.0], lane_y_m(0)), ROAD, NOBODY, scenario))
    assert result.score == 0.2607


CARS = Obstacle(LanePosition("11", 60.0)), Obstacle(LanePosition("11", 100.0))
BLOCKED = replace(scenario_on(ROAD, ("11", 20.0), ("31", 150.0)), obstacles=CARS)


WALKED = replace(BLOCKED, jaywalkers=(Jaywalker(LanePosition("11", 90.0, 5.0), LanePosition("11", 99.0, -5.0), 1.4),))


@pytest.mark.parametrize(("scenario", "way_m"), [(BLOCKED, 80.0), (WALKED, 79.0)], ids=["a car", "a pedestrian"])
def test_an_obstacle_is_passed_by_the_share_of_the_experts_way(scenario: Scenario, way_m: float):
    # the box centre of the last one, 80 m into the expert's 200 m, is what counts; of a pedestrian the end of the way
    expert = drive_at(np.linspace(20.0, 220.0, 50)).ego
    short, far = (facts_of(drive_at([20.0, 20.0 + way_m + m]), ROAD, expert, scenario) for m in (-0.1, 0.1))
    assert published_obstacle_passed(short).score == 0.0
    assert published_obstacle_passed(far).score == 1.0


def test_an_expert_that_stays_passes_nothing():
    facts = facts_of(drive_at([20.0, 150.0]), ROAD, drive_at([20.0, 20.0]).ego, BLOCKED)
    assert published_obstacle_passed(facts).score == 0.0
