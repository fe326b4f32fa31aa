"""Tracks as they are driven: swerves, closed places, speeds."""

from __future__ import annotations

import numpy as np
import pytest
from stages import ONE_LANE, TWO_LANES, car, cone, staged, widened

from interplan_sumo.proving.course import course
from interplan_sumo.proving.ways import HALF_WIDTH_M, NUDGE_M, Swerve, blocked_by, way
from interplan_sumo.world.roads import Roads


def driven_line(roads: Roads, left_m: float, swerve: Swerve | None = None, exempt: tuple[str, ...] = ()):
    unrolled = course(staged(obstacles=(car(100.0, left_m),), exempt=exempt), roads)
    return unrolled, way(unrolled, unrolled.tracks[unrolled.start_track], swerve or Swerve())


def test_a_free_lane_is_driven_in_its_middle_at_the_limit() -> None:
    unrolled = course(staged(), ONE_LANE)
    free = way(unrolled, unrolled.tracks[0], Swerve())
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


def test_cones_in_a_row_are_one_group_and_distant_ones_are_two() -> None:
    def groups(*arcs_m: float) -> int:
        unrolled = course(staged(obstacles=tuple(cone(arc) for arc in arcs_m)), TWO_LANES)
        return len(blocked_by(unrolled, unrolled.tracks[0], 0.4))

    assert groups(80.0, 84.0, 88.0) == 1
    assert groups(60.0, 140.0) == 2
