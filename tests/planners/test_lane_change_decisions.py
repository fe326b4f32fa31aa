from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from interplan_planners.common.gaps import Ego, GapRules, best_gap, clearances_needed_m
from interplan_planners.common.idm_policy import IdmDriver
from interplan_planners.common.mobil import ENTRY_S, Side, judge, side_of
from interplan_planners.common.neighbours import LaneQueue

RULES = GapRules()
DRIVER = IdmDriver(15.0, min_gap_m=1.0, headway_s=0.8)
FREE = Side(200.0, 0.0, float("inf"), 0.0, 15.0)


def queue(*places: tuple[float, float]) -> LaneQueue:
    """Cars of 5 m, from (middle, speed), back to front."""
    middle, speed = np.array(places, dtype=np.float64).reshape(-1, 2).T
    return LaneQueue(np.arange(len(places)), middle - 2.5, middle + 2.5, speed)


def gap_in(
    *places: tuple[float, float], speed: float = 10.0, room_m: float = 200.0, lead: tuple[float, float] | None = None
):
    return best_gap(Ego(100.0, speed, 5.0), queue(*places), RULES, 15.0, lead, room_m)


@pytest.mark.parametrize(("places", "index"), [((), 0), (((75.0, 10.0), (125.0, 10.0)), 1)], ids=["empty", "two cars"])
def test_the_gap_beside_the_ego_is_taken_at_once(places: tuple[tuple[float, float], ...], index: int) -> None:
    found = gap_in(*places)
    assert found is not None
    assert (found.index, found.acceleration_mps2, found.wait_s) == (index, 0.0, RULES.step_s)
    assert gap_in(*places, room_m=3.0) is None


def test_beside_a_car_one_drops_back_or_passes() -> None:
    behind = gap_in((100.0, 10.0))
    assert behind is not None
    assert (behind.index == 0) is (behind.acceleration_mps2 < 0.0)
    blocked_ahead = gap_in((100.0, 10.0), (112.0, 10.0), (124.0, 10.0))
    assert blocked_ahead is not None
    assert blocked_ahead.index == 0
    assert blocked_ahead.acceleration_mps2 < 0.0


def test_gaps_too_small_are_passed_over() -> None:
    found = gap_in(*((60.0 + 14.0 * i, 10.0) for i in range(8)))
    assert found is None or found.index in (0, 8)


def test_the_own_lead_bars_the_way_past() -> None:
    places = ((80.0, 10.0), (95.0, 10.0), (110.0, 10.0))
    free, led = gap_in(*places, speed=12.0), gap_in(*places, speed=12.0, lead=(5.0, 10.0))
    assert led is not None
    assert free is not None
    assert led.index < 3


@given(speed=st.floats(0.0, 20.0), ahead=st.floats(0.0, 20.0), behind=st.floats(0.0, 20.0), faster=st.floats(0.0, 5.0))
def test_closing_faster_needs_more_room(speed: float, ahead: float, behind: float, faster: float) -> None:
    before, after = clearances_needed_m(RULES, speed, ahead, behind)
    assert clearances_needed_m(RULES, speed, ahead, behind + faster)[1] >= after
    assert clearances_needed_m(RULES, speed + faster, ahead, behind)[0] >= before


@given(seed=st.integers(0, 2**31))
def test_a_chosen_gap_is_one_when_it_is_reached(seed: int) -> None:
    """Carried on at constant speeds, both clearances are there."""
    rng = np.random.default_rng(seed)
    middle = np.cumsum(rng.uniform(8.0, 40.0, 6)) + 20.0
    cars = queue(*zip(middle.tolist(), rng.uniform(2.0, 14.0, 6).tolist(), strict=True))
    found = best_gap(Ego(100.0, 9.0, 5.0), cars, RULES, 15.0, None, 150.0)
    if found is None:
        return
    a, t = found.acceleration_mps2, found.wait_s
    stops_s = 9.0 / -a if a < 0 else 6.0 / a if a > 0 else np.inf
    push = min(t, stops_s)
    at = 100.0 + 9.0 * push + 0.5 * a * push**2 + (9.0 + a * push) * (t - push)
    rears, fronts = cars.rear_m + cars.speed_mps * t, cars.front_m + cars.speed_mps * t
    if found.index < 6:
        assert rears[found.index] - at - 2.5 >= RULES.min_gap_m
    if found.index > 0:
        assert at - 2.5 - fronts[found.index - 1] >= RULES.min_gap_m


