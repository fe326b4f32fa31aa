from __future__ import annotations

import numpy as np
import pytest
import shapely
from worlds import cars, curved_road, ego, junction, straight_road

from interplan_planners.common.corridor import Corridor
from interplan_planners.common.paths import braking_plan, centerline, plan_along
from interplan_planners.common.route_search import lane_chain, lanes_of_route, starting_lane
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import Polyline
from interplan_sumo.world.roads import Roads

ROAD = straight_road(lanes=2, length_m=200.0, cuts_m=((90.0, 100.0),))
ROUTE = ("1", "2", "3")
CROSSING = junction()


@pytest.mark.parametrize(
    ("route", "x_m", "y_m", "place"),
    [
        (ROUTE, 10.0, 0.0, (0, "11")),
        (ROUTE, 10.0, -3.0, (0, "12")),
        (ROUTE, 95.0, 0.5, (1, "21")),
        (ROUTE, 150.0, -4.0, (2, "32")),
        (ROUTE, 150.0, 9.0, (2, "31")),  # beside the road
        (("3",), 10.0, 0.0, (0, "31")),  # off the route
    ],
)
def test_the_ego_starts_on_the_nearest_lane_of_its_route(
    route: tuple[str, ...], x_m: float, y_m: float, place: tuple[int, str]
) -> None:
    assert starting_lane(ROAD, route, ego(x_m, y_m), PACIFICA) == place


@pytest.mark.parametrize(
    ("roads", "route", "first", "lane", "chain"),
    [
        (CROSSING, ("1", "14", "8"), 0, "1", ("1", "14", "8")),
        (CROSSING, ("1", "12", "6"), 0, "1", ("1", "12", "6")),
        (ROAD, ROUTE, 1, "22", ("22", "32")),
        (CROSSING, ("1", "14", "7"), 0, "1", ("1", "14")),  # the lane leaves the route early
        (CROSSING, ("1", "99"), 0, "1", ("1",)),
        (ROAD, ("1", "2", "3", "1"), 0, "11", ("11", "21", "31")),  # a block twice
    ],
)
def test_the_chain_follows_the_route_as_far_as_it_can(
    roads: Roads, route: tuple[str, ...], first: int, lane: str, chain: tuple[str, ...]
) -> None:
    assert lane_chain(roads, route, first, lane) == chain


def test_the_lanes_of_a_route_are_all_lanes_of_its_blocks() -> None:
    assert lanes_of_route(ROAD, ("1", "2")) == {"11", "12", "21", "22"}


def test_a_centre_line_runs_through_all_lanes() -> None:
    line = centerline(CROSSING, ("1", "14", "8"))
    assert line.length_m == pytest.approx(60.0 + 13.75 * np.pi / 2 + 60.0, abs=0.02)
    assert np.diff(line.arc_m).max() <= 1.0 + 1e-9


def test_a_plan_along_a_path_has_no_lateral_error() -> None:
    line = centerline(CROSSING, ("1", "14", "8"))
    plan = plan_along(line, [0.0, 1.0, 2.0], [55.0, 65.0, 500.0], [10.0, 10.0, 0.0])
    arc_m, left_m = line.project(np.stack((plan.x_m, plan.y_m), axis=1))
    assert left_m == pytest.approx(0.0, abs=1e-9)
    assert arc_m == pytest.approx([55.0, 65.0, line.length_m])


def test_a_braking_plan_stops_where_physics_says() -> None:
    plan = braking_plan(ego(speed_mps=9.0), 3.0, horizon_s=8.0, step_s=0.5)
    assert plan.x_m[-1] == pytest.approx(13.5)
    assert plan.speed_mps is not None
    assert plan.speed_mps[[0, 2, 6, 16]] == pytest.approx([9.0, 6.0, 0.0, 0.0])
    for speed in (0.0, -0.4):  # who stands or backs stays
        assert (braking_plan(ego(speed_mps=speed), 3.0, 8.0, 0.5).x_m == 0.0).all()


@pytest.mark.parametrize(
    ("x_m", "y_m", "inside"),
    [(50.0, 0.0, True), (50.0, 1.9, True), (50.0, 2.1, False), (50.0, -2.1, False), (-2.5, 0.0, False)],
)
def test_a_car_is_in_the_corridor_when_its_side_reaches_in(x_m: float, y_m: float, inside: bool) -> None:
    corridor = Corridor(ROAD["11"].centerline, half_width_m=1.0)
    assert bool(corridor.occupied_m(cars((x_m, y_m)).polygons)) is inside


def test_the_corridor_says_how_far_along_the_path_something_stands() -> None:
    corridor = Corridor(ROAD["11"].centerline, half_width_m=1.0)
    assert corridor.occupied_m(cars((20.0, 9.0), (50.5, 0.0)).polygons) == {1: ((48.0, 53.0),)}


def test_the_corridor_of_a_bend_has_no_gaps() -> None:
    line = curved_road(radius_m=10.0, run_in_m=20.0)["11"].centerline
    corridor = Corridor(line, half_width_m=1.1)
    for side in (-1.05, 0.0, 1.05):
        poses = [line.pose_at(arc_m, side) for arc_m in np.arange(20.5, 35.0, 0.05)]
        points = shapely.points([(pose.x_m, pose.y_m) for pose in poses])
        assert len(corridor.occupied_m(points)) == len(poses)


@pytest.mark.parametrize(("gap_m", "inside"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("heading_rad", [0.0, 2.5])
def test_the_corridor_ends_half_its_width_beyond_the_path(heading_rad: float, gap_m: float, inside: bool) -> None:
    line = Polyline(10.0 * np.outer((0.0, 1.0, 2.0), (np.cos(heading_rad), np.sin(heading_rad))))
    along_m = 20.0 + gap_m + 2.4  # the middle of a car that stands beyond the end
    x_m, y_m = along_m * np.cos(heading_rad), along_m * np.sin(heading_rad)
    occupied = Corridor(line, half_width_m=1.0).occupied_m(cars((x_m, y_m, 0.0, heading_rad)).polygons)
    assert occupied == ({0: ((10.0, 20.0),)} if inside else {})


def test_what_stands_where_the_path_comes_by_twice_occupies_two_stretches() -> None:
    figure = Polyline(np.array([(0.0, 0.0), (40.0, 0.0), (40.0, 20.0), (20.0, 20.0), (20.0, -20.0)])).resampled(1.0)
    (stretches,) = Corridor(figure, half_width_m=1.0).occupied_m(cars((20.0, 0.0)).polygons).values()
    assert len(stretches) == 2
    assert stretches[0] == pytest.approx((17.0, 23.0), abs=1.1)
    assert stretches[1] == pytest.approx((98.0, 102.0), abs=1.1)
