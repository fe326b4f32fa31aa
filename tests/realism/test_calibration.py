"""Drivers fitted to recordings: known ones are found again, and what is written can be driven."""

from __future__ import annotations

import json
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import ran
from defusedxml import ElementTree
from realdata import real
from tracking import DT_S, moved, steady, track

from interplan_sumo.errors import InputError
from interplan_sumo.realism.calibration import Calibration, CalibrationOptions, calibrate
from interplan_sumo.realism.driver_population import BOUNDS, QUALITIES, DriverPopulation
from interplan_sumo.realism.following import Following
from interplan_sumo.realism.held_out import held_out
from interplan_sumo.realism.observed_drivers import ObservedDriver, ObservedDrivers, wavering_mps2
from interplan_sumo.realism.published import PRIORS
from interplan_sumo.realism.tracks import RecordedTraffic, Track, open_recordings
from interplan_sumo.realism.vehicle_type_writer import ERROR, WAVERS, vehicle_type_text
from interplan_sumo.simulation.vehicle_types import read_vehicle_types, vehicle_type_file
from interplan_sumo.world.geometry import Floats

LIMIT_MPS = 13.9
KNOWN = np.array([1.3, 2.5, 1.4, 2.0, 0.95])
"""T, s0, a, b and the speed factor of the driver in the middle."""


def way_of_a_leader(rng: np.random.Generator, seconds: float) -> Floats:
    """Drives, slows down, stops and starts like somebody in a city, now and then faster than others want to be."""
    speed, wanted, way = 8.0, 8.0, [0.0]
    for _ in range(round(seconds / DT_S)):
        if rng.random() < DT_S / 10.0:
            wanted = float(rng.choice([0.0, 3.0, 7.0, 11.0, 18.0]))
        speed = max(0.0, speed + float(np.clip(wanted - speed, -2.0 * DT_S, 1.5 * DT_S)))
        way.append(way[-1] + speed * DT_S)
    return np.array(way)


def way_of_a_follower(leader_m: Floats, driver: Floats, start_m: float) -> Floats:
    """The textbook's IDM, one step after the other, 4 m behind the middle of a leader of 4 m plus its gap."""
    time_gap_s, standstill_m, accel, decel, factor = driver.tolist()
    at, speed, way = start_m, 8.0, [start_m]
    for before, now in pairwise(leader_m):
        ahead = (now - before) / DT_S
        wish = standstill_m + max(0.0, speed * time_gap_s + speed * (speed - ahead) / 2.0 / (accel * decel) ** 0.5)
        pull = 1.0 - (speed / (factor * LIMIT_MPS)) ** 4 - (wish / (before - at - 4.0)) ** 2
        speed = max(0.0, speed + accel * pull * DT_S)
        at += speed * DT_S
        way.append(at)
    return np.array(way)


@cache
def known_drivers() -> tuple[Floats, Calibration]:
    """Thirty drivers, each behind a leader on a street of its own, and what is fitted to them."""
    rng = np.random.default_rng(3)
    drivers = KNOWN * np.exp(rng.normal(size=(30, 5)) * [0.25, 0.25, 0.25, 0.25, 0.08])
    tracks: list[Track] = []
    for number, driver in enumerate(drivers):
        leader_m = way_of_a_leader(rng, 80.0)
        follower_m = way_of_a_follower(leader_m, driver, -4.0 - driver[1] - 8.0 * driver[0] - 3.0)
        tracks += [track(f"a{number}", leader_m, 50.0 * number), track(f"b{number}", follower_m, 50.0 * number)]
    recording = RecordedTraffic("street_1", "street", tuple(tracks))
    return drivers, calibrate([recording], CalibrationOptions(limits_mps={"street": LIMIT_MPS}, as_fitted=True))


@pytest.mark.nightly
def test_known_drivers_are_found_again() -> None:
    drivers, found = known_drivers()
    followers = [n for n, each in enumerate(found.drivers.drivers) if each.episodes]
    ids = [int(found.drivers.drivers[n].episodes[0].follower.track.id[1:]) for n in followers]
    assert len(ids) == 30
    error = np.abs(np.exp(found.fit.drivers[followers]) / drivers[ids] - 1.0)
    assert (np.median(error, axis=0) <= 0.1).all()
    middle = np.median(drivers, axis=0)[:4]  # leaders show speeds, too, that they took for no driver's reasons
    assert np.exp(found.fit.mean[:4]) == pytest.approx(middle, rel=0.15)


def test_who_wavers_is_told_and_who_keeps_still_or_speeds_up_is_not() -> None:
    time_s = np.arange(0.0, 20.0, DT_S)
    waves = moved(track("w", 10.0 * time_s + 0.5 * np.sin(time_s)))  # accelerates by 0.5 m/s2 at most
    assert wavering_mps2(waves) == pytest.approx(0.5 / np.sqrt(2.0), rel=0.15)
    assert wavering_mps2(moved(steady("s", 0.0, 10.0))) == pytest.approx(0.0, abs=1e-6)
    assert np.isnan(wavering_mps2(moved(track("a", 6.0 * time_s + 0.5 * time_s**2))))


def test_drivers_who_waver_as_measured_err_by_a_share_of_their_acceleration_and_never_by_too_much() -> None:
    drivers = np.array([[1.0, 3.0, accel, 1.5, 1.0, 0.9, gap, 4.0] for accel, gap in ((3.0, 0.5), (1.0, 0.1))])
    types = ElementTree.fromstring(vehicle_type_text(drivers, 0.4, []).encode()).iter("vType")
    found = [(float(e.attrib["sigmaerror"]), float(e.attrib["lcAssertive"])) for e in types]
    assert found[0] == pytest.approx((0.4 / WAVERS / 3.0, 2.0), abs=1e-3)
    assert found[1] == (ERROR, 2.0)


