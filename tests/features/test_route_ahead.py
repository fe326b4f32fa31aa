"""Route ahead: the line to follow, the lanes of the route, and the lane changes that are left."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np
import pytest
from worlds import curved_road, ego, ego_on, junction, mission, observation, straight_road

from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.features.map_lines import map_lines
from interplan_sumo.features.view import EgoView, RouteAhead
from interplan_sumo.planner import Mission
from interplan_sumo.world.ego import EgoState
from interplan_sumo.world.geometry import Pose

REAR_M = 1.461  # PACIFICA's rear axle behind its centre
THREE_LANES = straight_road(lanes=3, length_m=300.0, cuts_m=((140.0, 160.0),))


def arrays(asked: Mission, at: EgoState) -> dict[str, Any]:
    return EgoView(asked).arrays(observation(at))


def ahead(asked: Mission) -> RouteAhead:
    return RouteAhead(asked, map_lines(asked.roads))


def test_the_line_begins_beside_the_rear_axle_and_has_a_point_every_metre() -> None:
    found = arrays(mission(THREE_LANES, ("12", "22", "32")), ego(20.0, -3.0))
    line = found["route_centerline"]
    assert found["route_centerline_valid"].all()
    np.testing.assert_allclose(line[:, 0], np.arange(120.0), atol=1e-4)
    np.testing.assert_allclose(line[:, 1], -0.5, atol=1e-4)  # half a metre to the right
    np.testing.assert_allclose(line[:, 2], 0.0, atol=1e-5)
    # also where the centre is on the next lane already, and where the ego is on another lane than the goal
    line = arrays(mission(THREE_LANES, ("12", "22", "32")), ego(140.7, -3.5))["route_centerline"]
    np.testing.assert_allclose(line[:3, 0], (0.0, 1.0, 2.0), atol=1e-4)
    line = arrays(mission(THREE_LANES, ("11", "21", "31")), ego(20.0, -7.0))["route_centerline"]
    np.testing.assert_allclose(line[:, 1], 0.0, atol=1e-4)


def test_beyond_the_end_of_the_route_it_is_empty() -> None:
    found = arrays(mission(THREE_LANES, ("12", "22", "32")), ego(250.0 + REAR_M, -3.5))
    assert found["route_centerline_valid"].sum() == 51  # 0 to 50 m
    assert (found["route_centerline"][51:] == 0.0).all()


def test_it_bends_left_with_a_positive_yaw() -> None:
    road = curved_road(radius_m=40.0, angle_rad=pi / 2, run_in_m=40.0)
    line = arrays(mission(road, ("11",)), ego(REAR_M, 0.0))["route_centerline"]
    assert line[102, 2] == pytest.approx(0.0 + pi / 2, abs=0.05)  # 40 m straight, 63 m of bend
    assert line[60, 1] > 4.0
    roads = junction()
    turn = arrays(mission(roads, ("1", "14", "8")), ego_on(roads, "1", 55.0))
    assert turn["route_centerline"][turn["route_centerline_valid"]][-1, 2] == pytest.approx(pi / 2, abs=0.01)


def test_off_all_lanes_the_nearest_lane_of_the_route_counts() -> None:
    route = ahead(mission(THREE_LANES, ("12", "22", "32")))
    assert route.lane_under(EgoFrame(20.0, 30.0, 0.0)) == "11"
    assert route.lane_under(EgoFrame(20.0, -30.0, 0.0)) == "13"


def test_of_lanes_on_top_of_each_other_the_one_along_the_ego_counts() -> None:
    roads = junction()
    asked = Mission(roads, ("1", "13", "7", "2", "24", "8"), Pose(60.0, -1.75, 0.0))
    east, north = EgoFrame(1.75, -1.75, 0.0), EgoFrame(1.75, -1.75, pi / 2)
    assert ahead(asked).lane_under(east) == "13"
    assert ahead(asked).lane_under(north) == "24"


def test_route_lanes_are_the_pieces_of_the_route_the_nearest_first() -> None:
    roads = junction()
    found = arrays(mission(roads, ("1", "13", "7")), ego_on(roads, "1", 50.0 + REAR_M))
    # Lane 1 is 60 m, so two pieces of 30 m; the connector begins 10 m ahead, lane 7 24 m farther on, in two pieces.
    assert found["route_lanes_valid"].tolist() == [True] * 5 + [False] * 5
    np.testing.assert_allclose(found["route_lanes"][:5, 0, 0], (-20.0, 10.0, -50.0, 34.0, 64.0), atol=1e-4)
    np.testing.assert_allclose(found["route_lanes"][:5, :, 1], 0.0, atol=1e-4)


def test_each_lane_between_here_and_the_goal_is_a_change() -> None:
    route = ahead(mission(THREE_LANES, ("13", "23", "33")))
    lines = map_lines(THREE_LANES)
    changes = dict(zip(lines.lane_ids.tolist(), route.lane_changes.tolist(), strict=True))
    assert changes == {11: 2, 12: 1, 13: 0, 21: 2, 22: 1, 23: 0, 31: 2, 32: 1, 33: 0}


@pytest.mark.parametrize(("y_m", "lane"), [(0.0, "31"), (-3.5, "32"), (-7.0, "33")])
def test_the_goal_lane_is_the_one_whose_centre_line_holds_the_goal(y_m: float, lane: str) -> None:
    assert ahead(Mission(THREE_LANES, ("1", "2", "3"), Pose(280.0, y_m, 0.0))).goal_lane == lane


def test_a_goal_on_the_seam_of_two_lanes_is_on_the_later_one() -> None:
    roads = straight_road(lanes=1, length_m=300.0, cuts_m=((140.0, 160.0),))
    assert ahead(Mission(roads, ("1", "2", "3"), Pose(160.0, 0.0, 0.0))).goal_lane == "31"
