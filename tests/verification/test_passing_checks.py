"""Passing obstacles: how far aside, on whose side of the road, and whether there is room at all."""

from __future__ import annotations

import pytest
from stages import ONE_LANE, TWO_LANES, car, cone, family_problems, staged, widened
from worlds import LANE_WIDTH_M

from interplan_sumo.families.passing import (
    CLEARANCE_M,
    has_way_past,
    obstacle_corners,
    passing_offset_m,
)
from interplan_sumo.scenario.constant_velocity import ego_ahead
from interplan_sumo.scenario.scenario import LanePosition, Obstacle, Scenario
from interplan_sumo.world.ego import PACIFICA
from interplan_sumo.world.roads import Roads

WIDE = widened(ONE_LANE)
PASSING_M = PACIFICA.width_m / 2.0 + CLEARANCE_M


def parked(offset_m: float) -> Obstacle:
    """A car on the right that one passes with this offset to the left."""
    return car(100.0, offset_m - PASSING_M - 1.85 / 2.0)


def wall(left_m: float, width_m: float, arc_m: float = 100.0) -> Obstacle:
    """A barrier across the road, its middle `left_m` to the left."""
    return Obstacle(LanePosition("11", arc_m, left_m), "barrier", length_m=0.5, width_m=width_m)


def offset_m(scenario: Scenario, roads: Roads) -> float | None:
    return passing_offset_m(scenario, roads, ego_ahead(scenario, roads, 200.0), obstacle_corners(scenario, roads))


def test_other_families_and_empty_roads_have_nothing_to_pass() -> None:
    assert family_problems(staged("somebody_elses", obstacles=(cone(100.0),)), ONE_LANE) == []
    (found,) = family_problems(staged("construction"), ONE_LANE)
    assert "obstacles: there are none" in found


@pytest.mark.parametrize("offset", [0.4, 1.0, 1.4])
def test_the_offset_of_a_parked_car_is_the_one_it_was_placed_for(offset: float) -> None:
    assert offset_m(staged("nudge", obstacles=(parked(offset),)), WIDE) == pytest.approx(offset, abs=2e-3)


def test_the_lesser_side_counts_and_only_sides_with_room() -> None:
    beside = Obstacle(LanePosition("12", 100.0, 3.3))  # in lane 12's frame: 0.2 m right of the middle of lane 11
    scenario = staged("nudge", obstacles=(beside,))
    assert offset_m(scenario, WIDE if "12" in WIDE else TWO_LANES) == pytest.approx(0.925 + PASSING_M + 0.2, abs=2e-3)
    assert offset_m(staged("nudge", obstacles=(parked(1.0),)), ONE_LANE) is None  # the box would leave the road


@pytest.mark.parametrize(("offset", "sound"), [(1.415, True), (1.43, False)])
def test_a_nudge_takes_no_more_than_1_4_m(offset: float, sound: bool) -> None:
    found = family_problems(staged("nudge", obstacles=(parked(offset),)), WIDE)
    assert (found == []) == sound
    if not sound:
        assert "takes a lateral offset of 1.43 m, expected at most 1.4 m" in found[0]


@pytest.mark.parametrize(("offset", "sound"), [(1.95, False), (1.4, True)])
def test_a_nudge_leaves_the_egos_centre_on_its_own_side(offset: float, sound: bool) -> None:
    """The lane's half is 1.75 m wide."""
    found = family_problems(staged("nudge", obstacles=(parked(offset),)), WIDE)
    assert (found == []) == sound
    if not sound:
        assert "takes the ego's centre out of its own side" in found[0]


@pytest.mark.parametrize("family", ["construction", "nudge", "overtake", "accident"])
@pytest.mark.parametrize(("offset", "blocks"), [(CLEARANCE_M + 0.02, True), (CLEARANCE_M - 0.02, False)])
def test_obstacles_must_block_who_holds_the_lane(family: str, offset: float, blocks: bool) -> None:
    """Passing 0.3 m clear with an offset of less than 0.3 m, one passes without any."""
    obstacles = (parked(offset),) if family != "accident" else (parked(offset), car(104.0, parked(offset).place.left_m))
    found = family_problems(staged(family, obstacles=obstacles), WIDE)
    assert any("touches none of them" in text for text in found) != blocks


@pytest.mark.parametrize(("offset", "sound"), [(1.9, True), (1.4, False)])
def test_an_overtake_needs_the_other_side(offset: float, sound: bool) -> None:
    found = family_problems(staged("overtake", obstacles=(parked(offset),)), WIDE)
    assert (found == []) == sound
    if not sound:
        assert "passes on its own side, 1.40 m off the lane's centre" in found[0]


def test_an_overtake_needs_room_on_the_other_side() -> None:
    (found,) = family_problems(staged("overtake", obstacles=(car(100.0),)), ONE_LANE)
    assert "leave no way past on the drivable area, expected one with 0.3 m to spare" in found
    assert family_problems(staged("overtake", obstacles=(car(100.0),)), WIDE) == []


def test_construction_is_passed_on_the_own_side() -> None:
    cones = tuple(cone(100.0 + 2.0 * i, -0.9 + 0.6 * i) for i in range(4))
    assert family_problems(staged("construction", obstacles=cones), TWO_LANES) == []
    (found,) = family_problems(staged("construction", obstacles=cones), WIDE)
    assert "no way past on the ego's own side of the road" in found


@pytest.mark.parametrize(("gap_m", "open_"), [(3.1, True), (2.6, False)])
def test_a_gap_must_be_as_wide_as_the_ego_and_its_clearance(gap_m: float, open_: bool) -> None:
    """2.297 m and 0.3 m on either side."""
    walls = (wall(gap_m / 2.0 + 5.0, 10.0), wall(-gap_m / 2.0 - 5.0, 10.0))
    scenario = staged("accident", obstacles=walls)
    line = ego_ahead(scenario, WIDE, 200.0)
    assert has_way_past(scenario, WIDE, line, obstacle_corners(scenario, WIDE)) == open_


def test_a_way_past_must_be_steered() -> None:
    """From the left strip to the right edge of the road and back takes some metres."""
    for apart_m, open_ in ((25.0, True), (6.0, False)):
        walls = (wall(-0.6, 2.5), wall(LANE_WIDTH_M, 3.6, 100.0 + apart_m))
        scenario = staged("accident", obstacles=walls)
        line = ego_ahead(scenario, WIDE, 200.0)
        assert has_way_past(scenario, WIDE, line, obstacle_corners(scenario, WIDE)) == open_


@pytest.mark.parametrize(("apart_m", "sound"), [(4.54, True), (4.56, False)])
def test_crashed_cars_intersect_by_more_than_5_cm(apart_m: float, sound: bool) -> None:
    found = family_problems(staged("accident", obstacles=(car(100.0), car(100.0 + apart_m))), WIDE)
    assert (found == []) == sound
    if not sound:
        assert "obstacles[0]: its box goes 4 cm into that of obstacles[1], expected more than 5 cm" in found[0]


def test_an_accident_takes_two_cars() -> None:
    (found,) = family_problems(staged("accident", obstacles=(car(100.0), cone(104.0))), WIDE)
    assert "1 of them are vehicles, expected two or three" in found