@pytest.mark.nightly
def test_the_spacing_of_fitted_drivers_is_right_to_a_metre() -> None:
    assert np.median(known_drivers()[1].rmse_m) < 0.5


@pytest.mark.slow
def test_drawn_drivers_are_those_of_the_population_and_the_same_every_time() -> None:
    population = known_drivers()[1].population
    drawn = population.drawn(1024)
    assert np.median(drawn, axis=0) == pytest.approx(np.exp(population.mean), rel=0.03)
    assert np.array_equal(drawn, population.drawn(1024))
    assert ((BOUNDS[:, 0] <= drawn) & (drawn <= BOUNDS[:, 1])).all()


def test_a_shift_makes_the_middle_driver_what_a_quantile_was() -> None:
    population = DriverPopulation(np.log([1.0, 3.0, 1.5, 1.5, 1.0, 0.9, 0.5, 4.0]), 0.04 * np.eye(8))
    measured, mild, bold = (population.drawn(2048, shift) for shift in (0.0, 0.25, -0.25))
    for name, to_mild in (("time_gap_s", 75), ("standstill_gap_m", 75), ("accel_mps2", 25), ("speed_factor", 25)):
        column = QUALITIES.index(name)
        assert np.median(mild[:, column]) == pytest.approx(np.percentile(measured[:, column], to_mild), rel=0.01)
        assert np.median(bold[:, column]) == pytest.approx(np.percentile(measured[:, column], 100 - to_mild), rel=0.01)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"count": 4}, "4 drivers are asked for, expected 8"),
        ({"shift": 0.5}, "the shift is 0.5"),
        ({"road": "alley"}, "the road is 'alley', expected city or motorway"),
        ({"limits_mps": {"street": 0.5}}, "the limit of street is 0.5 m/s"),
        ({"limits_mps": {"strete": 9.0}}, "'strete'; the places of these recordings are street"),
    ],
)
def test_options_that_cannot_be_are_told(options: dict[str, Any], said: str) -> None:
    pair = (steady("a", 0.0, 10.0), steady("b", 20.0, 10.0))
    with pytest.raises(InputError, match=said):
        calibrate([RecordedTraffic("street_1", "street", pair)], CalibrationOptions(**options))


def test_recordings_in_which_nobody_follows_are_told() -> None:
    with pytest.raises(InputError, match="nobody follows anybody"):
        calibrate([RecordedTraffic("street_1", "street", (steady("a", 0.0, 10.0),))])


@pytest.mark.nightly
def test_real_recordings_become_a_file_that_sumo_s_schema_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [real("tracks", f"{name}.parquet") for name in ("ngsim_lankershim_1", "nuplan_las_vegas_1", "av2_sensor_1")]
    out = tmp_path / "mine.xml"
    code, said, _ = ran(capsys, "traffic", "calibrate", *files, "--out", out, "--date", "2026", "--as-fitted", "--json")
    assert code == 0
    document = json.loads(said)
    assert document["rmse_m"]["median"] < 1.0
    assert document["held_out"]["own_rmse_m"] < 1.0
    assert len(document["held_out"]["places"]) == 3
    types = read_vehicle_types(out)
    assert (len(types.members), types.warnings) == (64, ())
    text = out.read_text()
    assert "Date: 2026." in text
    assert ran(capsys, "traffic", "calibrate", *files, "--out", out, "--date", "2026")[0] == 0
    assert out.read_text() == text, "not the same to the byte"


def test_a_place_whose_others_only_queued_is_not_left_out() -> None:
    at_s = np.arange(40, dtype=np.float64) / 10.0
    nobody: Any = None  # who it was is not asked here
    follows = Following(nobody, nobody, at_s, 10.0 + at_s, np.full(40, 8.0), np.full(40, 9.0), np.zeros(40))
    drivers = [ObservedDriver("a", (follows,), (), np.nan, np.nan, np.nan, False) for _ in range(6)]
    queued = ObservedDriver("b", (), (), np.nan, 2.0, np.nan, False)
    seen = ObservedDrivers((*drivers, queued), {"a": 13.0, "b": 13.0}, np.zeros(0))
    assert held_out(seen, PRIORS["city"]).places == ()


def test_a_limit_that_is_none_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ("traffic", "calibrate", tmp_path, "--out", tmp_path / "mine.xml")
    assert ran(capsys, *asked, "--limit", "street")[::2] == (
        2, "error: --limit is 'street', expected PLACE=MPS such as main_street=13.9\n"
    )  # fmt: skip


@pytest.mark.parametrize("name", ["measured_city", "measured_motorway"])
def test_shipped_measured_drivers_differ_and_have_milder_and_bolder_versions(name: str) -> None:
    measured, mild, bold = (read_vehicle_types(vehicle_type_file(name + end)).members for end in ("", "_mild", "_bold"))
    assert len({(each.tau_s, each.min_gap_m) for each in measured}) == 64
    for quality, towards_mild in (("tau_s", 1), ("min_gap_m", 1), ("accel_mps2", -1), ("speed_factor", -1)):
        middles = [np.median([getattr(each, quality) for each in some]) for some in (bold, measured, mild)]
        assert np.all(towards_mild * np.diff(middles) > 0.0), quality


@pytest.mark.slow
def test_pooled_city_recordings_are_open() -> None:
    assert len({each.place for each in open_recordings([real("tracks")])}) >= 6


def test_what_a_source_is_called_never_breaks_the_file() -> None:
    text = vehicle_type_text(np.ones((1, 8)), 0.4, ["a---b --> <vType> -"])
    assert ElementTree.fromstring(text.encode()).find("vTypeDistribution") is not None
