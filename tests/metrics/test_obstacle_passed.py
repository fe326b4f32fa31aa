"""Obstacle passed: the whole rear bumper beyond every corner."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.metric import MetricResult
from interplan_sumo.metrics.obstacle_passed import clear_by_m, obstacle_passed
from interplan_sumo.scenario.scenario import Jaywalker, LanePosition, Obstacle
from interplan_sumo.world.geometry import Polyline, box_corners
from tests.metrics.staging import NOBODY, drive_at, facts_of, scenario_on
from tests.worlds import straight_road

ROAD = straight_road(length_m=300.0)
REAR_M = 5.176 / 2
CAR = Obstacle(LanePosition("11", 100.0, 0.5), length_m=4.8, width_m=2.0)
"""Its front is at x = 102.4."""
CROSSING = Jaywalker(LanePosition("11", 120.0, -6.0), LanePosition("11", 123.0, 6.0), 1.4)


def facts_with(x_m: object, *staged: Obstacle | Jaywalker) -> Facts:
    scenario = scenario_on(
        ROAD,
        ("11", 20.0),
        ("11", 290.0),
        obstacles=tuple(s for s in staged if isinstance(s, Obstacle)),
        jaywalkers=tuple(s for s in staged if isinstance(s, Jaywalker)),
    )
    return facts_of(drive_at(x_m, 3.0), ROAD, NOBODY, scenario)


def passing(x_m: object, *staged: Obstacle | Jaywalker) -> MetricResult:
    return obstacle_passed(facts_with(x_m, *staged))


@pytest.mark.parametrize(("beyond_m", "score"), [(-1e-6, 0.0), (1e-6, 1.0)])
def test_the_rear_bumper_must_be_beyond_the_last_corner(beyond_m: float, score: float):
    assert passing([50.0, 102.4 + REAR_M + beyond_m], CAR).score == score


def test_every_obstacle_must_be_passed():
    cone = Obstacle(LanePosition("11", 110.0), "cone")
    assert passing([50.0, 106.0], CAR).score == 1.0
    assert passing([50.0, 106.0], CAR, cone).score == 0.0
    assert passing([50.0, 113.0], CAR, cone).score == 1.0


def test_of_a_way_across_the_farther_end_counts():
    assert passing([50.0, 122.9 + REAR_M], CROSSING).score == 0.0
    assert passing([50.0, 123.1 + REAR_M], CROSSING).score == 1.0


def test_where_pedestrians_cross_the_bus_beside_them_is_scenery():
    bus = Obstacle(LanePosition("11", 150.0, -3.0), "bus")
    assert passing([50.0, 130.0], CROSSING, bus).score == 1.0


def test_an_obstacle_turned_in_its_lane_reaches_as_far_as_its_corners():
    across = Obstacle(LanePosition("11", 100.0), turned_rad=np.pi / 2, length_m=4.8, width_m=2.0)
    assert passing([50.0, 100.9 + REAR_M], across).score == 0.0
    assert passing([50.0, 101.1 + REAR_M], across).score == 1.0


def test_one_frame_beyond_is_enough_and_its_time_is_kept():
    result = passing([50.0, 90.0, 106.0, 104.0], CAR)
    assert result.score == 1.0
    assert result.detail["passed_at_s"] == pytest.approx(0.2)


def test_the_reason_says_how_much_was_missing():
    assert passing([50.0, 100.0], CAR).reason == f"stayed {2.4 + REAR_M:.1f} m short of clearing the last obstacle"


@pytest.mark.parametrize("turned_rad", [0.5, -0.5])
def test_an_ego_at_an_angle_must_bring_both_rear_corners_past(turned_rad: float):
    line = Polyline(np.array(((0.0, 0.0), (300.0, 0.0))))
    car = list(box_corners(100.0, 0.5, 0.0, 4.8, 2.0))
    straight = clear_by_m(line, box_corners(110.0, 0.0, 0.0, 5.0, 2.0), car)
    turned = clear_by_m(line, box_corners(110.0, 0.0, turned_rad, 5.0, 2.0), car)
    assert straight[0] == pytest.approx(110.0 - 2.5 - 102.4)
    assert turned[0] == pytest.approx(110.0 - 2.5 * np.cos(0.5) - 1.0 * np.sin(0.5) - 102.4)


def test_without_obstacles_there_is_nothing_to_pass():
    facts = facts_with([50.0, 60.0])
    assert facts.obstacle_corners == ()
    assert (clear_by_m(facts.route_line, facts.corners, ()) == np.inf).all()
