"""Map features: lanes, boundaries, lights, stop lines and crosswalks on roads made by hand."""

from __future__ import annotations

from dataclasses import replace
from math import hypot, pi
from typing import Any

import numpy as np
import pytest
import shapely
from worlds import ego, ego_on, junction, mission, observation, signals, straight_road

from interplan_sumo.features.map_lines import map_lines
from interplan_sumo.features.schema import channel_index
from interplan_sumo.features.view import EgoView
from interplan_sumo.world.roads import Area, DrivingSide, Roads
from interplan_sumo.world.signals import Signals

REAR_M = 1.461  # PACIFICA's rear axle behind its centre
LIGHTS = slice(channel_index("lanes", "light_green"), channel_index("lanes", "light_none") + 1)
CHANGES = channel_index("lanes", "lane_changes")
TWO_LANES = straight_road(lanes=2)  # lane 11 on the x axis, lane 12 at y = -3.5, both 200 m long
CROSSING = junction()


def two_lanes(goal_lane: str = "11") -> dict[str, Any]:
    """From lane 12, 50 m down the road."""
    return EgoView(mission(TWO_LANES, (goal_lane,))).arrays(observation(ego(50.0, -3.5)))


def at_crossing(roads: Roads = CROSSING, lights: Signals | None = None) -> dict[str, Any]:
    """From 10 m before the end of lane 1, which comes in from the west; straight on."""
    asked = mission(roads, ("1", "13", "7"))
    return EgoView(asked).arrays(observation(ego_on(roads, "1", 50.0), signals=lights))


def rows_of(arrays: dict[str, Any], lane: int) -> list[int]:
    return np.flatnonzero(arrays["lane_ids"] == lane).tolist()


def test_lanes_come_in_pieces_of_fifty_metres_the_nearest_first() -> None:
    arrays = two_lanes()
    # The rear axle is at 48.539 m: in the first piece of lane 12, 1.461 m before the second. The fourth ones are
    # 101.461 m away, which is too far.
    assert arrays["lane_ids"][:7].tolist() == [12, 12, 11, 11, 12, 11, 0]
    assert arrays["lane_starts"][:7].tolist() == [0.0, 50.0, 0.0, 50.0, 100.0, 100.0, 0.0]
    assert arrays["lanes_valid"].tolist() == [True] * 6 + [False] * 54
    assert not arrays["stop_lines_valid"].any()  # this map has no areas
    assert not arrays["crosswalks_valid"].any()
    assert (arrays["lanes"][6:] == 0.0).all()


def test_every_number_of_a_point_of_a_lane() -> None:
    lanes = two_lanes()["lanes"]
    np.testing.assert_allclose(
        lanes[2, 0], (-50.0 + REAR_M, 3.5, 0.0, 1.75, 15.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0), atol=1e-5
    )  # lane 11 lies to the left and leads to the goal
    np.testing.assert_allclose(
        lanes[0, 49], (REAR_M, 0.0, 0.0, 1.75, 15.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0), atol=1e-5
    )  # lane 12 needs one change
    np.testing.assert_allclose(np.diff(lanes[0, :, 0]), 50.0 / 49.0, atol=1e-5)


def test_boundaries_lie_left_and_right_of_their_piece() -> None:
    arrays = two_lanes()
    np.testing.assert_allclose(arrays["left_boundaries"][0, :, 1], 1.75, atol=1e-5)
    np.testing.assert_allclose(arrays["right_boundaries"][0, :, 1], -1.75, atol=1e-5)
    np.testing.assert_allclose(arrays["left_boundaries"][1, [0, 19], 0], (REAR_M, 50.0 + REAR_M), atol=1e-4)


@pytest.mark.parametrize(("length_m", "pieces"), [(50.0, 1), (50.1, 2), (100.0, 2), (101.0, 3)])
def test_a_lane_is_cut_into_equal_pieces_of_at_most_fifty_metres(length_m: float, pieces: int) -> None:
    lines = map_lines(straight_road(length_m=length_m))
    np.testing.assert_allclose(lines.pieces.start_m, np.arange(pieces) * length_m / pieces)


