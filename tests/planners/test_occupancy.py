from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import cars, ego, observation, pedestrians, straight_road, together

from interplan_planners.common.forecast import STEP_S, constant_velocity, nearest
from interplan_planners.common.neighbours import moved, queue_on, stands_for_good
from interplan_planners.common.neighbours import together as joined
from interplan_planners.common.occupancy import Strip, occupancies, occupancy
from interplan_planners.common.paths import DrivingPath, shifted
from interplan_sumo.planner import Past
from interplan_sumo.world.actors import ActorKind, Actors
from tests.planners.staging_planners import crowd, polygons_at, wavy_line

LINE = wavy_line()
LANE = DrivingPath(straight_road(length_m=300.0)["11"].centerline)


def test_agents_go_on_along_their_heading_and_cones_stay() -> None:
    cone = cars((5.0, 0.0, 3.0), kind=ActorKind.TRAFFIC_CONE, prefix="cone")
    forecast = constant_velocity(together(cars((10.0, 2.0, 5.0, 0.5)), cone), 1.0)
    assert forecast.x_m.shape == (2, 6)
    assert (forecast.x_m[0, 5], forecast.y_m[0, 5]) == pytest.approx((10 + 5 * np.cos(0.5), 2 + 5 * np.sin(0.5)))
    assert (forecast.x_m[1] == 5.0).all()
    assert forecast.stands.tolist() == [False, True]


def test_a_car_that_backs_goes_on_backwards() -> None:
    car = cars((0.0, 0.0, 0.0))
    backing = Actors(
        car.ids, car.kind, car.x_m, car.y_m, car.heading_rad, car.length_m, car.width_m, -2 * np.ones(1), car.vy_mps
    )
    forecast = constant_velocity(backing, 1.0)
    assert forecast.x_m[0, -1] == pytest.approx(-2.0)
    assert forecast.speed_mps[0, 0] == -2.0


def test_a_time_between_two_instants_takes_the_earlier() -> None:
    forecast = constant_velocity(cars((0.0, 0.0)), 2.0)
    assert forecast.instant([0.0, 0.19, 0.2, 0.6, 1.99, 50.0]).tolist() == [0, 0, 1, 3, 9, 10]


def test_a_part_of_a_forecast_begins_later() -> None:
    forecast = constant_velocity(cars((0.0, 0.0, 10.0)), 4.0).between(2.0, 3.0)
    assert forecast.x_m[0] == pytest.approx(20.0 + 10.0 * STEP_S * np.arange(6))


def test_the_nearest_of_each_class_are_kept() -> None:
    far = [(100.0 + i, 0.0) for i in range(60)]
    actors = together(cars(*far), pedestrians(*[(50.0 + i, 5.0) for i in range(30)]))
    kept = nearest(actors, 0.0, 0.0)
    assert (kept.kind == ActorKind.VEHICLE).sum() == 50
    assert (kept.kind == ActorKind.PEDESTRIAN).sum() == 25
    assert kept.x_m[kept.kind == ActorKind.VEHICLE].max() == 149.0


@settings(max_examples=8)
@given(seed=st.integers(0, 2**31))
def test_many_strips_at_once_hold_who_each_of_them_holds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    forecast = crowd(rng, 30, LINE)
    long = rng.random(30) < 0.3
    forecast = replace(forecast, length_m=np.where(long, 12.0, forecast.length_m))
    strips = [
        Strip(DrivingPath(shifted(LINE, left_m)), half_width_m, (start_m, start_m + reach_m), ignore)
        for left_m, half_width_m, start_m, reach_m, ignore in (
            (0.0, 1.2, 20.0, 90.0, None),
            (2.5, 0.8, 0.0, 20.0, rng.random(30) < 0.5),
            (-1.0, 1.2, 60.0, 300.0, None),
            (0.0, 1.9, -5.0, 3.0, None),
        )
    ]
    for strip, found in zip(strips, occupancies(strips, forecast), strict=True):
        alone = occupancy(strip.path, strip.half_width_m, forecast, strip.between_m, strip.ignore)
        assert found.rows.tolist() == alone.rows.tolist()
        for name in ("near_m", "far_m", "center_m", "speed_mps"):
            assert np.array_equal(getattr(found, name), getattr(alone, name), equal_nan=True)


