"""The cheapest speed profile past whoever was recorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from problems import FRAMES, LENGTH_M, crossing, driving, laid_out, start_of, steady
from stages import ONE_LANE, TWO_LANES, car, staged, widened
from worlds import LANE_WIDTH_M, straight_road

from interplan_sumo.scenario.scenario import Density, LanePosition, TrafficDemand
from interplan_sumo.verification.drivable_paths import HALF_LENGTH_M, Swerve
from interplan_sumo.verification.observed_traffic import ObservedTraffic
from interplan_sumo.verification.planning_problem import CALM, Margins, PlanningProblem, SpeedProfile, TimeGate
from interplan_sumo.verification.speed_lattice import cheapest_profile


def timed(
    problem: PlanningProblem, others: ObservedTraffic | None = None, gate: TimeGate | None = None
) -> SpeedProfile | None:
    problem = problem if others is None else replace(problem, others=others)
    return cheapest_profile(problem, start_of(problem.corridor), Margins(), CALM, gate)


def found(
    problem: PlanningProblem, others: ObservedTraffic | None = None, gate: TimeGate | None = None
) -> SpeedProfile:
    profile = timed(problem, others, gate)
    assert profile is not None
    return profile


def gap_m(profile: SpeedProfile, others: ObservedTraffic) -> np.ndarray:
    """From the ego's front to the first car's rear, at the knots."""
    frames = np.minimum(10 * np.arange(len(profile.arc_m)), FRAMES - 1)
    return others.near_m[0, frames] - profile.arc_m - HALF_LENGTH_M


def test_an_empty_road_is_driven_at_the_limit() -> None:
    profile = found(laid_out())
    assert profile.to_goal
    assert profile.speed_mps.max() == pytest.approx(13.5)  # the highest multiple of 0.5 m/s below 13.9
    assert np.diff(profile.speed_mps).max() <= 1.5
    assert profile.changes == ()


def test_a_slow_car_ahead_is_followed_with_time_to_spare_at_constant_accelerations() -> None:
    problem = laid_out()
    others = steady(problem.corridor.start_m + 25.0, 5.0)
    profile = found(problem, others)
    gaps = gap_m(profile, others)
    closing = np.maximum(profile.speed_mps - 5.0, 0.0)
    assert (gaps[1:] >= 1.5 + 1.2 * closing[1:] - 0.3).all()
    assert profile.speed_mps[-1] == pytest.approx(5.0, abs=0.6)
    assert np.diff(profile.arc_m) == pytest.approx((profile.speed_mps[:-1] + profile.speed_mps[1:]) / 2.0)


@pytest.mark.parametrize(("behind_m", "speed_mps", "lost_s"), [(12.0, 13.0, 0.0), (20.0, 20.0, 0.5)])
def test_who_comes_from_behind_stops_nobody_even_if_it_was_recorded_to_drive_through_the_ego(
    behind_m: float, speed_mps: float, lost_s: float
) -> None:
    problem = laid_out()
    assert found(problem, steady(problem.corridor.start_m - behind_m, speed_mps)).cost <= found(problem).cost + lost_s


def test_one_waits_for_a_pedestrian_and_goes_on() -> None:
    problem = laid_out()
    others = crossing(problem.corridor.start_m + 60.0, 6.0, -1.2)
    profile = found(problem, others)
    assert profile.to_goal
    on_road = np.abs((others.left_m + others.right_m)[0] / 2.0) < 1.0
    frames = np.minimum(10 * np.arange(len(profile.arc_m)), FRAMES - 1)
    beside = np.abs(profile.arc_m - (problem.corridor.start_m + 60.0)) < HALF_LENGTH_M
    assert not (on_road[frames] & beside).any()
    assert profile.speed_mps.min() < 8.0


def test_a_red_light_ahead_is_not_entered_and_one_behind_does_not_matter() -> None:
    roads = straight_road(length_m=300.0, limit_mps=13.9, cuts_m=((100.0, 110.0),))
    problem = laid_out(staged(goal=LanePosition("31", 50.0), route=("1", "2", "3")), roads)
    red = (replace(problem, red={lane: np.ones(FRAMES, dtype=np.bool_)}) for lane in ("11", "21"))
    behind, ahead = map(found, red)
    assert behind.to_goal
    front_m = ahead.arc_m[-1] + HALF_LENGTH_M - problem.corridor.start_m
    assert 79.0 < front_m <= 79.5  # half a metre before lane 11 ends


@pytest.mark.parametrize("ahead_m", [0.0, 10.0])
def test_a_lane_change_waits_until_the_lane_is_free(ahead_m: float) -> None:
    problem = laid_out(staged(goal=LanePosition("12", 200.0)), TWO_LANES)
    free = found(problem)
    beside = steady(problem.corridor.start_m + ahead_m, 10.0, left_m=0.0)  # in the goal lane
    blocked = found(problem, beside)
    assert free.to_goal
    assert blocked.to_goal
    assert len(free.changes) == len(blocked.changes) == 1
    change = blocked.changes[0]
    during = (blocked.arc_m >= change.from_m) & (blocked.arc_m <= change.to_m)
    frames = 10 * np.flatnonzero(during)[1:]
    apart = np.abs((beside.near_m + beside.far_m)[0, frames] / 2.0 - blocked.arc_m[during][1:])
    assert (apart >= HALF_LENGTH_M + LENGTH_M / 2.0 + 1.0).all()


def test_the_lane_that_is_left_is_still_shared_with_who_stands_in_it() -> None:
    problem = laid_out(staged(goal=LanePosition("12", 200.0)), TWO_LANES)
    left_m = np.where(np.arange(FRAMES) < 30, LANE_WIDTH_M, 40.0)  # gone after 3 s
    standing = driving(np.full(FRAMES, problem.corridor.start_m + 30.0), left_m)
    profile = found(problem, standing)
    assert (gap_m(profile, standing)[1:3] >= 1.5 + 1.2 * profile.speed_mps[1:3]).all()


@pytest.mark.parametrize(("limit_mps", "seconds"), [(5.0, 4), (4.5, 5)])
def test_a_calm_lane_change_takes_a_second_more_below_5_mps(limit_mps: float, seconds: int) -> None:
    roads = straight_road(lanes=2, length_m=300.0, limit_mps=limit_mps)
    (change,) = found(laid_out(staged(start_speed_mps=limit_mps, goal=LanePosition("12", 100.0)), roads)).changes
    assert change.to_m - change.from_m == seconds * limit_mps


def test_who_walks_after_an_ego_that_drives_off_does_not_matter() -> None:
    problem = laid_out(staged(start_speed_mps=0.0))
    still = crossing(problem.corridor.start_m - 5.7, 0.0, 0.0)
    walked_m = 1.2 * 0.1 * np.arange(FRAMES)
    behind = replace(
        still, near_m=still.near_m + walked_m, far_m=still.far_m + walked_m, along_mps=np.full((1, FRAMES), 1.2)
    )
    assert found(problem, behind).cost == found(problem).cost


@pytest.mark.parametrize(("frame", "least_m", "braking_mps2"), [(0, 30.0, 1.0), (10, 27.5, 2.0)])
def test_what_suddenly_stands_in_the_lane_is_avoided_from_a_distance_on_with_gentle_braking_at_first(
    frame: int, least_m: float, braking_mps2: float
) -> None:
    def braked(ahead_m: float) -> SpeedProfile | None:
        problem = laid_out()
        start = replace(start_of(problem.corridor), frame=frame)
        standing = driving(np.full(FRAMES, problem.corridor.start_m + ahead_m))
        return cheapest_profile(replace(problem, others=standing), start, Margins(), CALM)

    profile = braked(least_m)
    assert profile is not None
    assert profile.speed_mps[0] - profile.speed_mps[1] == braking_mps2
    assert braked(least_m - 0.5) is None


def test_who_comes_towards_the_ego_beside_its_lane_does_not_matter_but_in_it_does() -> None:
    problem = laid_out()
    start_m = problem.corridor.start_m
    alone, beside = found(problem), found(problem, steady(start_m + 150.0, -12.0, left_m=3.5))
    assert beside.cost == pytest.approx(alone.cost)
    assert timed(problem, steady(start_m + 150.0, -12.0)) is None


@pytest.mark.parametrize(("oncoming", "dawdles"), [("none", True), ("low", False)])
def test_one_waits_for_who_comes_in_the_own_lane_and_not_half_out_of_it(oncoming: Density, dawdles: bool) -> None:
    scenario = staged(start_speed_mps=5.0, obstacles=(car(60.0),), exempt=("driving_direction",))
    scenario = replace(scenario, traffic=TrafficDemand(oncoming=oncoming))
    problem = laid_out(scenario, widened(ONE_LANE), Swerve(over="left"))
    profile = found(problem, steady(problem.corridor.start_m + 80.0, -9.0, left_m=3.5))
    assert profile.to_goal
    over = problem.paths[0].over[[problem.corridor.on_grid(arc_m) for arc_m in profile.arc_m.tolist()]]
    assert (profile.speed_mps[over].min() < 2.0) == dawdles


@pytest.mark.parametrize("step", [4, 6, 9])
def test_a_gate_is_passed_when_it_has_to_be(step: int) -> None:
    problem = laid_out()
    gate = TimeGate(problem.corridor.start_m + 40.0, step)
    profile = found(problem, gate=gate)
    assert profile.arc_m[step] <= gate.arc_m + 0.25
    assert profile.arc_m[step + 1] > gate.arc_m
