from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from worlds import cars, ego, junction, pedestrians, straight_road

from interplan_planners.common.comfort import comfortable
from interplan_planners.common.contacts import contacts, touched_now
from interplan_planners.common.forecast import Forecast, constant_velocity
from interplan_planners.common.ground import Ground
from interplan_planners.common.paths import DrivingPath
from interplan_planners.common.route_search import lanes_of_route
from interplan_planners.common.scoring import LOOK_AHEAD_S, Scores, Weights, places, score
from interplan_sumo.dynamics.batch import SimulatedDrives
from interplan_sumo.metrics.comfort_signals import derivative, smoothed, unwrapped
from interplan_sumo.world.actors import ActorKind, Actors
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.geometry import wrap_angle
from tests.planners.staging_planners import crowd, drives_along, ego_boxes, polygons_at, straight_drives, wavy_line

LINE = wavy_line()
ROAD = straight_road(lanes=2, length_m=400.0, cuts_m=((200.0, 215.0),))
GROUND = Ground(ROAD, lanes_of_route(ROAD, ("1", "2", "3")))
LANE = DrivingPath(ROAD["11"].centerline)


def scored(drives: SimulatedDrives, actors: Actors | None = None, weights: Weights | None = None) -> Scores:
    forecast = constant_velocity(actors if actors is not None else Actors.none(), 5.0)
    return score(drives, forecast, GROUND, LANE, weights=weights or Weights())


@settings(max_examples=6)
@given(seed=st.integers(0, 2**31))
def test_contacts_are_where_shapely_finds_boxes_that_meet(seed: int) -> None:
    rng = np.random.default_rng(seed)
    forecast = crowd(rng, 25, LINE)
    at = LINE.pose_at(30.0)
    drives = drives_along(LINE, ego(at.x_m, at.y_m, 8.0, at.heading_rad), [4.0, 8.0, 12.0], [0.0, 1.0, -2.0], 30)
    ahead_s = drives.time_s - drives.time_s[0]
    found = contacts(drives.x_m, drives.y_m, drives.heading_rad, ahead_s, forecast, PACIFICA)
    mine = set(zip(found.pose.tolist(), found.actor.tolist(), strict=True))
    boxes = ego_boxes(drives)
    theirs: set[tuple[int, int]] = set()
    for k in range(boxes.shape[1]):
        others = polygons_at(forecast, int(forecast.instant(ahead_s[k])))
        for n, a in zip(*np.nonzero(shapely.intersects(boxes[:, k, None], others[None, :])), strict=True):
            theirs.add((int(n) * boxes.shape[1] + k, int(a)))
    assert mine == theirs
    assert found.pose.tolist() == sorted(found.pose.tolist())


def test_actors_to_ignore_are_not_met() -> None:
    drives = straight_drives(10.0)
    forecast = constant_velocity(cars((40.0, 0.0), (50.0, 0.0)), 5.0)
    found = contacts(
        drives.x_m, drives.y_m, drives.heading_rad, drives.time_s, forecast, PACIFICA, ignore=np.array([True, False])
    )
    assert set(found.actor.tolist()) == {1}


def test_what_touches_the_ego_now_is_known() -> None:
    forecast = constant_velocity(cars((4.0, 0.0), (5.1, 0.0), (0.0, 2.1)), 1.0)
    assert touched_now(ego(), forecast, PACIFICA).tolist() == [True, False, True]


def wild_drives(rng: np.random.Generator, count: int, states: int) -> SimulatedDrives:
    columns = {name: rng.normal(0.0, 1.0, (count, states)).cumsum(axis=1) * 0.3 for name in ("ax_mps2", "yaw_rate")}
    zeros = np.zeros((count, states))
    heading = wrap_angle(rng.normal(0.0, 0.05, (count, states)).cumsum(axis=1) + 3.0)
    return SimulatedDrives(
        0.1 * np.arange(states, dtype=float), zeros, zeros, heading, zeros, columns["ax_mps2"], zeros, zeros,
        0.1 * columns["yaw_rate"], 0.01 * columns["yaw_rate"],
    )  # fmt: skip


