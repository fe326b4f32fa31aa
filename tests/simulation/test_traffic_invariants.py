"""The checks of the fuzz find what they are for, and nothing in motions that a car can make."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.simulation.traffic_invariants import (
    Array,
    Body,
    Drive,
    comings_and_goings,
    drives_into_the_ego,
    violations,
)
from tests.simulation.twin_invariants import reactions_to_what_is_behind, same, spawn_braking

BODIES = {"a": Body("car", 1.0, 9.0), "b": Body("car", 1.0, 9.0)}
FRAMES = 30
FAR_M = 500.0


def drive(*speeds_mps: float | Array, gap_m: float = 30.0, ego_x_m: float = -FAR_M) -> Drive:
    """Cars one behind the other along x, the first agent foremost; the ego stands at `ego_x_m`."""
    ids = tuple("abcd"[: len(speeds_mps)])
    speed = np.stack([np.broadcast_to(each, FRAMES) for each in speeds_mps], axis=1).astype(float)
    start = -gap_m * np.arange(len(ids))
    x = start + 0.1 * np.concatenate((np.zeros((1, len(ids))), np.cumsum(speed[1:], axis=0)))
    ego = np.tile((ego_x_m, 0.0, 0.0, 5.0, 2.0), (FRAMES, 1))
    size = np.full(len(ids), 4.6), np.full(len(ids), 1.85)
    return Drive(ids, x, np.zeros_like(x), np.zeros_like(x), speed, speed.copy(), *size, ego)


def kinds(of: Drive) -> set[str]:
    return {each.kind for each in violations(of, BODIES)}


def slowing(rate_mps2: float, begins: int = 10) -> Array:
    """20 m/s, then slower and slower."""
    return np.maximum(0.0, 20.0 - 0.1 * rate_mps2 * np.maximum(0.0, np.arange(FRAMES) - begins)).astype(np.float64)


@pytest.mark.parametrize(("rate", "found"), [(9.04, set()), (9.1, {"braking"})])
def test_brakes_hold_a_car_back_no_harder_than_they_can(rate: float, found: set[str]) -> None:
    assert kinds(drive(slowing(rate))) == found


@pytest.mark.parametrize(("rate", "found"), [(1.04, set()), (1.1, {"acceleration"})])
def test_an_engine_pushes_no_harder_than_it_can(rate: float, found: set[str]) -> None:
    assert kinds(drive(np.linspace(5.0, 5.0 + 0.1 * rate * (FRAMES - 1), FRAMES))) == found


def test_what_is_shown_must_be_possible_too() -> None:
    shown = drive(20.0)
    shown.speed_mps[10:] = 18.0
    assert kinds(shown) == {"braking_shown"}


def on_a_circle(radius_m: float, slip_deg: float = 0.0) -> Drive:
    """A car whose rear axle goes round at 5 m/s, its body pointing off that way by `slip_deg`."""
    straight = drive(5.0)
    along = np.arange(FRAMES) * 0.5 / radius_m
    heading = along + np.radians(slip_deg)
    rear = radius_m * np.sin(along), radius_m * (1.0 - np.cos(along))
    x, y = (rear[i] + 0.3 * 4.6 * part for i, part in enumerate((np.cos(heading), np.sin(heading))))
    return replace(straight, x_m=x[:, None], y_m=y[:, None], heading_rad=heading[:, None])


@pytest.mark.parametrize(("slip_deg", "found"), [(0.0, False), (9.5, False), (-10.5, True)])
def test_a_rear_axle_rolls_where_its_wheels_point(slip_deg: float, found: bool) -> None:
    assert ("side_slip" in kinds(on_a_circle(12.0, slip_deg))) is found


@pytest.mark.parametrize(("radius_m", "found"), [(4.0, False), (2.5, True)])
def test_a_wheelbase_has_a_smallest_circle(radius_m: float, found: bool) -> None:
    assert ("turn" in kinds(on_a_circle(radius_m))) is found


@pytest.mark.parametrize(("gap_m", "found"), [(4.56, set()), (4.54, {"overlap"})])
def test_two_bodies_are_never_in_one_place(gap_m: float, found: set[str]) -> None:
    assert kinds(drive(8.0, 8.0, gap_m=gap_m)) == found


@pytest.mark.parametrize(
    ("stands_since", "aside_m", "found"), [(0, 0.0, ["a"]), (0, 1.5, []), (25, 0.0, [])]
)  # the last one is seen too late
def test_nobody_drives_into_an_ego_that_has_stood_in_its_way(
    stands_since: int, aside_m: float, found: list[str]
) -> None:
    many = 60
    speed = np.full((many, 1), 5.0)
    x = 0.5 * np.arange(many)[:, None].astype(float)
    ego = np.tile((30.0, aside_m, 0.0, 5.0, 2.0), (many, 1))
    ego[: stands_since + 1, 0] -= 0.1 * np.arange(stands_since, -1, -1)
    meeting = Drive(
        ("a",), x, np.zeros_like(x), np.zeros_like(x), speed, speed, np.full(1, 4.6), np.full(1, 1.85), ego
    )  # fmt: skip
    assert [each.agent for each in drives_into_the_ego(meeting, BODIES)] == found


def test_what_was_placed_overlapping_may_stay_so_but_no_agent_may_drive_into_it() -> None:
    crashed = drive(8.0, 0.0, 0.0, gap_m=2.0)
    found = violations(crashed, {"a": BODIES["a"]}, standing=frozenset("bc"))
    assert {(each.kind, each.agent) for each in found} == {("overlap_obstacle", "a+b"), ("overlap_obstacle", "a+c")}


def test_a_pedestrian_may_walk_into_a_car_that_stands_but_no_car_drives_into_a_pedestrian() -> None:
    for car_mps, found in ((0.2, set[str]()), (5.0, {"overlap_pedestrian"})):
        meeting = drive(car_mps, 0.0, gap_m=2.0)
        assert {v.kind for v in violations(meeting, {"a": BODIES["a"]}, walking=frozenset("b"))} == found


@pytest.mark.parametrize(("ahead_m", "found"), [(4.0, set()), (20.0, {"overlap_pedestrian"})])
def test_who_could_not_stop_when_a_pedestrian_set_out_is_not_to_blame(ahead_m: float, found: set[str]) -> None:
    """At 10 m/s, with brakes of 9 m/s2, that takes 5.6 m, and a step."""
    meeting = drive(10.0, 1.3)
    meeting.length_m[1], meeting.width_m[1] = 0.6, 0.6
    meeting.x_m[:, 1], meeting.y_m[:, 1] = ahead_m + 2.3 + 0.3, 0.13 * np.arange(FRAMES) - 0.13 * (ahead_m + 3.0)
    meeting.heading_rad[:, 1] = np.pi / 2.0
    seen = violations(meeting, {"a": BODIES["a"]}, walking=frozenset("b"))
    assert {each.kind for each in seen} == found


def test_runs_are_the_same_for_actors_as_long_as_they_are_so_to_the_bit() -> None:
    one, other = drive(20.0, 10.0), drive(20.0, slowing(3.0) / 2.0)
    assert same(one, other, ["a"], 29)
    assert same(one, other, ["a", "b"], 10)
    assert not same(one, other, ["a", "b"], 11)
    assert not same(one, other, ["c"], 0)


@pytest.mark.parametrize(("away_m", "found"), [(99.0, ["appears"]), (101.0, [])])
def test_nobody_appears_in_sight(away_m: float, found: list[str]) -> None:
    late = drive(0.0, ego_x_m=-away_m)
    late.x_m[:5] = np.nan
    assert [each.kind for each in comings_and_goings(late, BODIES, None, None)] == found


def test_nobody_leaves_in_sight_but_where_the_map_ends_under_a_name_of_its_own() -> None:
    early = drive(0.0, ego_x_m=-50.0)
    early.x_m[20:] = np.nan
    for end_m, found in ((40.0, "leaves"), (20.0, "leaves_at_map_end")):
        assert [v.kind for v in comings_and_goings(early, BODIES, None, np.array([(end_m, 0.0)]))] == [found]


def test_a_body_is_where_its_speed_takes_it() -> None:
    jumping = drive(8.0)
    jumping.x_m[15:] += 1.0
    assert kinds(jumping) == {"jump"}


@pytest.mark.parametrize(("ego_x_m", "found"), [(-2.0, ["a"]), (60.0, [])])
def test_braking_for_an_ego_behind_is_found_by_the_run_without_it(ego_x_m: float, found: list[str]) -> None:
    with_ego, without = drive(slowing(3.0), ego_x_m=ego_x_m), drive(20.0, ego_x_m=ego_x_m)
    assert [each.agent for each in reactions_to_what_is_behind(with_ego, without, BODIES)] == found


def test_who_gives_way_to_an_ego_in_the_lane_that_it_wants_may_brake_for_it() -> None:
    with_ego, without = drive(slowing(3.0), ego_x_m=-2.0), drive(20.0, ego_x_m=-2.0)
    (found,) = reactions_to_what_is_behind(with_ego, without, BODIES)
    assert list(reactions_to_what_is_behind(with_ego, without, BODIES, {(found.frame - 1, "a")})) == []


def test_who_brakes_because_another_does_does_not_react_to_the_ego() -> None:
    with_ego, without = drive(slowing(9.0, 5), slowing(3.0, 12), ego_x_m=-35.0), drive(20.0, 20.0, ego_x_m=-35.0)
    assert [each.agent for each in reactions_to_what_is_behind(with_ego, without, BODIES)] == ["a"]


@pytest.mark.parametrize(("rate", "begins", "found"), [(3.2, 0, 1), (2.9, 0, 0), (3.2, 22, 0)])
def test_hard_braking_right_after_the_start_is_the_spawns_fault(rate: float, begins: int, found: int) -> None:
    assert len(list(spawn_braking(drive(slowing(rate, begins)), BODIES))) == found


@pytest.mark.parametrize(("leader_mps2", "found"), [(5.0, ["a"]), (3.2, ["a", "b"])])
def test_who_brakes_because_the_one_ahead_brakes_as_hard_has_started_well(leader_mps2: float, found: list[str]) -> None:
    both = drive(slowing(leader_mps2, 2), slowing(4.0, 3))
    assert [each.agent for each in spawn_braking(both, BODIES)] == found


def test_who_brakes_for_somebody_who_is_there_in_one_run_only_does_not_react_to_the_ego() -> None:
    """A pedestrian who sets out because the ego comes, or a car that enters because of it."""
    with_ego, without = drive(slowing(3.0), 20.0, gap_m=-40.0, ego_x_m=-35.0), drive(20.0, ego_x_m=-35.0)
    assert list(reactions_to_what_is_behind(with_ego, without, BODIES)) == []
