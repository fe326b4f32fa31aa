"""Bodies move no faster and turn no faster than a body can, whatever SUMO reports."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from interplan_sumo.simulation.agent_kinematics import SLIDE_M, STRETCH, TURN_SLACK_RAD, AgentKinematics, navigation_deg

DT_S = 0.1


def moved(*frames: tuple[float, float, float, float]) -> AgentKinematics:
    """One body after frames of x, y, navigation angle and speed."""
    bodies = AgentKinematics(DT_S)
    for x, y, angle_deg, speed_mps in frames:
        bodies.move([(x, y)], [angle_deg], [speed_mps])
    return bodies


@pytest.mark.parametrize("heading_rad", [0.0, 1.0, -2.5, pi / 2])
def test_navigation_angles_are_headings_and_back(heading_rad: float) -> None:
    assert moved((0, 0, navigation_deg(heading_rad), 5.0)).heading_rad[0] == pytest.approx(heading_rad)


def test_an_ordinary_motion_is_taken_over_to_the_bit() -> None:
    bodies = moved((0.0, 0.0, 90.0, 10.0), (1.0, 0.117, 88.5, 10.0))
    assert bodies.front_m.tolist() == [[1.0, 0.117]]
    assert bodies.heading_rad[0] == (pi / 2 - np.radians(88.5) + pi) % (2 * pi) - pi


def test_a_slow_body_turns_gradually_towards_an_angle_that_jumps() -> None:
    bodies = moved((0.0, 0.0, 90.0, 1.0), (0.1, 0.0, 50.0, 1.0))
    assert bodies.heading_rad[0] == pytest.approx(0.25 * DT_S * 1.0 + TURN_SLACK_RAD)
    for _ in range(40):
        bodies.move([(0.1, 0.0)], [50.0], [1.0])
    assert bodies.heading_rad[0] == pytest.approx(np.radians(40.0))


def test_turning_across_south_is_no_jump() -> None:
    bodies = moved((0.0, 0.0, 269.5, 1.0), (0.0, 0.0, 270.5, 1.0))  # headings just below pi and just above -pi
    assert bodies.heading_rad[0] == pytest.approx(pi - np.radians(0.5), abs=1e-9) or bodies.heading_rad[
        0
    ] == pytest.approx(-pi - np.radians(0.5) + 2 * pi, abs=1e-9)


def test_a_body_that_jumps_slides_there_and_arrives() -> None:
    bodies = moved((0.0, 0.0, 90.0, 0.5), (0.05, 1.5, 90.0, 0.5))
    assert np.hypot(*bodies.front_m[0]) == pytest.approx(STRETCH * DT_S * 0.5 + SLIDE_M)
    for _ in range(10):
        bodies.move([(0.05, 1.5)], [90.0], [0.5])
    assert bodies.front_m[0] == pytest.approx([0.05, 1.5])


def test_who_has_left_takes_its_row_along() -> None:
    bodies = AgentKinematics(DT_S)
    bodies.move([(0, 0), (10, 0), (20, 0)], [90, 80, 70], [1, 2, 3])
    bodies.keep([True, False, True])
    assert bodies.front_m[:, 0].tolist() == [0, 20]
    bodies.move([(0.1, 0), (20.3, 0)], [90, 70], [1, 3])
    assert bodies.turned_rad == pytest.approx([0.0, 0.0])


def test_who_comes_begins_where_sumo_says_and_the_others_move_on() -> None:
    bodies = AgentKinematics(DT_S)
    bodies.insert([0, 1])
    bodies.move([(0, 0), (20, 0)], [90, 70], [1, 3])
    bodies.insert([1])
    bodies.move([(0.1, 0), (500, 40), (20.3, 0)], [90, 200, 70], [1, 9, 3])
    assert bodies.front_m[:, 0].tolist() == [0.1, 500, 20.3]
    assert bodies.heading_rad[1] == pytest.approx(np.radians(90.0 - 200.0))
    assert bodies.turned_rad == pytest.approx([0.0, 0.0, 0.0])