@settings(max_examples=5)
@given(seed=st.integers(0, 2**31), states=st.sampled_from([4, 6, 9, 16, 41, 81]), ahead=st.sampled_from([0.0, 1.461]))
def test_comfort_is_judged_by_the_signals_of_the_metric(seed: int, states: int, ahead: float) -> None:
    """The benchmark's own filters, drive by drive."""
    drives = wild_drives(np.random.default_rng(seed), 6, states)
    expected: list[bool] = []
    for n in range(6):
        leak = ahead * (drives.yaw_rate_radps[n] ** 2 + drives.yaw_acceleration_radps2[n])
        longitudinal, magnitude = smoothed(drives.ax_mps2[n] + leak), smoothed(np.abs(drives.ax_mps2[n]))
        heading = unwrapped(drives.heading_rad[n])
        expected.append(
            bool(
                (longitudinal > -4.05).all()
                and (longitudinal < 2.40).all()
                and (np.abs(derivative(magnitude, 0.1, 15, 2)) < 8.37).all()
                and (np.abs(derivative(longitudinal, 0.1, 15, 2)) < 4.13).all()
                and (np.abs(derivative(heading, 0.1, 5, 2)) < 0.95).all()
                and (np.abs(derivative(heading, 0.1, 5, 3, times=2)) < 1.93).all()
            )
        )
    assert comfortable(drives, ahead).tolist() == expected


def test_too_short_a_drive_is_comfortable() -> None:
    assert comfortable(straight_drives(8.0, steps=2)).tolist() == [True]


def test_places_of_a_drive_that_leaves_its_lane_and_the_road() -> None:
    drives = drives_along(LANE.line, ego(20.0, 0.0, 10.0), [10.0] * 3, [0.0, -1.75, 3.0], 60)
    where = places(drives, GROUND)
    begins = np.arange(len(drives)) * drives.x_m.shape[1]
    assert where.straddles(begins).tolist() == [False, False, False]
    assert where.straddles(begins + drives.x_m.shape[1] - 1).tolist() == [False, True, False]
    assert where.off_road[:, -1].tolist() == [False, False, True]
    assert where.off_route[:, -1].tolist() == [False, False, True]


def test_the_rear_axle_decides_what_is_in_an_intersection() -> None:
    drives = straight_drives(10.0, x_m=195.0)
    where = places(drives, GROUND)
    axle_m = drives.x_m[0] - PACIFICA.rear_axle_to_center_m
    assert (where.in_intersection(np.arange(axle_m.size)) == ((axle_m > 200.0) & (axle_m < 215.0))).all()


def test_without_anything_around_the_farthest_drive_is_best() -> None:
    found = scored(straight_drives(10.0, 4.0, 9.0))
    assert found.total[0] == 1.0
    assert found.progress == pytest.approx([1.0, found.progress_m[1] / found.progress_m[0], 1.0], abs=0.1)
    assert found.total[1] == pytest.approx((5.0 * found.progress[1] + 5.0 + 2.0 * found.comfort[1]) / 12.0)


@pytest.mark.parametrize(
    ("kind", "score_left"), [(ActorKind.VEHICLE, 0.0), (ActorKind.PEDESTRIAN, 0.0), (ActorKind.TRAFFIC_CONE, 0.5)]
)
def test_hitting_something_ahead_is_at_fault(kind: ActorKind, score_left: float) -> None:
    found = scored(straight_drives(10.0), cars((45.0, 0.0), kind=kind))
    assert found.no_collision.tolist() == [score_left]
    assert found.collision_s[0] == pytest.approx(2.05, abs=0.1)  # 20.01 m from bumper to bumper
    assert found.danger_s[0] == pytest.approx(1.2, abs=0.15)  # 0.9 s before, the last of PDM's looks ahead
    assert LOOK_AHEAD_S == (0.0, 0.3, 0.6, 0.9)


