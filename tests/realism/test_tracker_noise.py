"""The noise of recorded positions: told by what no vehicle can do, and put on simulated ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tracking import DT_S, moved, track

from interplan_sumo.realism.features import feature_samples
from interplan_sumo.realism.tracker_noise import NO_NOISE, TrackerNoise
from interplan_sumo.realism.tracks import RecordedTraffic

TIME_S = np.arange(0.0, 30.0, DT_S)


def waving(id_: str) -> RecordedTraffic:
    """A car that brakes and speeds up by 1.5 m/s2 and more, smoothly, towards 30 degrees."""
    way_m = 10.0 * TIME_S + 5.0 * np.sin(TIME_S / 1.8)
    heading_rad = np.pi / 6.0
    one = track(id_, way_m * np.cos(heading_rad), way_m * np.sin(heading_rad), heading_rad=heading_rad)
    return RecordedTraffic(id_, id_, (one,))


def shaken(along_m: float, across_m: float) -> RecordedTraffic:
    return TrackerNoise(np.array([[along_m, across_m]])).on(waving("a"))


def test_smooth_driving_is_no_noise() -> None:
    assert TrackerNoise.of([waving("a")]).sigma_m == pytest.approx(0.0, abs=1e-4)


def test_noise_that_was_put_on_is_found_again_along_and_across() -> None:
    assert TrackerNoise.of([shaken(0.05, 0.01)]).sigma_m[0] == pytest.approx([0.05, 0.01], rel=0.15)


def test_what_hardly_drives_tells_nothing_and_without_noise_nothing_changes() -> None:
    stands = RecordedTraffic("s", "s", (track("s", np.zeros(300)),))
    assert len(TrackerNoise.of([stands]).sigma_m) == 0
    assert NO_NOISE.on(stands) is stands


def test_who_walks_is_not_shaken_and_drawing_is_the_same_every_time() -> None:
    both = replace(waving("a"), tracks=(*waving("a").tracks, track("w", 1.3 * TIME_S, 5.0, kind="pedestrian")))
    one, again = (TrackerNoise(np.array([[0.05, 0.01], [0.1, 0.02]])).on(both) for _ in range(2))
    assert np.array_equal(one.tracks[1].x_m, both.tracks[1].x_m)
    assert np.array_equal(one.tracks[0].x_m, again.tracks[0].x_m)
    assert not np.array_equal(one.tracks[0].x_m, both.tracks[0].x_m)


def test_usual_noise_makes_jerks_and_hardly_any_strong_accelerations() -> None:
    exact, seen = (moved(each.tracks[0]) for each in (waving("a"), shaken(0.04, 0.01)))
    assert abs(seen.acceleration_mps2.max() - exact.acceleration_mps2.max()) < 0.25
    assert np.std(seen.jerk_mps3) > np.std(exact.jerk_mps3)
    steady = RecordedTraffic("s", "s", (track("s", 10.0 * TIME_S),))
    found = feature_samples([TrackerNoise(np.array([[0.04, 0.01]])).on(steady)])
    assert found["strongest_acceleration"].quantile(0.5) < 0.3
