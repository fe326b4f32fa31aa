"""Speed limit: overspeed averaged over the drive."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.metrics.speed_limit import OVERSPEED_SCALE_MPS, speed_limit
from interplan_sumo.world.geometry import Pose
from interplan_sumo.world.trace import Trace
from tests.metrics.staging import drive_at, facts_of
from tests.worlds import drive, straight_road

ROAD = straight_road(length_m=500.0, limit_mps=10.0)


def cruise(*speeds_mps: float) -> Trace:
    """A drive that begins inside the first lane, not on its edge."""
    return drive(*speeds_mps, start=Pose(5.0, 0.0, 0.0))


@pytest.mark.parametrize("over_mps", [0.0, 1e-6])
def test_the_limit_itself_is_allowed(over_mps: float):
    expected = 1.0 - over_mps * 31 / 30 / OVERSPEED_SCALE_MPS
    assert speed_limit(facts_of(cruise(*[10.0 + over_mps] * 31), ROAD)).score == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(("more_mps", "zero"), [(-1e-6, False), (1e-6, True)])
def test_the_scale_is_where_the_score_ends(more_mps: float, zero: bool):
    score = speed_limit(facts_of(cruise(*[10.0 + OVERSPEED_SCALE_MPS * 30 / 31 + more_mps] * 31), ROAD)).score
    assert score is not None
    assert (score == 0.0) is zero


def test_backing_is_as_fast_as_driving_on():
    facts = facts_of(drive_at(100.0 - np.arange(31) * 1.2, 0.0, -12.0), ROAD)
    assert facts.speed_mps[0] == 12.0
    assert speed_limit(facts).detail["max_mps"] == pytest.approx(2.0)


def test_the_reason_names_duration_excess_and_time():
    facts = facts_of(cruise(*[9.0] * 10, *[12.0] * 10, *[9.0] * 10), ROAD)
    result = speed_limit(facts)
    assert speed_limit.lost_at(facts, result) == 10
    assert result.reason == "above the speed limit for 1.0 s, by up to 2.0 m/s at 1.0 s"
