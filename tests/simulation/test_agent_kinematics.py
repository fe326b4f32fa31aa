"""Cars move no faster and turn no faster than cars can, whatever SUMO reports."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest

from interplan_sumo.simulation.agent_kinematics import AgentKinematics, navigation_deg
from interplan_sumo.world.geometry import wrap_angle

DT_S = 0.1
CAR_M, BUS_M = 4.6, 12.0


def moved(*frames: tuple[float, float, float, float], length_m: float = CAR_M) -> AgentKinematics:
    """One car after frames of x, y, navigation angle and speed."""
    cars = AgentKinematics(DT_S)
    cars.insert([0])
    for x, y, angle_deg, speed_mps in frames:
        cars.move([(x, y)], [angle_deg], [speed_mps], np.array([length_m]))
    return cars


@pytest.mark.parametrize("heading_rad", [0.0, 1.0, -2.5, pi / 2])
def test_navigation_angles_are_headings_and_back(heading_rad: float) -> None:
    assert moved((0, 0, navigation_deg(heading_rad), 5.0)).heading_rad[0] == pytest.approx(heading_rad)


def slip_deg(before: AgentKinematics, after: AgentKinematics, length_m: float) -> float:
    """Between the way of the rear axle and the way that it points, on average over a step."""
    axles = [cars.front_m[0] - 0.78 * length_m * np.array((np.cos(h := cars.heading_rad[0]), np.sin(h)))
             for cars in (before, after)]  # fmt: skip
    went = axles[1] - axles[0]
    pointed = (before.heading_rad[0] + after.heading_rad[0]) / 2.0
    return abs(float(np.degrees(np.arctan2(went[1], went[0]) - pointed)))


def test_an_ordinary_motion_is_taken_over_to_the_bit() -> None:
    cars = moved((0.0, 0.0, 90.0, 10.0), (1.0, 0.117, 88.5, 10.0))
    assert cars.front_m.tolist() == [[1.0, 0.117]]
    assert cars.heading_rad[0] == (pi / 2 - np.radians(88.5) + pi) % (2 * pi) - pi


@pytest.mark.parametrize("angle_deg", [50.0, 90.0, 130.0])
@pytest.mark.parametrize("aside_m", [-0.12, 0.0, 0.12])
@pytest.mark.parametrize("speed_mps", [1.0, 4.0, 12.0])
@pytest.mark.parametrize("length_m", [CAR_M, BUS_M])
def test_whatever_sumo_says_a_body_hardly_slips(
    angle_deg: float, aside_m: float, speed_mps: float, length_m: float
) -> None:
    frames = [(0.0, 0.0, 90.0, speed_mps)]
    for k in range(1, 8):
        frames.append((k * DT_S * speed_mps, k * aside_m, angle_deg, speed_mps))
        before, after = moved(*frames[:-1], length_m=length_m), moved(*frames, length_m=length_m)
        assert slip_deg(before, after, length_m) < 9.9


def test_a_body_that_is_pulled_aside_comes_to_point_where_its_front_goes() -> None:
    frames = [(0.0, 0.0, 90.0, 5.0), *((0.4 * k, 0.3 * k, 90.0 - np.degrees(np.arctan2(3, 4)), 5.0) for k in range(40))]
    assert moved(*frames).heading_rad[0] == pytest.approx(np.arctan2(3, 4))


def test_a_standing_car_does_not_turn() -> None:
    assert moved((0.0, 0.0, 90.0, 0.0), (0.0, 0.0, 10.0, 0.0)).heading_rad[0] == pytest.approx(0.0, abs=1e-9)


def test_turning_across_south_is_no_jump() -> None:
    cars = moved((0.0, 0.0, 269.5, 9.0), (-0.9, 0.0, 270.5, 9.0))  # headings just below pi and just above -pi
    assert abs(wrap_angle(cars.heading_rad[0] - pi)) < np.radians(0.6)


@pytest.mark.parametrize(("went_m", "shown_m"), [(0.51, 0.51), (0.49, 0.5), (-0.2, 0.5)])
def test_a_car_at_10_mps_does_not_jump_back(went_m: float, shown_m: float) -> None:
    assert moved((0.0, 0.0, 90.0, 10.0), (went_m, 0.0, 90.0, 10.0)).front_m[0, 0] == pytest.approx(shown_m)


@pytest.mark.parametrize("angle_deg", [90.0, 60.0])
def test_a_car_that_stands_stays_where_it_is_and_follows_sumos_front_once_it_drives(angle_deg: float) -> None:
    frames = [(0.0, 0.0, angle_deg, 0.0), *((0.0, 0.02 * k, 70.0, 0.0) for k in range(1, 76))]
    cars = moved(*frames)
    assert cars.front_m[0] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert cars.heading_rad[0] == pytest.approx(np.radians(90.0 - angle_deg), abs=1e-9)
    assert cars.displaced == {0}
    for k in range(60):
        cars.move([(0.1 * (k + 1), 1.5)], [90.0], [1.0], np.array([CAR_M]))
    assert cars.front_m[0] == pytest.approx([6.0, 1.5], abs=0.05)
    assert not cars.displaced


@pytest.mark.parametrize(("aside_m", "shown_m"), [(0.39, 0.39), (0.41, 0.4), (-0.41, -0.4)])
def test_a_front_goes_no_farther_aside_than_ahead(aside_m: float, shown_m: float) -> None:
    assert moved((0.0, 0.0, 90.0, 4.0), (0.4, aside_m, 90.0, 4.0)).front_m[0, 1] == pytest.approx(shown_m)


@pytest.mark.parametrize(("moved_m", "shown_m"), [(1.39, 1.39), (1.41, 1.4), (1.7, 1.4)])
def test_a_car_at_10_mps_moves_by_a_fifth_more_and_a_lane_changes_slide_at_most(moved_m: float, shown_m: float) -> None:
    assert moved((0.0, 0.0, 90.0, 10.0), (moved_m, 0.0, 90.0, 10.0)).front_m[0, 0] == pytest.approx(shown_m)


def test_an_agent_that_has_left_takes_its_row_along() -> None:
    cars = AgentKinematics(DT_S)
    cars.insert([0, 1, 2])
    cars.move([(0, 0), (10, 0), (20, 0)], [90, 80, 70], [1, 2, 3], np.full(3, 4.6))
    cars.keep([True, False, True])
    assert cars.front_m[:, 0].tolist() == [0, 20]
    cars.move([(0.1, 0), (20.3, 0)], [90, 69], [1, 3], np.full(2, 4.6))
    assert cars.turned_rad == {1: pytest.approx(np.radians(1.0))}


def test_one_that_enters_begins_where_sumo_says_and_the_others_move_on() -> None:
    cars = AgentKinematics(DT_S)
    cars.insert([0, 1])
    cars.move([(0, 0), (20, 0)], [90, 70], [1, 3], np.full(2, 4.6))
    cars.insert([1])
    cars.move([(0.1, 0), (500, 40), (20.3, 0)], [90, 200, 70], [1, 9, 3], np.full(3, 4.6))
    assert cars.front_m[:, 0].tolist() == [0.1, 500, 20.3]
    assert cars.heading_rad[1] == pytest.approx(np.radians(90.0 - 200.0))
    assert not cars.turned_rad


def on_a_left_turn(radius_m: float, speed_mps: float = 5.0) -> list[tuple[float, float, float, float]]:
    """Frames of SUMO's front on 20 m straight on and half a circle, with the angle of the lane."""
    frames: list[tuple[float, float, float, float]] = []
    for way_m in np.arange(0.0, 20.0 + pi * radius_m, DT_S * speed_mps).tolist():
        turned = max(0.0, way_m - 20.0) / radius_m
        x = min(way_m, 20.0) + radius_m * np.sin(turned)
        frames.append((float(x), float(radius_m * (1.0 - np.cos(turned))), 90.0 - float(np.degrees(turned)), speed_mps))
    return frames


