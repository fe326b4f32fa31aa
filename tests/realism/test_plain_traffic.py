"""Plain traffic on a shipped network: the same arrivals for every file, and drivers who are as their file says."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from overlapping import overlaps
from tracking import steady, track

from interplan_sumo.maps.store import find_map
from interplan_sumo.realism.features import feature_samples
from interplan_sumo.realism.plain_traffic import ENTRY_S, LASTS_S, traffic_on
from interplan_sumo.realism.tracks import RecordedTraffic
from interplan_sumo.simulation.network import read_network
from interplan_sumo.simulation.vehicle_types import read_vehicle_types, vehicle_type_file

FILL_S = 60.0


@cache
def simulated(behaviour: str, seed: int = 0) -> RecordedTraffic:
    types = read_vehicle_types(vehicle_type_file(behaviour))
    return traffic_on(read_network(find_map("back_bay").network), types, behaviour, seed, fill_s=FILL_S)


@pytest.mark.slow
def test_a_seed_says_who_comes_when_and_where() -> None:
    one, again = simulated("conservative"), simulated.__wrapped__("conservative")
    assert [each.id for each in one.tracks] == [each.id for each in again.tracks]
    assert all(np.array_equal(a.x_m, b.x_m) for a, b in zip(one.tracks, again.tracks, strict=True))
    other = simulated("conservative", seed=1)
    assert [len(each.time_s) for each in one.tracks] != [len(each.time_s) for each in other.tracks]


@pytest.mark.slow
def test_other_drivers_come_at_the_same_places() -> None:
    gentle, rude = ({each.id: each for each in simulated(name).tracks} for name in ("conservative", "assertive"))
    late = [id_ for id_ in gentle.keys() & rude.keys() if gentle[id_].time_s[0] > FILL_S + ENTRY_S + 1.0]
    assert len(late) > 30
    apart = [np.hypot(gentle[i].x_m[0] - rude[i].x_m[0], gentle[i].y_m[0] - rude[i].y_m[0]) for i in late]
    assert np.median(apart) < 5.0


def test_tracks_are_a_minute_of_vehicles_after_the_network_has_filled_up() -> None:
    tracks = simulated("conservative").tracks
    assert min(each.time_s[0] for each in tracks) == pytest.approx(FILL_S)
    assert max(each.time_s[-1] for each in tracks) == pytest.approx(FILL_S + LASTS_S, abs=0.11)
    assert len(tracks) > 150
    for each in tracks:
        moved = np.hypot(np.diff(each.x_m), np.diff(each.y_m)) / 0.1
        assert np.median(np.abs(moved - each.speed_mps[1:])) < 0.2, each.id


@pytest.mark.nightly
def test_drivers_stand_and_follow_as_their_file_has_it() -> None:
    found = feature_samples([simulated("conservative")])
    assert found["standstill_gap"].road_users > 50
    assert found["standstill_gap"].quantile(0.5) == pytest.approx(1.0, abs=0.1)
    assert found["time_gap"].quantile(0.05) > 1.5
    assert found["strongest_acceleration"].quantile(1.0) < 1.2
    assert feature_samples([simulated("assertive")])["time_gap"].quantile(0.05) < 1.4


@pytest.mark.nightly
@pytest.mark.parametrize("behaviour", ["measured_city", "measured_city_bold"])
def test_measured_drivers_drive_into_nobody(behaviour: str) -> None:
    types = read_vehicle_types(vehicle_type_file(behaviour))
    found = overlaps(traffic_on(read_network(find_map("strip").network), types, behaviour, 0, lane_rate_hz=0.2))
    assert found.agent_s > 10_000.0
    assert not found.behind


def test_overlaps_are_told() -> None:
    into, apart = (steady("b", from_m, 0.0) for from_m in (3.9, 4.1))
    aslant = track("c", np.full(101, 3.9), heading_rad=0.5)
    stands = steady("a", 0.0, 0.0)
    assert overlaps(RecordedTraffic("x", "x", (stands, into))).behind == {("a", "b")}
    assert not overlaps(RecordedTraffic("x", "x", (stands, apart))).behind
    assert overlaps(RecordedTraffic("x", "x", (stands, aslant))).aslant == {("a", "c")}
