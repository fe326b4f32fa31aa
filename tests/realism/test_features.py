"""Features of traffic that can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from tracking import DT_S, steady, track

from interplan_sumo.realism.distances import Sample
from interplan_sumo.realism.features import BY_KEY, SHAKY_MPS3, MovingTraffic, feature_samples
from interplan_sumo.realism.tracks import RecordedTraffic, Track
from interplan_sumo.world.geometry import Floats

T_S = DT_S * np.arange(151.0)


def values(key: str, *tracks: Track) -> Sample:
    """One feature of these road users."""
    return feature_samples([RecordedTraffic("tiny", "tiny", tracks)])[key]


def driven(id_: str, from_m: float, speeds_mps: Floats, **also: float) -> Track:
    """A vehicle along x with these speeds."""
    way_m = np.concatenate([[0.0], np.cumsum((speeds_mps[1:] + speeds_mps[:-1]) / 2.0 * DT_S)])
    return track(id_, from_m + way_m, **also)  # type: ignore[arg-type]


def stopping(id_: str, stops_at_m: float) -> Track:
    """A vehicle that comes at 10 m/s, brakes with 2 m/s2 from 2 s on, and stands from 7 s on."""
    speeds = np.clip(10.0 - 2.0 * (T_S - 2.0), 0.0, 10.0)
    return driven(id_, stops_at_m - 45.0, speeds)


def test_speed_and_walking_speed() -> None:
    found = feature_samples(
        [RecordedTraffic("a", "a", (steady("v", 0.0, 12.0), steady("p", 0.0, 1.3, y_m=9.0, kind="pedestrian")))]  # type: ignore[arg-type]
    )
    assert found["speed"].values == pytest.approx(12.0)
    assert found["walking_speed"].values == pytest.approx(1.3)
    assert found["speed"].road_users == found["walking_speed"].road_users == 1


def test_who_never_drives_is_parked_and_who_bides_does_not_walk() -> None:
    creeps = steady("v", 0.0, 0.9)
    assert not len(values("speed", creeps))
    assert not len(values("walking_speed", steady("p", 0.0, 0.1, kind="pedestrian")))  # type: ignore[arg-type]


def test_time_gaps_are_those_of_followers_who_are_near_and_fast() -> None:
    def gaps(ahead_m: float, mps: float) -> Sample:
        return values("time_gap", steady("behind", 0.0, mps), steady("ahead", ahead_m + 4.0, mps))

    assert gaps(20.0, 10.0).values == pytest.approx(2.0)
    assert gaps(20.0, 10.0).road_users == 1
    assert len(gaps(59.0, 10.0))
    assert not len(gaps(61.0, 10.0))
    assert not len(gaps(20.0, 2.9))


def test_speed_is_free_for_who_has_time_and_changes_nothing() -> None:
    assert values("free_speed", steady("a", 0.0, 12.0)).values.tolist() == pytest.approx([12.0])
    close = steady("behind", 0.0, 10.0), steady("ahead", 39.0 + 4.0, 10.0)
    assert values("free_speed", *close).road_users == 1, "only the one ahead"
    far = steady("behind", 0.0, 10.0), steady("ahead", 41.0 + 4.0, 10.0)
    assert values("free_speed", *far).road_users == 2
    assert not len(values("free_speed", driven("a", 0.0, 8.0 + 0.4 * T_S)))


def test_strongest_acceleration_is_of_each_five_seconds() -> None:
    # Seen from 0.7 to 14.3 s: two whole stretches, until 5.7 and 10.7 s; it speeds up from 7 s on.
    speeds = 5.0 + 1.2 * np.clip(T_S - 7.0, 0.0, 3.0)
    found = values("strongest_acceleration", driven("a", 0.0, speeds))
    assert found.values == pytest.approx([0.0, 1.2], abs=0.02)
    assert not len(values("strongest_acceleration", driven("a", 0.0, speeds[:60])))
    # Who only brakes accelerates by nothing, not by less than nothing.
    assert values("strongest_acceleration", driven("a", 0.0, 20.0 - T_S)).values == pytest.approx([0.0, 0.0])


def test_a_shaky_track_tells_no_acceleration_but_gaps() -> None:
    shaken = track("behind", 10.0 * T_S + 0.8 * np.sin(np.pi * T_S))
    ahead = steady("ahead", 30.0, 10.0, seconds=15.0)
    found = feature_samples([RecordedTraffic("a", "a", (shaken, ahead))])
    assert np.median(np.abs(MovingTraffic.of(RecordedTraffic("a", "a", (shaken,))).vehicles[0].jerk_mps3)) > SHAKY_MPS3
    assert found["acceleration"].road_users == found["jerk"].road_users == 1
    assert found["time_gap"].road_users == 1


def test_yaw_rate_of_a_circle() -> None:
    angle = 0.25 * T_S
    circle = track("a", 20.0 * np.sin(angle), 20.0 * (1.0 - np.cos(angle)))
    assert values("yaw_rate", circle).values == pytest.approx(0.25, abs=0.01)


def test_the_standstill_gap_is_counted_once_a_stop() -> None:
    queue = stopping("first", 100.0), stopping("second", 100.0 - 4.0 - 2.5), stopping("third", 100.0 - 4.0 - 2.5 - 14.5)
    assert values("standstill_gap", *queue).values == pytest.approx([2.5], abs=0.01), "the third is 10.5 m behind"


def test_parked_cars_are_no_queue_but_who_stands_in_one_that_moves_is() -> None:
    parked = steady("a", 0.0, 0.0), steady("b", 6.0, 0.0)
    assert not len(values("standstill_gap", *parked))
    waiting = steady("a", 100.0, 0.0, seconds=15.0), steady("b", 107.0, 0.0, seconds=15.0)
    found = values("standstill_gap", *waiting, stopping("c", 94.0))
    assert sorted(found.values) == pytest.approx([2.0, 3.0], abs=0.01)


def test_braking_begins_at_a_time_to_collision_and_with_a_deceleration() -> None:
    # 8 s before it would reach who goes at 4 m/s it begins to brake with 1.5 m/s2.
    speeds = np.clip(12.0 - 1.5 * np.clip(T_S - 4.0, 0.0, None), 4.0, None)
    behind, ahead = driven("behind", 0.0, speeds), steady("ahead", 4.0 + 4.0 * 8.0 + 8.0 * 8.0, 4.0, seconds=15.0)
    assert values("ttc_at_brake_onset", behind, ahead).values == pytest.approx([8.0], abs=0.6)
    assert values("deceleration_at_onset", behind, ahead).values == pytest.approx([1.5], abs=0.1)
    coasting = driven("behind", 0.0, 12.0 - 0.4 * np.clip(T_S - 4.0, 0.0, None))
    assert not len(values("deceleration_at_onset", coasting, ahead)), "0.4 m/s2 is no braking"


def changing(takes_s: float, aside_m: float = 3.5, mps: float = 15.0) -> Track:
    """A vehicle that moves aside at an even pace from 5 s on."""
    return track("changer", mps * T_S, aside_m * np.clip((T_S - 5.0) / takes_s, 0.0, 1.0))


def test_a_lane_change_lasts_from_5_to_95_percent_of_the_way() -> None:
    for takes_s in (3.0, 5.0):
        assert values("lane_change_duration", changing(takes_s)).values == pytest.approx([0.9 * takes_s], abs=0.5)
    for no_change in (changing(4.0, aside_m=2.0), changing(4.0, aside_m=5.5), changing(4.0, mps=1.8)):
        assert not len(values("lane_change_duration", no_change))


def test_who_drives_round_a_bend_or_along_a_slanted_road_changes_no_lane() -> None:
    angle = 15.0 / 100.0 * T_S
    assert not len(values("lane_change_duration", track("a", 100.0 * np.sin(angle), 100.0 * (1.0 - np.cos(angle)))))
    assert not len(values("lane_change_duration", track("a", 15.0 * T_S, 1.0 * T_S)))


def test_gaps_of_a_lane_change_are_to_whom_it_joins() -> None:
    lead = steady("lead", 34.0, 15.0, seconds=15.0, y_m=3.5)
    lag = steady("lag", -24.0, 15.0, seconds=15.0, y_m=3.5)
    left_behind = steady("old leader", 20.0, 15.0, seconds=15.0)
    found = feature_samples([RecordedTraffic("a", "a", (changing(4.0), lead, lag, left_behind))])
    assert found["lane_change_lead_gap"].values == pytest.approx([2.0], abs=0.05)
    assert found["lane_change_lag_gap"].values == pytest.approx([20.0 / 15.0], abs=0.05)
    assert not len(values("lane_change_lead_gap", changing(4.0), left_behind))


def test_nobody_of_one_recording_meets_anybody_of_another() -> None:
    behind, ahead = steady("a", 0.0, 10.0), steady("b", 24.0, 10.0)
    apart = feature_samples([RecordedTraffic("a", "a", (behind,)), RecordedTraffic("b", "b", (ahead,))])
    assert not len(apart["time_gap"])
    assert apart["speed"].road_users == 2


def test_recordings_of_nobody_have_no_values() -> None:
    found = feature_samples([RecordedTraffic("a", "a", ())])
    assert found.keys() == BY_KEY.keys()
    assert not any(map(len, found.values()))
