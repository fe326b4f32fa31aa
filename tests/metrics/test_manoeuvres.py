"""Manoeuvres: gaps at lane changes in metres and seconds, and turning back."""

from __future__ import annotations

import numpy as np
import pytest

from interplan_sumo.metrics.diagnostics import diagnostics
from interplan_sumo.metrics.facts import Facts
from interplan_sumo.metrics.manoeuvres import REACH_M, lanes_around
from interplan_sumo.world.actors import ActorKind, Actors
from tests.metrics.staging import drive_at, facts_of, lane_y_m
from tests.worlds import cars, pedestrians, straight_road

ROAD = straight_road(lanes=3, length_m=600.0, cuts_m=((250.0, 270.0),))
FRAMES = 41
X_M = 180.0 + np.arange(FRAMES)  # 10 m/s
ACROSS = np.concatenate((np.zeros(10), np.linspace(0.0, 1.0, 21), np.ones(10)))
ARRIVES = int(np.argmax(ACROSS > 0.5))
"""The first frame with the centre past the line between the two lanes."""
BODIES_M = (5.176 + 4.8) / 2


def changing(lane_from: int = 0, lane_to: int = 1, actors: Actors | None = None, x_m: np.ndarray = X_M) -> Facts:
    y_m = lane_y_m(lane_from) + ACROSS * (lane_y_m(lane_to) - lane_y_m(lane_from))
    return facts_of(drive_at(x_m, y_m, 10.0, actors=actors), ROAD)


def gaps(facts: Facts):
    return diagnostics(facts).detail["accepted_gaps"]


def test_a_lane_change_has_a_leader_and_a_follower_in_metres_and_seconds():
    x = X_M[ARRIVES]
    (found,) = gaps(changing(actors=cars((x + 35.0, -3.5, 9.0), (x + 25.0, 0.0), (x - 20.0, -3.5, 8.0))))
    assert found["lane"] == "12"
    assert found["time_s"] == pytest.approx(0.1 * ARRIVES)
    assert found["leader"]["track"] == "car00"
    assert found["leader"]["gap_m"] == pytest.approx(35.0 - BODIES_M)
    assert found["leader"]["gap_s"] == pytest.approx((35.0 - BODIES_M) / 10.0)
    assert found["follower"]["track"] == "car02"
    assert found["follower"]["gap_m"] == pytest.approx(20.0 - BODIES_M)
    assert found["follower"]["gap_s"] == pytest.approx((20.0 - BODIES_M) / 8.0)


def test_neighbours_are_found_across_connectors_and_the_nearest_counts():
    x = 225.0 + np.arange(FRAMES)
    at = x[ARRIVES]
    (found,) = gaps(changing(actors=cars((at + 50.0, -3.5), (at + 30.0, -3.5), (at - 60.0, -3.5, 5.0)), x_m=x))
    assert found["leader"]["gap_m"] == pytest.approx(30.0 - BODIES_M, abs=1e-6)
    assert found["follower"]["gap_m"] == pytest.approx(60.0 - BODIES_M, abs=1e-6)


@pytest.mark.parametrize(("metres", "seen"), [(REACH_M - 0.1, True), (REACH_M + 0.1, False)])
def test_who_is_out_of_reach_is_no_neighbour(metres: float, seen: bool):
    x = X_M[ARRIVES]
    (found,) = gaps(changing(actors=cars((x + metres, -3.5), (x - metres, -3.5))))
    assert (found["leader"] is not None, found["follower"] is not None) == (seen, seen)


def test_a_standing_follower_needs_no_time_and_pedestrians_do_not_follow():
    x = X_M[ARRIVES]
    (found,) = gaps(changing(actors=cars((x - 20.0, -3.5, 0.0))))
    assert found["follower"]["gap_s"] is None
    (found,) = gaps(changing(actors=pedestrians((x - 20.0, -3.5, 1.0))))
    assert found["follower"] is None
    (found,) = gaps(changing(actors=cars((x - 20.0, -3.5, 4.0), kind=ActorKind.BICYCLE)))
    assert found["follower"] is not None


def there_and_back(reach_m: float, lane: int = 0) -> Facts:
    out = np.concatenate((np.zeros(5), np.linspace(0.0, reach_m, 15), np.linspace(reach_m, 0.0, 15), np.zeros(6)))
    return facts_of(drive_at(X_M, lane_y_m(lane) + out), ROAD)


def test_reaching_into_the_next_lane_and_back_is_an_aborted_change():
    spare_m = (3.5 - 2.297) / 2
    (found,) = diagnostics(there_and_back(-(spare_m + 0.2))).detail["aborted_lane_changes"]
    assert found["lane"] == "12"
    assert 0.0 < found["duration_s"] < 1.0
    assert diagnostics(there_and_back(-(spare_m - 0.01))).detail["aborted_lane_changes"] == []


@pytest.mark.parametrize("reach_m", [0.0, 2.5])
def test_keeping_the_lane_or_leaving_the_road_and_coming_back_is_none(reach_m: float):
    detail = diagnostics(there_and_back(reach_m)).detail
    assert detail["accepted_gaps"] == detail["aborted_lane_changes"] == []


def test_lanes_around_a_place_know_how_far_they_are():
    assert lanes_around(ROAD, "22", 5.0) == pytest.approx({"22": -5.0, "32": 15.0, "12": -255.0})
    assert lanes_around(ROAD, "12", 100.0) == pytest.approx({"12": -100.0})
    assert lanes_around(ROAD, "12", 150.0) == pytest.approx({"12": -150.0, "22": 100.0})