def verdict(here: Side, there: Side, speed: float = 10.0):
    return judge(here, there, speed, 5.0, DRIVER, RULES, 0.5, 2.0)


def test_a_side_is_told_in_gaps() -> None:
    side = side_of(queue((80.0, 9.0), (130.0, 7.0)), 100.0, 2.5, 300.0, 15.0)
    assert (side.gap_m, side.lead_mps) == (25.0, 7.0)
    assert (side.follower_gap_m, side.follower_mps) == (15.0, 9.0)
    nobody = side_of(queue(), 100.0, 2.5, 300.0, 15.0)
    assert (nobody.gap_m, nobody.follower_gap_m) == (197.5, float("inf"))


def test_what_stands_at_the_end_hides_what_is_beyond() -> None:
    assert side_of(queue((200.0, 9.0)), 100.0, 2.5, 150.0, 15.0).gap_m == 47.5


def test_a_free_lane_beside_a_slow_lead_is_worth_it() -> None:
    found = verdict(replace(FREE, gap_m=10.0, lead_mps=5.0), FREE)
    assert found.safe
    assert found.incentive_mps2 > 1.0


def test_equal_lanes_give_no_incentive() -> None:
    assert verdict(FREE, FREE).incentive_mps2 == pytest.approx(0.0, abs=0.01)


def test_a_follower_who_must_brake_counts_by_politeness() -> None:
    there = replace(FREE, follower_gap_m=20.0, follower_mps=12.0)
    polite = judge(FREE, there, 10.0, 5.0, DRIVER, RULES, 0.5, 2.0)
    rude = judge(FREE, there, 10.0, 5.0, DRIVER, RULES, 0.0, 2.0)
    assert rude.incentive_mps2 == pytest.approx(0.0, abs=0.01)
    assert polite.incentive_mps2 < -0.1


@pytest.mark.parametrize(("gap_m", "safe"), [(60.0, True), (25.0, False)])
def test_a_fast_follower_needs_distance(gap_m: float, safe: bool) -> None:
    assert verdict(FREE, replace(FREE, follower_gap_m=gap_m, follower_mps=16.0)).safe is safe


@pytest.mark.parametrize("side", [replace(FREE, gap_m=0.4, lead_mps=30.0), replace(FREE, follower_gap_m=-2.0)])
def test_nobody_may_be_alongside(side: Side) -> None:
    assert not verdict(FREE, side).safe


def test_gaps_count_as_they_will_be_when_the_ego_gets_there() -> None:
    opening, closing = replace(FREE, gap_m=4.0, lead_mps=14.0), replace(FREE, gap_m=10.0, lead_mps=6.0)
    assert verdict(FREE, opening).safe
    assert not verdict(FREE, closing).safe
    assert opening.later(10.0, ENTRY_S).gap_m == pytest.approx(4.0 + 4.0 * ENTRY_S)


@pytest.mark.parametrize(
    ("side", "closes"),
    [
        (FREE, False),
        (replace(FREE, gap_m=0.2, lead_mps=10.0), True),
        (replace(FREE, follower_gap_m=5.0, follower_mps=10.5), False),
        (replace(FREE, follower_gap_m=5.0, follower_mps=17.0), True),
        (replace(FREE, follower_gap_m=0.8, follower_mps=11.5), True),
    ],
)
def test_a_gap_closes_when_it_is_gone_or_takes_hard_braking(side: Side, closes: bool) -> None:
    assert side.closes(10.0, 3.5, 0.3, 0.5) is closes
