"""Lane crossings: from the first frame astride to the first frame in a lane again."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.metrics.lane_crossings import Crossing, find_crossings, lane_crossings
from tests.metrics.staging import drive_at, facts_of
from tests.worlds import straight_road

ROAD = straight_road(lanes=2, length_m=200.0, cuts_m=((90.0, 110.0),))
ONE, TWO, NEXT, ASTRIDE, OFF = frozenset({"11"}), frozenset({"12"}), frozenset({"21"}), None, frozenset[str]()


def crossings(*body: frozenset[str] | None) -> tuple[Crossing, ...]:
    return find_crossings(ROAD, body, np.arange(len(body)) * 1_000_000)


def test_a_change_of_lane_succeeds():
    assert crossings(ONE, ASTRIDE, ASTRIDE, TWO, TWO) == (Crossing(1, 3, 2.0, True),)


def test_a_return_to_the_same_lane_or_its_successor_fails():
    assert [c.success for c in crossings(ONE, ASTRIDE, ONE)] == [False]
    assert [c.success for c in crossings(ONE, ASTRIDE, NEXT)] == [False]


def test_leaving_all_lanes_or_the_end_of_the_drive_fails():
    assert crossings(ONE, ASTRIDE, OFF) == (Crossing(1, 2, 1.0, False),)
    assert crossings(ONE, ASTRIDE, ASTRIDE, ASTRIDE) == (Crossing(1, 3, 2.0, False),)


def test_a_drive_that_begins_astride_or_off_the_lanes_has_no_crossing_there():
    assert crossings(ASTRIDE, ASTRIDE, ONE) == ()
    assert crossings(OFF, ASTRIDE, ONE) == ()
    assert crossings() == crossings(ONE) == ()


@pytest.mark.parametrize(("failed", "within"), [(3, True), (4, False)])
def test_three_failures_in_ten_are_within_nuplans_bound(failed: int, within: bool):
    body: list[frozenset[str] | None] = [ONE]
    for number in range(10):
        body += [ASTRIDE, body[-1] if number < failed else TWO if body[-1] == ONE else ONE]
    facts = facts_of(drive_at(20.0 + np.arange(float(len(body)))), ROAD)
    facts.__dict__["body_lanes"] = tuple(body)  # where the body is said to be, instead of a drive that long
    detail = lane_crossings(facts).detail
    assert (detail["count"], detail["failed_share_within"]) == (10, within)
