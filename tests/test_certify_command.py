"""`scenarios certify`: finds, stores and checks proofs, and says what is missing."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from interplan_sumo.cli import main
from interplan_sumo.cli.certify import keep_proofs
from interplan_sumo.scenario.certificates import FILE, read_certificates, write_certificates
from interplan_sumo.scenario.files import write_scenario
from interplan_sumo.scenario.suite import Suite, find_scenario, find_suite
from interplan_sumo.verification.certificates import Proof

COMMAND = ("scenarios", "certify", "--suite", "smoke==1", "--scenarios", "nudge/*", "--workers", "0", "--json")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """In place of the suite's own folder, which must stay as it is."""
    monkeypatch.setattr(Suite, "folder", property(lambda _: tmp_path))
    return tmp_path


@pytest.mark.slow
def test_proofs_are_found_stored_and_checked(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*COMMAND, "--panel", "straight_ahead"]) == 0
    said = json.loads(capsys.readouterr().out)
    (row,) = said["scenarios"]
    assert said["ok"]
    assert row["id"] == "nudge/0"
    assert row["certificate"]["score"] >= 0.95
    assert row["certificate"]["solved_by"] == []
    assert list(read_certificates(folder / FILE)) == ["nudge/0"]
    assert main([*COMMAND, "--check"]) == 0
    assert json.loads(capsys.readouterr().out)["ok"]


def test_a_proof_that_holds_stays_if_a_search_finds_none_and_goes_with_its_scenario(tmp_path: Path) -> None:
    names = ("nudge/0", "accident/0", "overtake/0")
    held = read_certificates(find_suite("interplan==1").folder / FILE)
    write_certificates(tmp_path / FILE, [held[name] for name in names])
    nudge, accident, overtake = map(find_scenario, names)
    changed = replace(accident, duration_s=accident.duration_s + 1.0)
    none = Proof(nudge, None, ("the machine had no time",), 0)
    keep_proofs(tmp_path / FILE, [none], [nudge, changed, overtake], beside=False)
    assert [*read_certificates(tmp_path / FILE)] == ["nudge/0", "overtake/0"]
    keep_proofs(tmp_path / FILE, [none], [nudge], beside=True)  # the other one may be of a file beside it
    assert [*read_certificates(tmp_path / FILE)] == ["nudge/0", "overtake/0"]
    keep_proofs(tmp_path / FILE, [none], [nudge], beside=False)
    assert [*read_certificates(tmp_path / FILE)] == ["nudge/0"]


def test_what_has_no_proof_fails_the_check_and_leaves_the_folder_alone(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*COMMAND, "--check"]) == 1
    assert "no certificate is stored" in capsys.readouterr().out
    assert list(folder.iterdir()) == []

    assert main([*COMMAND[:5], "nodge/0"]) == 2
    assert "nodge/0" in capsys.readouterr().err


def test_the_certificates_of_a_released_suite_stay_as_they_are(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "lock.json").touch()
    assert main([*COMMAND, "--panel", ""]) == 2
    assert "the certificates of smoke==1 are released" in capsys.readouterr().err
    write_scenario(find_scenario("nudge/0"), folder / "mine.yaml")
    assert main(["scenarios", "certify", "--scenarios", str(folder / "mine.yaml"), "--panel", ""]) == 2
    assert not (folder / FILE).exists()
    assert main([*COMMAND, "--check"]) == 1