@settings(max_examples=8)
@given(seed=st.integers(0, 2**31))
def test_a_box_occupies_the_path_where_shapely_says_so(seed: int) -> None:
    forecast = crowd(np.random.default_rng(seed), 40, LINE)
    start_m, end_m, half_width_m = 20.0, 120.0, 1.2
    found = occupancy(DrivingPath(LINE), half_width_m, forecast, (start_m, end_m))
    strip = LINE.between(start_m, end_m).linestring.buffer(half_width_m, cap_style="flat", quad_segs=16)
    for k in range(0, forecast.instants, 5):
        boxes = polygons_at(forecast, k)
        overlap_m2 = shapely.area(shapely.intersection(boxes, strip))
        seen = np.zeros(len(forecast), dtype=bool)
        seen[found.rows] = np.isfinite(found.near_m[:, k])
        # a box that only grazes the strip, or a long one on a bend, may go either way
        assert not (seen & (shapely.distance(boxes, strip) > 0.25)).any()
        assert not (~seen & (overlap_m2 > 0.25)).any()
        for b, row in enumerate(found.rows.tolist()):
            if seen[row] and overlap_m2[row] > 0.5:
                inside = shapely.intersection(boxes[row], LINE.linestring.buffer(half_width_m, cap_style="flat"))
                arcs = LINE.project(shapely.get_coordinates(inside))[0]
                close_m = 0.6 if forecast.length_m[row] < 6.0 else 1.0
                assert found.near_m[b, k] == pytest.approx(arcs.min(), abs=close_m)
                assert found.far_m[b, k] == pytest.approx(arcs.max(), abs=close_m)


def test_distances_and_speeds_on_a_straight_lane() -> None:
    forecast = constant_velocity(cars((50.0, 0.5, 5.0), (80.0, -1.0, 4.0, np.pi), (60.0, 3.5, 9.0)), 2.0)
    found = occupancy(LANE, 1.0, forecast, (0.0, 200.0))
    assert found.rows.tolist() == [0, 1]
    assert found.near_m[0] == pytest.approx(47.6 + 1.0 * np.arange(11))
    assert found.far_m[0, 0] == pytest.approx(52.4)
    assert found.center_m[0, 0] == pytest.approx(50.0)
    assert found.speed_mps[:, 0] == pytest.approx([5.0, -4.0])


@pytest.mark.parametrize(
    ("x_m", "y_m", "seen"), [(50.0, 1.99, True), (50.0, 2.01, False), (122.3, 0.0, True), (122.5, 0.0, False)]
)
def test_both_sides_of_the_strip_and_of_its_end(x_m: float, y_m: float, seen: bool) -> None:
    found = occupancy(LANE, 1.0, constant_velocity(cars((x_m, y_m)), 1.0), (20.0, 120.0))
    assert (len(found.rows) == 1) is seen


def test_those_to_ignore_are_left_out() -> None:
    forecast = constant_velocity(cars((50.0, 0.0), (70.0, 0.0)), 1.0)
    found = occupancy(LANE, 1.0, forecast, (0.0, 200.0), ignore=np.array([True, False]))
    assert found.rows.tolist() == [1]


def test_nobody_is_a_possible_answer() -> None:
    for forecast in (constant_velocity(Actors.none(), 2.0), constant_velocity(cars((50.0, 30.0)), 2.0)):
        found = occupancy(LANE, 1.0, forecast, (0.0, 200.0))
        assert found.near_m.shape == (0, 11)


def test_one_who_enters_later_is_there_later() -> None:
    walker = pedestrians((50.0, 4.0, 2.0, -np.pi / 2))
    found = occupancy(LANE, 1.0, constant_velocity(walker, 4.0), (0.0, 200.0))
    there = np.isfinite(found.near_m[0])
    assert there.nonzero()[0][[0, -1]].tolist() == [7, 13]  # y = 1.35 is reached after 1.325 s, y = -1.35 after 2.675 s


def test_occupancies_can_be_joined_and_moved() -> None:
    found = occupancy(LANE, 1.0, constant_velocity(cars((50.0, 0.0)), 1.0), (0.0, 200.0))
    both = joined(found, moved(found, 10.0))
    assert both.near_m[:, 0] == pytest.approx([47.6, 57.6])
    assert both.rows.tolist() == [0, 0]


def test_a_queue_is_sorted_from_back_to_front() -> None:
    queue = queue_on(
        LANE, 1.0, constant_velocity(cars((80.0, 0.0, 3.0), (20.0, 0.2, 7.0), (50.0, 6.0)), 2.0), (0.0, 200.0)
    )
    assert queue.rows.tolist() == [1, 0]
    assert queue.front_m == pytest.approx([22.4, 82.4])
    assert queue.speed_mps == pytest.approx([7.0, 3.0])
    assert [queue.ahead_of(arc_m) for arc_m in (10.0, 19.9, 20.1, 90.0)] == [0, 0, 1, 2]
    assert len(queue.only(np.array([False, True]))) == 1
    assert queue.only(np.array([False, False])).ahead_of(5.0) == 0


def test_what_has_not_moved_for_two_seconds_stands_for_good() -> None:
    stands, rolls = (50.0, 0.0), (70.0, 0.0, 0.5)
    cone = cars((90.0, 0.0), kind=ActorKind.TRAFFIC_CONE, prefix="cone")
    now = together(cars(stands, (70.0, 0.0)), cone)
    before = together(cars(stands, rolls), cone)
    past = Past((ego(),) * 20, (now,) * 12 + (before,) * 6 + (now,) * 2)
    assert stands_for_good(observation(ego(), now, past=past)).tolist() == [True, False, True]
    seen = observation(ego(), before, past=replace(past, actors=(now,) * 20))
    assert stands_for_good(seen).tolist() == [True, False, True]