def test_a_map_without_a_limit_has_the_usual_one() -> None:
    road = straight_road(limit_mps=None)
    arrays = EgoView(mission(road, ("11",))).arrays(observation(ego_on(road, "11", 20.0)))
    assert arrays["lanes"][0, 0, 4] == pytest.approx(13.89)
    assert arrays["speed_limit"] == pytest.approx(13.89)


def test_lanes_off_the_route_say_so() -> None:
    arrays = at_crossing()
    (oncoming, *_) = rows_of(arrays, 5)
    assert arrays["lanes"][oncoming, 0, CHANGES - 1 :].tolist() == [0.0, -1.0]


@pytest.mark.parametrize(("side", "oncoming_y"), [("right", 3.5), ("left", -3.5)])
def test_oncoming_lanes_are_dead_against_and_turning_left_is_a_positive_yaw_wherever_one_drives(
    side: DrivingSide, oncoming_y: float
) -> None:
    arrays = at_crossing(junction(driving_side=side))
    oncoming = arrays["lanes"][rows_of(arrays, 5)[0]]
    np.testing.assert_allclose(oncoming[:, 1], oncoming_y, atol=1e-4)
    np.testing.assert_allclose(oncoming[:, 2], pi, atol=1e-4)
    for connector, yaw in ((14, pi / 2), (12, -pi / 2), (13, 0.0)):
        assert arrays["lanes"][rows_of(arrays, connector)[0], -1, 2] == pytest.approx(yaw, abs=0.05), connector


def test_lights_are_those_of_the_connectors_and_lanes_have_none() -> None:
    arrays = at_crossing(lights=signals(red=("13",), green=("12",), yellow=("14",)))
    for lane, light in ((12, 0), (14, 1), (13, 2), (31, 3), (1, 3)):
        expected = [float(k == light) for k in range(4)]
        assert arrays["lanes"][rows_of(arrays, lane)[0], :, LIGHTS].tolist() == [expected] * 50, lane


def test_a_light_of_a_connector_that_the_map_does_not_have_is_nobodys() -> None:
    np.testing.assert_array_equal(at_crossing(lights=signals(red=("9999",)))["lanes"], at_crossing()["lanes"])


def test_equally_near_pieces_go_by_id() -> None:
    arrays = at_crossing()
    # The connectors 12, 13 and 14 all begin where lane 1 ends.
    assert [lane for lane in arrays["lane_ids"].tolist() if lane in (12, 13, 14)] == [12, 13, 14]


def test_a_stop_line_is_its_outline_counter_clockwise() -> None:
    arrays = at_crossing()
    outline = arrays["stop_lines"][0]
    # Across lane 1 (y from -3.5 to 0) between x = -13 and -12; the rear axle is at (-22 - 1.461, -1.75).
    np.testing.assert_allclose(outline.min(axis=0), (9.0 + 1.0 + REAR_M - 1.0, -1.75), atol=0.2)
    np.testing.assert_allclose(outline.max(axis=0), (9.0 + 1.0 + REAR_M, 1.75), atol=0.2)
    x, y = outline.T
    assert (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() > 0.0
    assert hypot(*(outline[0] - outline[-1])) > 0.3  # the first point is not repeated
    assert arrays["stop_lines_valid"].tolist() == [True] * 4 + [False] * 16


def test_crosswalks_within_a_hundred_metres_are_there() -> None:
    walks = (Area("1", shapely.box(-10.0, -3.0, -8.0, 3.0)), Area("2", shapely.box(-22.0, 99.0, -20.0, 105.0)))
    arrays = at_crossing(replace(CROSSING, crosswalks=walks))
    assert arrays["crosswalks_valid"].tolist() == [True] + [False] * 19
    x, y = arrays["crosswalks"][0].T
    assert 12.0 + REAR_M - 1e-4 <= x.min() < x.max() <= 14.0 + REAR_M + 1e-4
    assert -3.0 + 1.75 - 1e-4 <= y.min() < y.max() <= 3.0 + 1.75 + 1e-4
    assert (arrays["crosswalks"][1:] == 0.0).all()
