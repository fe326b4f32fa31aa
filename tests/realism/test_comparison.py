"""Rows of a realism report: who is compared with whom, and what counts."""

from __future__ import annotations

import numpy as np
import pytest
from tracking import steady

from interplan_sumo.errors import InputError
from interplan_sumo.realism.comparison import (
    FEWEST,
    compare,
    constant_velocity,
    realism_report,
    recorded_places,
)
from interplan_sumo.realism.features import feature_samples
from interplan_sumo.realism.tracks import RecordedTraffic
from tests.realism.test_features import driven, stopping

SECONDS = 4.0


def platoon(place: str, gap_m: float, mps: float = 10.0, cars: int = 12) -> RecordedTraffic:
    """Cars behind one another at one speed."""
    tracks = [steady(f"{place} {k}", -k * (gap_m + 4.0), mps, seconds=SECONDS) for k in range(cars)]
    return RecordedTraffic(place, place, tuple(tracks))


def test_a_simulation_is_compared_with_all_places_as_one_and_with_each() -> None:
    near, far = platoon("near", 10.0), platoon("far", 30.0)
    row = realism_report({"ours": feature_samples([platoon("sim", 10.0)])}, [near, far]).rows[0]
    found = row.features["time_gap"]
    assert (row.name, row.kind) == ("ours", "run")
    assert (found.simulated.road_users, found.recorded.road_users) == (11, 22)
    assert found.ks == pytest.approx(0.5)
    assert found.wasserstein == pytest.approx(1.0)
    assert found.ks_by_place == {"near": 0.0, "far": 1.0}
    assert found.median_ks == pytest.approx(0.5)


def test_each_place_is_a_row_against_the_others_and_pairs_say_how_far_places_are_apart() -> None:
    report = realism_report({}, [platoon("a", 10.0), platoon("b", 10.0), platoon("c", 30.0)])
    rows = {row.name: row for row in report.rows if row.kind == "recording"}
    assert [*rows] == ["a", "b", "c"]
    assert rows["a"].features["time_gap"].ks == pytest.approx(0.5), "half of the others are of b"
    assert rows["c"].features["time_gap"].ks == pytest.approx(1.0)
    assert report.between_places["time_gap"] == pytest.approx(1.0), "of 0, 1 and 1"
    assert report.between_places["speed"] == 0.0


@pytest.mark.slow
def test_a_simulation_of_the_recording_itself_is_as_real_as_can_be() -> None:
    recorded = recorded_places([platoon("a", 15.0)])
    itself = compare("itself", "run", feature_samples([platoon("a", 15.0)] * 50), recorded)
    other = compare("other", "run", feature_samples([platoon("a", 5.0)] * 50), recorded)
    assert itself.realism is not None
    assert other.realism is not None
    assert itself.ceiling == other.ceiling
    assert 0.95 < (itself.share or 0.0) <= 1.0
    assert other.realism < itself.realism


def test_what_few_have_recorded_is_shown_and_not_scored() -> None:
    few = compare("x", "run", feature_samples([platoon("s", 10.0)]), recorded_places([platoon("a", 10.0, cars=FEWEST)]))
    assert few.features["speed"].likelihood is not None
    assert few.features["time_gap"].likelihood is None, "one of them follows nobody"
    assert few.features["time_gap"].ks == 0.0


def test_a_simulation_without_a_feature_has_none_of_its_likelihood_but_a_recording_is_not_blamed() -> None:
    recorded = recorded_places([platoon("a", 10.0)])
    alone = feature_samples([RecordedTraffic("s", "s", (steady("v", 0.0, 10.0),))])
    run, recording = (compare("s", kind, alone, recorded) for kind in ("run", "recording"))
    assert run.features["time_gap"].likelihood == 0.0
    assert run.features["time_gap"].ks is None
    assert recording.features["time_gap"].likelihood is None
    assert recording.realism is None, "it has one car"
    assert run.realism is not None


def test_constant_velocity_goes_on_as_the_recording_begins() -> None:
    brakes = stopping("a", 100.0)
    speeds_up = driven("b", 0.0, np.linspace(5.0, 9.0, 41))
    went = constant_velocity(RecordedTraffic("t", "t", (brakes, speeds_up, steady("short", 0.0, 9.0, seconds=0.5))))
    assert [each.id for each in went.tracks] == ["a", "b"]
    for track, mps in zip(went.tracks, (10.0, 5.7), strict=True):
        assert np.hypot(np.diff(track.x_m), np.diff(track.y_m)) == pytest.approx(0.1 * mps, rel=0.02)
    assert went.tracks[0].time_s[-1] == pytest.approx(15.0 - 0.7, abs=0.11)
    row = realism_report({}, [RecordedTraffic("t", "t", (brakes,))]).rows[0]
    assert (row.name, row.kind) == ("constant velocity", "baseline")
    assert row.features["acceleration"].simulated.values == pytest.approx(0.0, abs=1e-9)


def test_nothing_recorded_is_said_in_a_line() -> None:
    with pytest.raises(InputError, match="no recording"):
        realism_report({}, [])
    with pytest.raises(InputError, match="nobody moves in a"):
        realism_report({}, [RecordedTraffic("a", "a", (steady("v", 0.0, 0.0),))])
