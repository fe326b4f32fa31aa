"""`scenarios certify`: finds, stores and checks proofs, and says what is missing."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from interplan_sumo.cli import main
from interplan_sumo.scenario.certificates import FILE, read_certificates
from interplan_sumo.scenario.suite import Suite

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


def test_what_has_no_proof_fails_the_check_and_leaves_the_folder_alone(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*COMMAND, "--check"]) == 1
    assert "no certificate is stored" in capsys.readouterr().out
    assert list(folder.iterdir()) == []

    assert main([*COMMAND[:5], "nodge/0"]) == 2
    assert "nodge/0" in capsys.readouterr().err
