"""Tracks as they are driven: swerves, closed places, speeds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from stages import ONE_LANE, TWO_LANES, car, cone, narrowed, staged, widened
from worlds import LANE_WIDTH_M, curved_road

from interplan_sumo.scenario.scenario import LanePosition, Obstacle, PlacedVehicle
from interplan_sumo.verification.corridor import WITHOUT_LIMIT_MPS, frenet_corridor
from interplan_sumo.verification.drivable_paths import (
    FIRST_BRAKING_MPS2,
    FIRST_S,
    HALF_WIDTH_M,
    LATERAL_MPS2,
    NUDGE_M,
    Swerve,
    blocked_by,
    drivable_path,
)
from interplan_sumo.world.roads import Area, Roads


def driven_line(roads: Roads, left_m: float, swerve: Swerve | None = None, exempt: tuple[str, ...] = ()):
    unrolled = frenet_corridor(staged(obstacles=(car(100.0, left_m),), exempt=exempt), roads)
    return unrolled, drivable_path(unrolled, unrolled.lane_paths[unrolled.start_path], swerve or Swerve())


def test_a_free_lane_is_driven_in_its_middle_at_the_limit() -> None:
    unrolled = frenet_corridor(staged(), ONE_LANE)
    free = drivable_path(unrolled, unrolled.lane_paths[0], Swerve())
    inside = np.isfinite(free.left_m)
    assert np.abs(free.left_m[inside]).max() == 0.0
    assert free.cap_mps[inside].min() == pytest.approx(13.9)
    assert not free.closed[inside].any()


def test_a_parked_car_is_passed_with_the_clearance_that_was_asked_for() -> None:
    unrolled, passing = driven_line(widened(ONE_LANE), left_m=-1.6, swerve=Swerve(clearance_m=0.4))
    at = unrolled.on_grid(unrolled.start_m + 80.0)
    assert passing.left_m[at] == pytest.approx(-1.6 + 1.85 / 2.0 + HALF_WIDTH_M + 0.4)
    assert abs(passing.left_m[at]) <= NUDGE_M
    assert not passing.closed[np.isfinite(passing.left_m)].any()


@pytest.mark.parametrize(("over", "closed"), [(None, True), ("left", False), ("right", True)])
def test_a_blocked_lane_is_closed_unless_one_leaves_it_to_where_there_is_road(over, closed: bool) -> None:
    unrolled, passing = driven_line(widened(ONE_LANE), left_m=0.0, swerve=Swerve(over=over))
    before = unrolled.arc_m < unrolled.start_m + 100.0
    assert passing.closed[before].any() == closed


def test_an_obstacle_straight_ahead_caps_the_speed_before_it() -> None:
    unrolled, passing = driven_line(ONE_LANE, left_m=0.0)
    gaps_m = 80.0 - 2.3 - 2.6 - np.array((20.0, 10.0))
    near, nearer = (passing.cap_mps[unrolled.on_grid(unrolled.start_m + gap)] for gap in gaps_m)
    assert nearer < near < 20.0 / 0.95
    assert nearer < 10.0 / 0.95


def test_an_ego_that_begins_too_fast_has_room_to_brake() -> None:
    unrolled = frenet_corridor(staged(start_speed_mps=16.9), ONE_LANE)
    cap_mps = drivable_path(unrolled, unrolled.lane_paths[0], Swerve()).cap_mps
    assert cap_mps[unrolled.on_grid(unrolled.start_m)] == pytest.approx(16.9)
    braked_m = 16.9 * FIRST_S + (16.9**2 - 13.9**2) / (2.0 * FIRST_BRAKING_MPS2)
    before, after = (cap_mps[unrolled.on_grid(unrolled.start_m + braked_m + more_m)] for more_m in (-1.0, 1.0))
    assert before > 13.9
    assert after == pytest.approx(13.9)


@pytest.mark.parametrize(("left_m", "over"), [(-1.6, False), (-0.6, True)])
def test_more_than_a_nudge_is_over_the_lane_from_the_first_step_aside(left_m: float, over: bool) -> None:
    unrolled, passing = driven_line(widened(ONE_LANE), left_m, Swerve(over="left"))
    aside_m = np.nan_to_num(passing.left_m)
    assert passing.over.tolist() == (over & (aside_m > 0.1)).tolist()
    assert passing.over[unrolled.on_grid(unrolled.start_m + 80.0)] == over


def test_without_a_limit_a_bend_is_driven_at_what_is_comfortable() -> None:
    roads = curved_road(radius_m=20.0, limit_mps=None)
    goal = LanePosition("11", roads["11"].centerline.length_m - 5.0)
    found = frenet_corridor(staged(start=LanePosition("11", 3.0), start_speed_mps=3.0, goal=goal), roads)
    cap_mps = drivable_path(found, found.lane_paths[0], Swerve()).cap_mps
    assert cap_mps.max() == WITHOUT_LIMIT_MPS
    assert cap_mps.min() == pytest.approx(np.sqrt(LATERAL_MPS2 * 20.0), rel=0.1)


def test_a_car_parked_in_a_bend_is_passed_with_as_much_more_room_as_it_takes() -> None:
    def room_m(arc_m: float) -> float:
        ground = Area("9", shapely.box(-50.0, -50.0, 250.0, 250.0))
        bend = curved_road(radius_m=80.0, run_in_m=80.0, limit_mps=13.9)
        roads = replace(bend, generic_drivable_areas=(ground,))
        unrolled = frenet_corridor(staged(obstacles=(car(arc_m, -1.6),), goal=LanePosition("11", 150.0)), roads)
        passing = drivable_path(unrolled, unrolled.lane_paths[0], Swerve(clearance_m=0.3))
        assert not (passing.closed & passing.swerving).any()
        return float(np.nanmax(passing.left_m))

    assert room_m(60.0) == pytest.approx(-1.6 + 1.85 / 2.0 + HALF_WIDTH_M + 0.3)
    assert room_m(100.0) == pytest.approx(room_m(60.0) + 0.15, abs=0.03)


@pytest.mark.parametrize(("lane", "arc_m", "groups"), [("11", 100.0, 1), ("31", 3.0, 0)])
def test_what_stands_at_the_end_of_a_lane_blocks_it_and_what_stands_beyond_does_not(
    lane: str, arc_m: float, groups: int
) -> None:
    parked = Obstacle(LanePosition(lane, arc_m, -LANE_WIDTH_M), "cone")
    unrolled = frenet_corridor(
        staged(
            obstacles=(parked,), start=LanePosition("11", 20.2), goal=LanePosition("31", 150.0), route=("1", "2", "3")
        ),
        narrowed("11"),
    )
    ended = next(lane_path for lane_path in unrolled.lane_paths if "12" in lane_path.lanes)
    found = blocked_by(unrolled, ended, 0.4)
    assert len(found) == groups
    for _, _, right_m, left_m in found:
        assert (right_m, left_m) == pytest.approx((-0.25 - HALF_WIDTH_M - 0.4, 0.25 + HALF_WIDTH_M + 0.4))


def test_cones_in_a_row_are_one_group_and_distant_ones_are_two() -> None:
    def groups(*arcs_m: float) -> int:
        unrolled = frenet_corridor(staged(obstacles=tuple(cone(arc) for arc in arcs_m)), TWO_LANES)
        return len(blocked_by(unrolled, unrolled.lane_paths[0], 0.4))

    assert groups(80.0, 84.0, 88.0) == 1
    assert groups(60.0, 140.0) == 2


def test_slow_vehicles_are_passed_along_a_stretch_of_road_and_only_there() -> None:
    slow = PlacedVehicle(LanePosition("11", 60.0, -0.9), 4.0, "bicycle")
    scenario = staged("nudge", vehicles=(slow,))
    unrolled = frenet_corridor(scenario, widened(ONE_LANE))
    behind = drivable_path(unrolled, unrolled.lane_paths[0], Swerve())
    beside = drivable_path(unrolled, unrolled.lane_paths[0], Swerve(beside_m=(60.0, 100.0)))
    assert not behind.swerving.any()
    there = unrolled.arc_m[beside.swerving] - unrolled.start_m
    assert there.min() > 25.0
    assert there.max() < 135.0
    assert np.nanmax(beside.left_m) == pytest.approx(HALF_WIDTH_M + 0.4 + 0.2 - (0.9 - 0.325), abs=0.05)