def test_in_a_turn_the_front_axle_of_a_bus_goes_where_sumos_front_went_and_its_bumper_swings_out() -> None:
    bus = moved(*on_a_left_turn(15.0), length_m=BUS_M)
    along = np.array((np.cos(bus.heading_rad[0]), np.sin(bus.heading_rad[0])))
    bumper_m, axle_m, rear_m = (
        float(np.hypot(*(bus.front_m[0] - back_m * along - (20.0, 15.0)))) for back_m in (0.0, 2.4, 9.36)
    )
    assert axle_m == pytest.approx(15.0, abs=0.05)
    assert 15.5 < bumper_m < 16.5
    assert 13.0 < rear_m < 14.9  # a rod of 6.96 m that rolls on a circle would run at 13.3 m


@pytest.mark.parametrize(("length_m", "swings"), [(6.4, False), (6.6, True)])
def test_vehicles_up_to_a_van_steer_at_their_bumper(length_m: float, swings: bool) -> None:
    frames = on_a_left_turn(15.0)
    (shown,) = moved(*frames, length_m=length_m).front_m
    assert bool(np.hypot(*(shown - frames[-1][:2])) > 0.1) is swings


def test_straight_on_a_bus_is_where_sumo_has_it_to_the_millimetre_and_after_a_stop_as_well() -> None:
    frames = [(0.5 * k, 0.0, 90.0, 5.0) for k in range(40)]
    frames += [(19.5, 0.0, 90.0, 0.0)] * 30 + [(19.5 + 0.5 * k, 0.0, 90.0, 5.0) for k in range(1, 20)]
    for upto in (1, 2, 40, 70, 89):
        assert moved(*frames[:upto], length_m=BUS_M).front_m[0] == pytest.approx(frames[upto - 1][:2], abs=1e-3)
