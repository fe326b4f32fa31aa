"""Cars move no faster and turn no faster than cars can, whatever SUMO reports."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from interplan_sumo.simulation.agent_kinematics import AgentKinematics, navigation_deg

DT_S = 0.1


def moved(*frames: tuple[float, float, float, float]) -> AgentKinematics:
    """One car after frames of x, y, navigation angle and speed."""
    cars = AgentKinematics(DT_S)
    for x, y, angle_deg, speed_mps in frames:
        cars.move([(x, y)], [angle_deg], [speed_mps], CAR)
    return cars


@pytest.mark.parametrize("heading_rad", [0.0, 1.0, -2.5, pi / 2])
def test_navigation_angles_are_headings_and_back(heading_rad: float) -> None:
    assert moved((0, 0, navigation_deg(heading_rad), 5.0)).heading_rad[0] == pytest.approx(heading_rad)


def test_an_ordinary_motion_is_taken_over_to_the_bit() -> None:
    cars = moved((0.0, 0.0, 90.0, 10.0), (1.0, 0.117, 88.5, 10.0))
    assert cars.front_m.tolist() == [[1.0, 0.117]]
    assert cars.heading_rad[0] == (pi / 2 - np.radians(88.5) + pi) % (2 * pi) - pi


def test_a_slow_car_turns_gradually_towards_an_angle_that_jumps() -> None:
    cars = moved((0.0, 0.0, 90.0, 1.0), (0.1, 0.0, 50.0, 1.0))
    assert cars.heading_rad[0] == pytest.approx(0.25 * DT_S * 1.0 + 0.02)
    for _ in range(40):
        cars.move([(0.1, 0.0)], [50.0], [1.0])
    assert cars.heading_rad[0] == pytest.approx(np.radians(40.0))


def test_turning_across_south_is_no_jump() -> None:
    cars = moved((0.0, 0.0, 269.5, 1.0), (0.0, 0.0, 270.5, 1.0))  # headings just below pi and just above -pi
    assert cars.heading_rad[0] == pytest.approx(pi - np.radians(0.5), abs=1e-9) or cars.heading_rad[0] == pytest.approx(
        -pi - np.radians(0.5) + 2 * pi, abs=1e-9
    )


def test_a_car_that_jumps_slides_there_and_arrives() -> None:
    cars = moved((0.0, 0.0, 90.0, 0.5), (0.05, 1.5, 90.0, 0.5))
    assert np.hypot(*cars.front_m[0]) == pytest.approx(1.2 * DT_S * 0.5 + 0.2)
    for _ in range(10):
        cars.move([(0.05, 1.5)], [90.0], [0.5])
    assert cars.front_m[0] == pytest.approx([0.05, 1.5])


@pytest.mark.parametrize(("moved_m", "shown_m"), [(1.39, 1.39), (1.41, 1.4), (1.7, 1.4)])
def test_a_car_at_10_mps_moves_by_a_fifth_more_and_a_lane_changes_slide_at_most(moved_m: float, shown_m: float) -> None:
    assert moved((0.0, 0.0, 90.0, 10.0), (moved_m, 0.0, 90.0, 10.0)).front_m[0, 0] == pytest.approx(shown_m)


def test_an_agent_that_has_left_takes_its_row_along() -> None:
    cars = AgentKinematics(DT_S)
    cars.move([(0, 0), (10, 0), (20, 0)], [90, 80, 70], [1, 2, 3])
    cars.keep([True, False, True])
    assert cars.front_m[:, 0].tolist() == [0, 20]
    cars.move([(0.1, 0), (20.3, 0)], [90, 70], [1, 3])
    assert cars.turned_rad == pytest.approx([0.0, 0.0])


def test_one_that_enters_begins_where_sumo_says_and_the_others_move_on() -> None:
    cars = AgentKinematics(DT_S)
    cars.insert([0, 1])
    cars.move([(0, 0), (20, 0)], [90, 70], [1, 3])
    cars.insert([1])
    cars.move([(0.1, 0), (500, 40), (20.3, 0)], [90, 200, 70], [1, 9, 3])
    assert cars.front_m[:, 0].tolist() == [0.1, 500, 20.3]
    assert cars.heading_rad[1] == pytest.approx(np.radians(90.0 - 200.0))
    assert cars.turned_rad == pytest.approx([0.0, 0.0, 0.0])
