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


@pytest.mark.parametrize(
    ("x_m", "start", "goal", "lane", "score"),
    [
        *((250.0, "11", "34", lane, lane / 3) for lane in range(4)),
        (60.0, "11", "34", 3, 1.0),  # it counts wherever on the route the drive ends
        (110.0, "11", "34", 2, 2 / 3),
        (250.0, "12", "34", 0, 0.0),  # moving away from the goal lane is no less than zero
        *((250.0, "12", "32", lane, float(lane == 1)) for lane in range(3)),  # leaving a lane that is right costs all
    ],
)
def test_each_change_made_earns_its_share(x_m: float, start: str, goal: str, lane: int, score: float):
    result = lane_changes(ending(x_m, lane_y_m(lane), start=start, goal=(goal, 150.0)))
    assert result.score == pytest.approx(score)
    assert result.detail["initial"] == int(goal[1]) - int(start[1])
    assert result.detail["goal"] is (score == 1.0)


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
    both = ROAD.lanes["33"].polygon.union(ROAD.lanes["34"].polygon)
    assert isinstance(both, shapely.Polygon)
    wide = replace(ROAD.lanes["33"], polygon=both)
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
