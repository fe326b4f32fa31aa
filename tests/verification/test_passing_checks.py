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


CONES = tuple(cone(100.0 + 2.0 * i, -0.9 + 0.6 * i) for i in range(4))
WRECKS = {apart_m: (car(100.0), car(100.0 + apart_m)) for apart_m in (4.54, 4.56)}


@pytest.mark.parametrize(
    ("family", "sound", "unsound", "said"),
    [
        ("nudge", (parked(1.415),), (parked(1.43),), "takes a lateral offset of 1.43 m, expected at most 1.4 m"),
        ("nudge", (parked(1.4),), (parked(1.95),), "takes the ego's centre out of its own side"),
        ("overtake", (parked(1.9),), (parked(1.4),), "passes on its own side, 1.40 m off the lane's centre"),
        ("accident", WRECKS[4.54], WRECKS[4.56], "goes 4 cm into that of obstacles[1], expected more than 5 cm"),
        ("accident", WRECKS[4.54], (car(100.0), cone(104.0)), "1 of them are vehicles, expected two or three"),
    ],
)
def test_a_family_asks_for_its_kind_of_obstacle(
    family: str, sound: tuple[Obstacle, ...], unsound: tuple[Obstacle, ...], said: str
) -> None:
    assert family_problems(staged(family, obstacles=sound), WIDE) == []
    assert any(said in each for each in family_problems(staged(family, obstacles=unsound), WIDE))


@pytest.mark.parametrize("family", ["construction", "nudge", "overtake", "accident"])
@pytest.mark.parametrize(("offset", "blocks"), [(CLEARANCE_M + 0.02, True), (CLEARANCE_M - 0.02, False)])
def test_obstacles_must_block_who_holds_the_lane(family: str, offset: float, blocks: bool) -> None:
    """Passing 0.3 m clear with an offset of less than 0.3 m, one passes without any."""
    obstacles = (parked(offset),) if family != "accident" else (parked(offset), car(104.0, parked(offset).place.left_m))
    found = family_problems(staged(family, obstacles=obstacles), WIDE)
    assert any("touches none of them" in text for text in found) != blocks


def test_an_overtake_needs_room_on_the_other_side() -> None:
    (found,) = family_problems(staged("overtake", obstacles=(car(100.0),)), ONE_LANE)
    assert "leave no way past on the drivable area, expected one with 0.3 m to spare" in found
    assert family_problems(staged("overtake", obstacles=(car(100.0),)), WIDE) == []


def test_construction_is_passed_on_the_own_side() -> None:
    assert family_problems(staged("construction", obstacles=CONES), TWO_LANES) == []
    (found,) = family_problems(staged("construction", obstacles=CONES), WIDE)
    assert "no way past on the ego's own side of the road" in found


@pytest.mark.parametrize(
    ("walls", "open_"),
    [
        ((wall(6.55, 10.0), wall(-6.55, 10.0)), True),  # 3.1 m apart; the ego takes 2.297 m and 0.3 m on either side
        ((wall(6.3, 10.0), wall(-6.3, 10.0)), False),  # 2.6 m
        ((wall(-0.6, 2.5), wall(LANE_WIDTH_M, 3.6, 125.0)), True),  # from the left strip to the right edge and back
        ((wall(-0.6, 2.5), wall(LANE_WIDTH_M, 3.6, 106.0)), False),  # it cannot be steered in 6 m
    ],
)
def test_a_way_past_is_as_wide_as_the_ego_and_its_clearance_and_can_be_steered(
    walls: tuple[Obstacle, ...], open_: bool
) -> None:
    scenario = staged("accident", obstacles=walls)
    line = ego_ahead(scenario, WIDE, 200.0)
    assert has_way_past(scenario, WIDE, line, obstacle_corners(scenario, WIDE)) == open_
