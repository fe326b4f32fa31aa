"""GameFormer's reference path: candidates along the route, which of them is followed, and how fast at most."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from interplan_learned.gameformer.candidates import JOINS_M, CandidatePaths, joined
from interplan_learned.gameformer.reference import (
    BEND_PER_M,
    LOOKED_AT_M,
    ROOM_M,
    ReferencePath,
    ReferencePaths,
    largest_curvature,
    reference_path,
)
from interplan_sumo import tiny_worlds
from interplan_sumo.features.frame import EgoFrame
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.world.actors import Actors
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Polyline, Pose
from interplan_sumo.world.roads import StopLine, StopLineKind

BESIDE_M = tiny_worlds.LANE_WIDTH_M


def mission(lanes: int = 1, limit_mps: float | None = 15.0) -> Mission:
    return tiny_worlds.mission(tiny_worlds.straight_road(lanes, limit_mps=limit_mps), ["11"])


def at(x_m: float, y_m: float = 0.0, speed_mps: float = 8.0, actors: Actors | None = None) -> Observation:
    """The rear axle at a place, heading along the road."""
    return tiny_worlds.observation(tiny_worlds.ego(x_m + PACIFICA.rear_axle_to_center_m, y_m, speed_mps), actors)


def found(where: Mission, observation: Observation) -> ReferencePath:
    path = ReferencePaths(where).at(observation)
    assert path is not None
    return path


def test_a_join_leaves_along_the_ego_and_arrives_along_the_way() -> None:
    way = tiny_worlds.straight_road().lanes["11"].centerline
    line = Polyline(joined(Pose(20.0, 2.0, 0.3), way, 20.0, 10.0))
    start, end = line.pose_at(0.0), line.pose_at(line.project_point(31.0, 0.0)[0])
    assert (start.x_m, start.y_m) == pytest.approx((20.0, 2.0))
    assert start.heading_rad == pytest.approx(0.3, abs=0.1)
    assert (end.y_m, end.heading_rad) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert line.points[-1, 0] == pytest.approx(140.0)  # 120 m of the way


def test_each_way_is_joined_at_several_distances() -> None:
    paths = CandidatePaths(mission(lanes=2))
    here = Pose(30.0, 0.0, 0.0)
    under = paths.block_under(here)
    assert under is not None
    candidates = paths.of(here, *under)
    assert [each.lanes for each in candidates] == [("11",)] * len(JOINS_M) + [("12",)] * len(JOINS_M)
    assert candidates[-1].beside_m == pytest.approx(BESIDE_M)
    np.testing.assert_allclose([each.length_m for each in candidates], 170.0)


@pytest.mark.parametrize(("left_m", "joins"), [(21.0, 4), (19.0, 3), (6.0, 1), (2.0, 1), (0.5, 0)])
def test_near_the_end_of_the_route_there_are_fewer_joins(left_m: float, joins: int) -> None:
    paths = CandidatePaths(mission())
    here = Pose(200.0 - left_m, 0.0, 0.0)
    under = paths.block_under(here)
    assert under is not None
    assert len(paths.of(here, *under)) == joins
    assert (ReferencePaths(mission()).at(at(200.0 - left_m)) is None) is (joins == 0)


def test_off_the_route_there_is_no_path() -> None:
    edge_m = tiny_worlds.LANE_WIDTH_M / 2.0
    paths = ReferencePaths(mission())
    assert paths.at(at(30.0, edge_m + 4.9)) is not None
    assert paths.at(at(30.0, edge_m + 5.1)) is None


def test_ways_stay_on_the_route_at_a_junction() -> None:
    roads = tiny_worlds.junction()
    paths = CandidatePaths(tiny_worlds.mission(roads, ["1", "14", "8"]))
    start = roads["1"].centerline.pose_at(40.0)
    under = paths.block_under(start)
    assert under is not None
    assert {each.lanes for each in paths.of(start, *under)} == {("1", "14", "8")}


def test_without_anything_in_the_way_it_stays_in_its_lane() -> None:
    path = found(mission(lanes=3), at(30.0, -BESIDE_M)).path
    assert path.length_m == pytest.approx(120.0, abs=0.1)
    np.testing.assert_allclose(path.line.points[:, 1], 0.0, atol=1e-6)


@pytest.mark.parametrize(("lane_y_m", "left_m"), [(-BESIDE_M, BESIDE_M), (0.0, -BESIDE_M)])
def test_it_goes_around_a_standing_car_through_the_neighbour_lane(lane_y_m: float, left_m: float) -> None:
    where = mission(lanes=2)
    path = found(where, at(30.0, lane_y_m, actors=tiny_worlds.cars((50.0, lane_y_m)))).path
    assert path.line.pose_at(60.0).y_m == pytest.approx(left_m, abs=0.01)


@pytest.mark.parametrize(("spare_m", "stays"), [(0.1, True), (-0.1, False)])
def test_it_follows_a_car_that_drives_unless_it_is_already_close(spare_m: float, stays: bool) -> None:
    rear_m = 30.0 + LOOKED_AT_M / 2.0 + ROOM_M + PACIFICA.width_m / 2.0 + spare_m
    cars = tiny_worlds.cars((rear_m + 2.4, 0.0, 1.0), length_m=4.8)
    path = found(mission(lanes=2), at(30.0, actors=cars)).path
    assert (abs(path.line.pose_at(60.0).y_m) < 0.1) is stays


@pytest.mark.parametrize(("lanes", "speed_mps", "stays"), [(4, 3.0, True), (4, 3.1, False), (3, 3.0, False)])
def test_in_slow_traffic_on_a_wide_road_it_does_not_go_around(lanes: int, speed_mps: float, stays: bool) -> None:
    path = found(mission(lanes), at(30.0, speed_mps=speed_mps, actors=tiny_worlds.cars((50.0, 0.0)))).path
    assert (abs(path.line.pose_at(60.0).y_m) < 0.1) is stays


@pytest.mark.parametrize(("x_m", "stays"), [(41.0, True), (39.0, False)])
def test_near_a_traffic_light_it_does_not_go_around(x_m: float, stays: bool) -> None:
    roads = tiny_worlds.straight_road(2, 300.0, cuts_m=((100.0, 120.0),))
    light = StopLine("1", shapely.box(99.0, -5.0, 100.0, 2.0), StopLineKind.TRAFFIC_LIGHT)
    connectors = {lane: replace(each, stop_line_ids=("1",)) for lane, each in roads.connectors.items()}
    lit = replace(roads, connectors=connectors, stop_lines={"1": light})
    where = tiny_worlds.mission(lit, ["11", "21", "31"])
    path = found(where, at(x_m, actors=tiny_worlds.cars((x_m + 20.0, 0.0)))).path
    assert (abs(path.line.pose_at(60.0).y_m) < 0.1) is stays


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("radius_m", "is_sharp"), [(8.0, True), (13.0, False)])
def test_from_a_sharp_bend_on_three_metres_per_second_are_aimed_at(
    side: float, radius_m: float, is_sharp: bool
) -> None:
    line = tiny_worlds.curved_road(radius_m, side * 1.5, run_in_m=30.0).lanes["11"].centerline
    assert (largest_curvature(line) > BEND_PER_M) is is_sharp
    path = reference_path(line.points, EgoFrame(0.0, 0.0, 0.0), 12.0)
    assert set(path.cap_mps.tolist()) == ({3.0, 12.0} if is_sharp else {12.0})
    if is_sharp:
        bend_m = float(path.path.line.arc_m[path.cap_mps < 12.0][0])
        assert bend_m == pytest.approx(30.0, abs=2.5)
        assert path.cap_at(np.array((0.0, bend_m + 0.01, 500.0))).tolist() == [12.0, 3.0, 3.0]


@pytest.mark.parametrize(("limit_mps", "cap_mps"), [(None, 13.0), (10.0, 10.0), (25.0, 15.0), (1.0, 3.0)])
def test_the_cap_is_the_limit_within_bounds(limit_mps: float | None, cap_mps: float) -> None:
    assert set(found(mission(limit_mps=limit_mps), at(30.0)).cap_mps.tolist()) == {cap_mps}


def test_the_path_is_in_the_ego_frame() -> None:
    ego = tiny_worlds.ego(30.0, 1.0, 5.0, heading_rad=0.2)
    path = found(mission(), tiny_worlds.observation(ego)).path.line
    start, later = path.pose_at(0.0), path.pose_at(60.0)
    assert (start.x_m, start.y_m) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert start.heading_rad == pytest.approx(0.0, abs=0.1)
    assert later.heading_rad == pytest.approx(-0.2, abs=1e-3)  # the road turns right, seen from the ego
    assert EgoFrame.of(ego).to_map(np.array((later.x_m, later.y_m, 0.0)))[1] == pytest.approx(0.0, abs=1e-6)
