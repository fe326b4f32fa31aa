"""A road unrolled along the route, and the lanes that one may use."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stages import ONE_LANE, TWO_LANES, car, staged
from worlds import LANE_WIDTH_M, curved_road, junction, road_along, straight_road

from interplan_sumo.errors import ScenarioError
from interplan_sumo.scenario.scenario import LanePosition
from interplan_sumo.verification.corridor import WITHOUT_LIMIT_MPS, FrenetCorridor, frenet_corridor
from interplan_sumo.verification.drivable_paths import headings_of
from interplan_sumo.world.geometry import Floats, Polyline


def test_places_come_back_from_being_unrolled() -> None:
    roads = curved_road(radius_m=40.0, run_in_m=60.0)
    unrolled = frenet_corridor(staged(start=LanePosition("11", 10.0), goal=LanePosition("11", 150.0)), roads)
    left = np.full(len(unrolled.arc_m), 1.2)
    xy = unrolled.points(left)
    rows = slice(30, -160)  # beyond the goal the road ends
    arc, aside, _ = unrolled.unrolled(xy[rows])
    assert arc == pytest.approx(unrolled.arc_m[rows], abs=0.1)
    assert aside == pytest.approx(left[rows], abs=0.02)


def sharpest_per_m(unrolled: FrenetCorridor) -> float:
    xy = unrolled.points(np.zeros(len(unrolled.arc_m)))
    return float(np.abs(np.diff(headings_of(xy)) / np.hypot(*np.diff(xy, axis=0).T)).max())


def kinked(angle_rad: float) -> FrenetCorridor:
    """A road of two straight pieces, the kink 60 m from its start."""
    corner: Floats = np.array((60.0, 0.0))
    end = corner + 60.0 * np.array((np.cos(angle_rad), np.sin(angle_rad)))
    roads = road_along(Polyline(np.stack((np.zeros(2), corner, end))), limit_mps=13.9)
    return frenet_corridor(staged(start=LanePosition("11", 10.0), goal=LanePosition("11", 110.0)), roads)


@given(angle_deg=st.floats(-12.0, 12.0))
def test_a_kink_in_a_lane_is_driven_as_a_bend_near_it(angle_deg: float) -> None:
    unrolled = kinked(np.radians(angle_deg))
    xy = unrolled.points(np.zeros(len(unrolled.arc_m)))
    _, aside, _ = unrolled.unrolled(xy)
    assert np.abs(aside).max() <= 0.2
    assert sharpest_per_m(unrolled) <= np.radians(abs(angle_deg)) / 3.0 + 1e-9


@pytest.mark.parametrize("radius_m", [12.0, 40.0])
def test_a_bend_keeps_its_place_and_its_radius(radius_m: float) -> None:
    roads = curved_road(radius_m=radius_m, run_in_m=60.0)
    unrolled = frenet_corridor(staged(start=LanePosition("11", 10.0), goal=LanePosition("11", 75.0)), roads)
    _, aside, _ = unrolled.unrolled(unrolled.points(np.zeros(len(unrolled.arc_m))))
    assert np.abs(aside[:-20]).max() <= 0.1
    assert sharpest_per_m(unrolled) == pytest.approx(1.0 / radius_m, rel=0.15)


@pytest.mark.parametrize(("known_mps", "driven_mps"), [(None, WITHOUT_LIMIT_MPS), (10.0, 10.0)])
def test_the_usual_limit_stands_in_where_the_map_knows_none(known_mps: float | None, driven_mps: float) -> None:
    found = frenet_corridor(staged(), straight_road(length_m=300.0, limit_mps=known_mps)).lane_paths[0]
    assert set(found.limit_mps.tolist()) == {driven_mps}


def test_the_goal_is_as_far_from_the_start_as_along_the_lane() -> None:
    unrolled = frenet_corridor(staged(), ONE_LANE)
    assert unrolled.goal_m - unrolled.start_m == pytest.approx(180.0)


def test_a_lane_beside_is_of_use_only_where_something_stands_in_the_way() -> None:
    free, blocked = staged(), staged(obstacles=(car(100.0),))
    assert [lane_path.lanes for lane_path in frenet_corridor(free, TWO_LANES).lane_paths] == [("11",)]
    assert [lane_path.lanes for lane_path in frenet_corridor(blocked, TWO_LANES).lane_paths] == [("11",), ("12",)]


def test_tracks_side_by_side_are_neighbours_and_know_the_goal() -> None:
    roads = straight_road(lanes=3, length_m=300.0)
    unrolled = frenet_corridor(staged(start=LanePosition("11", 3.0), goal=LanePosition("13", 200.0)), roads)
    own, middle, goal = unrolled.lane_paths
    assert [lane_path.at_goal for lane_path in unrolled.lane_paths] == [False, False, True]
    assert unrolled.start_path == 0
    assert own.left_m == pytest.approx(2 * LANE_WIDTH_M)  # behind the road's beginning, too, where the ego's rear is
    inside = np.isfinite(middle.left_m) & np.isfinite(goal.left_m)
    assert np.isnan(middle.left_m[0])
    assert unrolled.neighbours(0, 1)[inside].all()
    assert not unrolled.neighbours(0, 2)[inside].any()


def test_a_corridor_may_begin_inside_a_junction() -> None:
    roads = junction()
    path = next(iter(roads.connectors.values()))
    start, goal = LanePosition(path.id, 3.0), LanePosition(path.to_lane_id, 40.0)
    route = roads.route_through((path.id, path.to_lane_id))
    found = frenet_corridor(staged(start=start, goal=goal, route=route), roads)
    assert found.lane_paths[found.start_path].lanes == (path.id, path.to_lane_id)
    assert found.lane_paths[found.start_path].at_goal


def test_a_goal_behind_the_start_is_refused() -> None:
    with pytest.raises(ScenarioError, match="behind the start"):
        frenet_corridor(staged(start=LanePosition("11", 220.0)), ONE_LANE)
