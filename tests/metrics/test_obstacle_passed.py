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


CONE = Obstacle(LanePosition("11", 110.0), "cone")
BUS = Obstacle(LanePosition("11", 150.0, -3.0), "bus")
ACROSS = Obstacle(LanePosition("11", 100.0), turned_rad=np.pi / 2, length_m=4.8, width_m=2.0)


@pytest.mark.parametrize(
    ("staged", "passed_m"),
    [((CAR,), 102.4), ((CAR, CONE), 110.25), ((CROSSING,), 123.0), ((CROSSING, BUS), 123.0), ((ACROSS,), 101.0)],
    ids=["a car", "the last of two", "the farther end of a way", "a bus there is scenery", "a car across the lane"],
)
def test_the_rear_bumper_must_be_beyond_the_last_corner(staged: tuple[Obstacle | Jaywalker, ...], passed_m: float):
    assert passing([50.0, passed_m + REAR_M - 1e-6], *staged).score == 0.0
    assert passing([50.0, passed_m + REAR_M + 1e-6], *staged).score == 1.0


def test_one_frame_beyond_is_enough_and_its_time_is_kept():
    result = passing([50.0, 90.0, 106.0, 104.0], CAR)
    assert result.score == 1.0
    assert result.detail["passed_at_s"] == pytest.approx(0.2)


def test_the_reason_says_how_much_was_missing():
    missing = f"stayed {2.4 + REAR_M:.1f} m short of clearing the last obstacle"
    assert passing([50.0, 100.0], CAR).reason == f"{missing}; it drove 10.0 m/s on average"


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