@pytest.mark.parametrize("behind", [(5.0, 0.0, 12.0), (12.0, 0.0, 30.0)], ids=["stays behind", "is ahead later"])
def test_being_hit_from_behind_is_not_and_only_the_first_contact_is_judged(behind: tuple[float, ...]) -> None:
    found = scored(straight_drives(5.0), cars(behind))
    assert found.no_collision.tolist() == [1.0]
    assert found.time_to_collision.tolist() == [1.0]


def test_a_standing_ego_is_never_at_fault() -> None:
    found = scored(straight_drives(0.0), cars((40.0, 0.0), (1.0, 0.0, 8.0), (45.0, 0.0, 9.0, np.pi)))
    assert (found.no_collision[0], found.time_to_collision[0]) == (1.0, 1.0)


@pytest.mark.parametrize(("left_m", "at_fault"), [(0.0, False), (-1.75, True)])
def test_contact_from_the_side_is_at_fault_between_lanes_only(left_m: float, at_fault: bool) -> None:
    """A car comes from the left into the ego's side, behind its front bumper."""
    start = ego(20.0, left_m, 10.0)
    drives = drives_along(LANE.line, start, [10.0], [left_m], 40)
    crossing = cars((20.0 + 25.0, left_m + 14.0, 4.6, -np.pi / 2), width_m=1.5, length_m=3.0)
    found = scored(drives, crossing)
    assert bool(found.no_collision[0] == 0.0) is at_fault


def test_leaving_the_drivable_area_costs_everything() -> None:
    start = ego(20.0, 0.0, 10.0)
    found = scored(drives_along(LANE.line, start, [10.0, 10.0], [0.0, 2.0], 40))
    assert found.drivable_area.tolist() == [1.0, 0.0]
    assert found.total[1] == 0.0


@pytest.mark.parametrize(("speed", "steps", "left"), [(3.0, 5, 1.0), (3.0, 15, 0.5), (10.0, 30, 0.0)])
def test_metres_off_the_route_are_counted(speed: float, steps: int, left: float) -> None:
    two_way = junction()
    ground = Ground(two_way, ("1",))
    wrong = two_way["5"].centerline
    backwards = drives_along(wrong, ego(-40.0, 1.75, speed, np.pi), [speed], [0.0], steps)
    found = score(backwards, constant_velocity(Actors.none(), 5.0), ground, DrivingPath(wrong))
    assert found.driving_direction.tolist() == [left]


def test_no_progress_at_all_is_no_shame() -> None:
    found = scored(straight_drives(0.0, 0.0))
    assert found.progress.tolist() == [1.0, 1.0]
    assert found.total.tolist() == [1.0, 1.0]


def test_progress_is_relative_to_the_best_drive_that_is_allowed() -> None:
    # the fast one hits the pedestrian, so the slow one is the measure
    found = scored(straight_drives(12.0, 2.0), pedestrians((55.0, 0.0)))
    assert found.no_collision.tolist() == [0.0, 1.0]
    assert found.progress[1] == 1.0


def test_weights_are_options() -> None:
    found = scored(straight_drives(10.0, 4.0), weights=Weights(progress=1.0, time_to_collision=0.0, comfort=0.0))
    assert found.total == pytest.approx(found.progress)


def test_a_forecast_may_be_empty_or_short() -> None:
    drives = straight_drives(10.0)
    none = constant_velocity(Actors.none(), 0.0)
    assert score(drives, none, GROUND, LANE).total.tolist() == [1.0]
    short: Forecast = constant_velocity(cars((50.0, 0.0)), 0.0)
    assert score(drives, short, GROUND, LANE).no_collision.tolist() == [0.0]


def test_looking_at_every_fourth_state_finds_the_same_collision_up_to_that() -> None:
    drives, forecast = straight_drives(10.0, 4.0), constant_velocity(cars((45.0, 0.0)), 5.0)
    all_of_them, some = (score(drives, forecast, GROUND, LANE, every=n) for n in (1, 4))
    assert some.no_collision.tolist() == all_of_them.no_collision.tolist()
    assert 0.0 <= some.collision_s[0] - all_of_them.collision_s[0] < 0.4
    assert some.progress_m.tolist() == all_of_them.progress_m.tolist()
