"""A road unrolled along the route, and the lanes that one may use."""

from __future__ import annotations

import numpy as np
import pytest
from stages import ONE_LANE, TWO_LANES, car, staged
from worlds import LANE_WIDTH_M, curved_road

from interplan_sumo.errors import ScenarioError
from interplan_sumo.proving.course import course
from interplan_sumo.scenario.scenario import LanePlace


def test_places_come_back_from_being_unrolled() -> None:
    roads = curved_road(radius_m=40.0, run_in_m=60.0)
    unrolled = course(staged(start=LanePlace("11", 10.0), goal=LanePlace("11", 150.0)), roads)
    left = np.full(len(unrolled.arc_m), 1.2)
    xy = unrolled.points(left)
    rows = slice(30, -160)  # beyond the goal the road ends
    arc, aside, _ = unrolled.unrolled(xy[rows])
    assert arc == pytest.approx(unrolled.arc_m[rows], abs=0.1)
    assert aside == pytest.approx(left[rows], abs=0.02)


def test_the_goal_is_as_far_from_the_start_as_along_the_lane() -> None:
    unrolled = course(staged(), ONE_LANE)
    assert unrolled.goal_m - unrolled.start_m == pytest.approx(180.0)


def test_a_lane_beside_is_of_use_only_where_something_stands_in_the_way() -> None:
    free, blocked = staged(), staged(obstacles=(car(100.0),))
    assert [track.lanes for track in course(free, TWO_LANES).tracks] == [("11",)]
    assert [track.lanes for track in course(blocked, TWO_LANES).tracks] == [("11",), ("12",)]


def test_tracks_side_by_side_are_neighbours_and_know_the_goal() -> None:
    unrolled = course(staged(goal=LanePlace("12", 200.0)), TWO_LANES)
    own, goal = unrolled.tracks
    assert not own.at_goal
    assert goal.at_goal
    assert unrolled.start_track == 0
    inside = np.isfinite(own.left_m) & np.isfinite(goal.left_m)
    assert unrolled.neighbours(0, 1)[inside].all()
    assert own.left_m[inside] == pytest.approx(LANE_WIDTH_M)


def test_a_goal_behind_the_start_is_refused() -> None:
    with pytest.raises(ScenarioError, match="behind the start"):
        course(staged(start=LanePlace("11", 220.0)), ONE_LANE)
