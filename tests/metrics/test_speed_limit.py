"""Speed limit: overspeed averaged over the drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from interplan_sumo.metrics.speed_limit import OVERSPEED_SCALE_MPS, episodes, place_limit_mps, speed_limit
from interplan_sumo.world.geometry import Pose
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import Trace
from tests.metrics.staging import drive_at, facts_of
from tests.worlds import drive, junction, straight_road

ROAD = straight_road(length_m=500.0, limit_mps=10.0)


def with_limits(roads: Roads, **limits: float | None) -> Roads:
    lanes = {k: replace(v, speed_limit_mps=limits.get(f"lane{k}", v.speed_limit_mps)) for k, v in roads.lanes.items()}
    connectors = {
        k: replace(v, speed_limit_mps=limits.get(f"connector{k}", v.speed_limit_mps))
        for k, v in roads.connectors.items()
    }
    return replace(roads, lanes=lanes, connectors=connectors)


def cruise(*speeds_mps: float) -> Trace:
    """A drive that begins inside the first lane, not on its edge."""
    return drive(*speeds_mps, start=Pose(5.0, 0.0, 0.0))


def test_the_example_of_the_devkit():
    # 14.4 m/s on a 13.4 m/s road for 6 s: 61 samples over 60 intervals
    road = straight_road(length_m=500.0, limit_mps=13.4)
    assert speed_limit(facts_of(cruise(*[14.4] * 61), road)).score == pytest.approx(0.54409567, abs=1e-8)


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


def test_on_connectors_the_highest_limit_of_the_lanes_they_join_counts():
    roads = with_limits(junction(limit_mps=10.0), connector13=3.0, lane7=14.0)
    assert place_limit_mps(roads, ("13",)) == 14.0
    assert place_limit_mps(roads, ("12",)) == 10.0
    assert place_limit_mps(roads, ("12", "13")) == 14.0


@pytest.mark.parametrize("unknown", [None, 0.0])
def test_a_missing_or_zero_limit_disables_the_check(unknown: float | None):
    roads = with_limits(junction(limit_mps=10.0), lane7=unknown)
    assert place_limit_mps(roads, ("7",)) == float("inf")
    assert place_limit_mps(roads, ("13",)) == float("inf")
    assert place_limit_mps(roads, ("12",)) == 10.0
    assert place_limit_mps(roads, ()) == float("inf")


def test_stretches_above_the_limit_are_told_apart():
    over = np.array([0.0, 1.0, 3.0, 0.0, 0.0, 2.0, 0.0])
    assert episodes(over, np.arange(7.0)) == {"violations": 2, "max_mps": 3.0, "min_mps": 2.0, "mean_mps": 2.0}
    assert episodes(np.zeros(7), np.arange(7.0)) == {"violations": 0}


def test_a_stretch_of_the_last_frame_alone_has_no_mean():
    assert episodes(np.array([0.0, 0.0, 1.5]), np.arange(3.0))["mean_mps"] is None


def test_the_reason_names_duration_excess_and_time():
    facts = facts_of(cruise(*[9.0] * 10, *[12.0] * 10, *[9.0] * 10), ROAD)
    result = speed_limit(facts)
    assert speed_limit.lost_at(facts, result) == 10
    assert result.reason == "above the speed limit for 1.0 s, by up to 2.0 m/s at 1.0 s"
