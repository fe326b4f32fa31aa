"""Certificates: what is found passes, is found again and survives its file; what was tampered with is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.errors import InputError
from interplan_sumo.maps.store import load_roads
from interplan_sumo.proving.certificates import BAR, DENSE_BAR, bar, certify, check_certificate, shortcomings
from interplan_sumo.proving.reachability import unreachable
from interplan_sumo.scenario import certificates
from interplan_sumo.scenario.certificates import Certificate, read_certificates, read_summaries, write_certificates
from interplan_sumo.scenario.families import FAMILIES
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import Suite, certificate_of, find_scenario, suites
from interplan_sumo.simulation.setup import start_state

NUDGE = find_scenario("nudge/2")
SUITES = list(suites().values())


def stored(scenario: Scenario, suite: str = "interplan==1") -> Certificate:
    return read_certificates(suites()[suite].folder / certificates.FILE)[scenario.id]


def moved(certificate: Certificate, frame: int, **columns: float) -> Certificate:
    """The same certificate with one state changed by so much."""
    track = certificate.track
    changed = {name: getattr(track, name).copy() for name in columns}
    for name, by in columns.items():
        changed[name][frame] += by
    return Certificate(certificate.summary, replace(track, **changed))


def test_a_found_drive_is_certified_and_found_again() -> None:
    first, again = certify(NUDGE), certify(NUDGE)
    assert first.certificate is not None
    assert again.certificate is not None
    assert first.certificate.as_json() == again.certificate.as_json()
    assert check_certificate(NUDGE, first.certificate) == []


def test_a_scenario_that_leaves_no_way_past_has_no_certificate_but_a_reason() -> None:
    wall = tuple(
        replace(NUDGE.obstacles[0], place=replace(NUDGE.obstacles[0].place, left_m=left_m))
        for left_m in (-3.0, 0.0, 3.0, 6.0)
    )
    verdict = certify(replace(NUDGE, obstacles=wall), most_simulations=3)
    assert verdict.certificate is None
    assert verdict.reason


@pytest.mark.parametrize(
    ("family", "needed"), [("lane_change_htd", DENSE_BAR), ("lane_change_mtd", BAR), ("nudge", BAR)]
)
def test_dense_lane_changes_need_less(family: str, needed: float) -> None:
    assert bar(FAMILIES[family].scenarios[0]) == needed


@pytest.mark.parametrize("suite", SUITES, ids=lambda s: s.key)
def test_the_stored_certificates_are_of_the_scenarios_of_their_suite(suite: Suite) -> None:
    summaries = read_summaries(suite.folder / certificates.FILE)
    assert {s.id: s.hash() for s in suite.scenarios} == {i: s.scenario_hash for i, s in summaries.items()}
    assert (suite.folder / certificates.FILE).stat().st_size < 1_000_000


def test_a_stored_certificate_holds_on_replay() -> None:
    assert check_certificate(NUDGE, stored(NUDGE)) == []


@pytest.mark.slow
@pytest.mark.parametrize("scenario", [s for suite in SUITES[:2] for s in suite.scenarios], ids=lambda s: s.id)
def test_every_stored_certificate_holds_on_replay(scenario: Scenario) -> None:
    suite = next(s.key for s in SUITES if any(each.id == scenario.id for each in s.scenarios))
    assert check_certificate(scenario, stored(scenario, suite)) == []


def test_a_certificate_of_another_scenario_is_refused() -> None:
    other = replace(NUDGE, start_speed_mps=NUDGE.start_speed_mps - 0.1)
    assert "another scenario" in check_certificate(other, stored(NUDGE))[0]
    assert certificate_of(other) is None
    assert certificate_of(NUDGE) is not None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"x_m": 0.01}, "places are 0.010 m apart"),
        ({"vx_mps": 0.01}, "vx_mps"),
        ({"heading_rad": 0.01}, "heading_rad"),
        ({"ax_mps2": 20.0}, "m/s2"),
    ],
)
def test_a_drive_that_no_car_can_follow_is_refused(change: dict[str, float], said: str) -> None:
    (reason,) = check_certificate(NUDGE, moved(stored(NUDGE), 40, **change))
    assert said in reason


def test_a_drive_that_begins_elsewhere_is_refused() -> None:
    proof = stored(NUDGE)
    start = start_state(NUDGE, load_roads(NUDGE.map))
    assert unreachable(start, proof.track) == []
    assert "does not begin as the scenario does" in unreachable(replace(start, x_m=start.x_m + 0.1), proof.track)[0]


@pytest.mark.parametrize(("column", "value"), [("score", 0.5), ("trace_hash", "0" * 64), ("distance_m", 1.0)])
def test_a_summary_that_claims_something_else_is_refused(column: str, value: object) -> None:
    proof = stored(NUDGE)
    claimed = Certificate(replace(proof.summary, **{column: value}), proof.track)
    assert any(f"its replay gives {column}" in reason for reason in check_certificate(NUDGE, claimed))


@pytest.mark.parametrize(("score", "passes"), [(0.9, True), (0.899, False)])
def test_the_bar_is_nine_tenths(score: float, passes: bool) -> None:
    proof = stored(NUDGE)
    sheet = _sheet(NUDGE, proof)
    reasons = shortcomings(NUDGE, sheet, replace(proof.summary, score=score))
    assert (reasons == []) is passes


@pytest.mark.parametrize(("share", "passes"), [(0.7, True), (0.69, False)])
def test_a_drive_that_does_not_reach_the_goal_gets_seven_tenths_of_the_way(share: float, passes: bool) -> None:
    proof = stored(NUDGE)
    short = replace(proof.summary, reached_goal=False, distance_m=share * proof.summary.reference_distance_m)
    assert (shortcomings(NUDGE, _sheet(NUDGE, proof), short) == []) is passes


def _sheet(scenario: Scenario, proof: Certificate):
    from interplan_sumo.metrics.score import score
    from interplan_sumo.proving.replay import replay

    return score(replay(scenario, proof.track), load_roads(scenario.map), proof.track, scenario)


def test_certificates_are_read_back_to_the_last_bit(tmp_path: Path) -> None:
    proof = stored(NUDGE)
    for name in ("a.parquet", "b.parquet"):
        write_certificates(tmp_path / name, [proof])
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()
    again = read_certificates(tmp_path / "a.parquet")[NUDGE.id]
    assert again.summary == proof.summary
    np.testing.assert_array_equal(again.track.x_m, proof.track.x_m)
    assert Certificate.from_json(proof.as_json()).as_json() == proof.as_json()


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / certificates.FILE
    path.write_bytes(b"not parquet")
    with pytest.raises(InputError, match=r"certificates\.parquet"):
        read_certificates(path)
