"""Lane changes: what is left of the way to the goal lane at the end."""

from __future__ import annotations

from dataclasses import replace

import pytest
import shapely

from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.lane_changes import lane_changes
from tests.metrics.staging import NOBODY, drive_at, facts_of, lane_y_m, scenario_on
from tests.worlds import straight_road

ROAD = straight_road(lanes=4, length_m=300.0, cuts_m=((100.0, 120.0),))


def ending(x_m: float, y_m: float, *, start: str = "11", goal: tuple[str, float] = ("34", 150.0)) -> Facts:
    """A drive from lane 11 (or another) that ends at a point."""
    scenario = scenario_on(ROAD, (start, 20.0), goal)
    return facts_of(drive_at([20.0, x_m], [lane_y_m(int(start[1]) - 1), y_m]), ROAD, NOBODY, scenario)


@pytest.mark.parametrize(("lane", "score"), [(0, 0.0), (1, 1 / 3), (2, 2 / 3), (3, 1.0)])
def test_each_change_made_earns_its_share(lane: int, score: float):
    result = lane_changes(ending(250.0, lane_y_m(lane)))
    assert result.score == pytest.approx(score)
    assert result.detail["initial"] == 3
    assert result.detail["goal"] is (lane == 3)


def test_it_counts_wherever_on_the_route_the_drive_ends():
    assert lane_changes(ending(60.0, lane_y_m(3))).score == 1.0
    assert lane_changes(ending(110.0, lane_y_m(2))).score == pytest.approx(2 / 3)


def test_moving_away_from_the_goal_lane_is_no_less_than_zero():
    assert lane_changes(ending(250.0, lane_y_m(0), start="12")).score == 0.0


@pytest.mark.parametrize(("lane", "score"), [(1, 1.0), (0, 0.0), (2, 0.0)])
def test_where_nothing_is_needed_leaving_the_lane_costs_all(lane: int, score: float):
    assert lane_changes(ending(250.0, lane_y_m(lane), start="12", goal=("32", 150.0))).score == score


def test_off_the_route_at_the_end_scores_nothing():
    result = lane_changes(ending(250.0, lane_y_m(3) - 3.5))
    assert (result.score, result.reason) == (0.0, "ended off the route")
    assert result.detail["goal"] is False


def test_between_lanes_the_last_lane_counts():
    on_the_line = lane_y_m(3) + 1.75
    scenario = scenario_on(ROAD, ("11", 20.0), ("34", 150.0))
    trace = drive_at([20.0, 240.0, 250.0], [0.0, lane_y_m(2), on_the_line])
    result = lane_changes(facts_of(trace, ROAD, NOBODY, scenario))
    assert result.detail["last_lane"] == "33"
    assert result.score == pytest.approx(2 / 3)


def test_where_lanes_overlap_the_one_nearer_to_the_goal_counts():
    wide = replace(ROAD.lanes["33"], polygon=shapely.union(ROAD.lanes["33"].polygon, ROAD.lanes["34"].polygon))
    overlapping = replace(ROAD, lanes={**ROAD.lanes, "33": wide})
    scenario = scenario_on(ROAD, ("11", 20.0), ("34", 150.0))
    trace = drive_at([20.0, 250.0], [0.0, lane_y_m(3)])
    result = lane_changes(facts_of(trace, overlapping, NOBODY, scenario))
    assert (result.detail["last_lane"], result.score) == ("34", 1.0)


def test_the_frame_that_passes_the_goal_may_lie_beyond_the_last_roadblock():
    scenario = scenario_on(ROAD, ("11", 20.0), ("34", 179.5))
    passed = drive_at([20.0, 299.0, 300.2], [0.0, lane_y_m(3), lane_y_m(3)])
    assert lane_changes(facts_of(passed, ROAD, NOBODY, scenario)).score == 1.0
    gone = drive_at([20.0, 299.0, 300.2, 301.4], [0.0, *[lane_y_m(3)] * 3])
    assert lane_changes(facts_of(gone, ROAD, NOBODY, scenario)).score == 0.0


def test_the_reason_names_the_lane():
    assert lane_changes(ending(250.0, lane_y_m(1))).reason == "ended 2 lanes beside the goal lane, on lane 32"
    assert lane_changes(ending(250.0, lane_y_m(2))).reason == "ended 1 lane beside the goal lane, on lane 33"
