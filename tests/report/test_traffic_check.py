"""traffic check: what of a file acts, what does not, and what its drivers do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from interplan_sumo.cli import main

FILE = (
    '<additional>\n<vType id="traffic" carFollowModel="IDM" tau="normc(1.2,0.3,0.8,2)" accel="1.5" decel="2"\n'
    ' emergencyDecel="8" lcPushy="1" cc1="2"><param key="interplan.reactOverlap" value="0.5"/></vType></additional>'
)


@pytest.mark.slow
def test_a_file_is_told_apart_in_what_acts_and_what_does_not_and_its_drivers_are_driven(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, plot = tmp_path / "mine.xml", tmp_path / "mine.png"
    path.write_text(FILE)
    assert main(["traffic", "check", str(path), "--json", "--plot", str(plot)]) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    (found,) = document["types"]
    assert {"tau", "accel", "interplan.reactOverlap"} <= set(found["acts"])
    assert [each["attribute"] for each in found["cannot_act"]] == ["lcPushy", "cc1"]
    assert found["drawn"] == {"tau": "normc(1.2,0.3,0.8,2)"}
    assert len(document["warnings"]) == 2
    assert {"following", "standstill", "cut_in", "merge"} <= found["situations"].keys()
    for name, row in found["situations"].items():
        assert 0.0 < row["hardest_braking_mps2"] < 8.05, name
    assert found["situations"]["standstill"]["least_gap_m"] > 0.5
    assert plot.stat().st_size > 10_000


def test_people_get_a_table_per_type_and_the_warnings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.xml"
    path.write_text(FILE)
    assert main(["traffic", "check", str(path)]) == 0
    out = capsys.readouterr().out
    assert "hardest braking [m/s2]" in out
    assert "line 2: lcPushy cannot act: it acts only with lateral resolution" in " ".join(out.split())


def test_a_file_that_cannot_be_used_is_one_line_and_exit_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.xml"
    path.write_text(FILE.replace('decel="2"', 'decell="2"'))
    assert main(["traffic", "check", str(path)]) == 2
    assert "unknown attribute 'decell'; did you mean 'decel'?" in capsys.readouterr().err


def test_run_says_once_what_cannot_act(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.xml"
    path.write_text(FILE)
    given = ["--planner", "straight_ahead", "--scenarios", "nudge/0", "--workers", "0", "--out", str(tmp_path / "run")]
    assert main(["run", *given, "--traffic", str(path)]) == 0
    err = capsys.readouterr().err
    assert err.count("warning: ") == 2
    assert err.count("lcPushy cannot act") == 1
