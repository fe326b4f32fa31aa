"""The commands about scenarios: export, validate, render, and `run` on a file."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import interplan_sumo
from interplan_sumo.scenario.files import read_scenario, write_scenarios
from interplan_sumo.scenario.suite import find_scenario, find_suite
from tests.batch.busy import BUSY
from tests.commands import ran

QUIET = "construction/1"
"""Somebody stands in the way, and nobody else is there."""


@pytest.fixture
def file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """An official scenario, exported."""
    assert ran(capsys, "scenarios", "export", QUIET, tmp_path / "mine.yaml")[0] == 0
    return tmp_path / "mine.yaml"


def test_an_exported_scenario_is_the_official_one(file: Path) -> None:
    official = find_scenario(QUIET)
    assert read_scenario(file) == official
    assert read_scenario(file).hash() == official.hash()


def test_validate_finds_an_official_scenario_sound(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ran(capsys, "scenarios", "validate", file) == (0, "1 scenario, no problems\n", "")
    code, out, _ = ran(capsys, "scenarios", "validate", file, "--json")
    assert (code, json.loads(out)) == (0, {"ok": True, "scenarios": 1, "problems": [], "notes": []})


def test_validate_notes_a_family_that_is_not_installed_and_refuses_an_exemption_from_nothing(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_scenarios([replace(find_scenario(QUIET), family="constructio")], file)
    code, out, err = ran(capsys, "scenarios", "validate", file, "--quick")
    assert (code, out) == (0, "1 scenario, no problems\n")
    assert err.startswith(f"note: {file}: {QUIET}: family: none named 'constructio' is installed, so its own checks")
    assert err.endswith("Did you mean 'construction'?\n")
    (note,) = json.loads(ran(capsys, "scenarios", "validate", file, "--quick", "--json")[1])["notes"]
    assert note.keys() == {"source", "id", "note"}
    write_scenarios([replace(find_scenario(QUIET), exempt=("driving_directon", "no_collision"))], file)
    code, _, err = ran(capsys, "scenarios", "validate", file, "--quick")
    assert code == 2
    what = "no metric named 'driving_directon'. Did you mean 'driving_direction'?"
    assert err == f"error: {file}: {QUIET}: exempt: {what}\n"


def test_validate_says_each_problem_in_a_line(file: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    text = file.read_text()
    speed = f"start_speed_mps: {find_scenario(QUIET).start_speed_mps}"
    assert speed in text
    file.write_text(text.replace(speed, "start_speed_mps: 40.0"))
    (tmp_path / "torn.yaml").write_text("format: 1\nid: {")
    code, out, err = ran(capsys, "scenarios", "validate", tmp_path / "torn.yaml", file)
    assert code == 2
    lines = err.splitlines()
    assert len(lines) >= 2
    assert all(line.startswith("error: ") for line in lines)
    assert "torn.yaml, line 2: this is not YAML" in lines[0]
    assert any(f"mine.yaml: {QUIET}: start_speed_mps: 40.0 is above the limit" in line for line in lines)
    assert out == f"1 scenario, {len(lines)} problems\n"
    code, out, err = ran(capsys, "scenarios", "validate", file, "--quick", "--json")
    assert (code, err) == (2, "")
    found = json.loads(out)
    assert found["ok"] is False
    assert {"source", "id", "problem"} == found["problems"][0].keys()


def test_a_folder_with_scenarios_is_taken_for_their_file(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file.rename(file.with_name("scenarios.yaml"))
    folder = file.parent
    (shown,) = json.loads(ran(capsys, "scenarios", "show", folder, "--json")[1])
    assert shown["id"] == QUIET
    assert ran(capsys, "scenarios", "validate", folder, "--quick")[:2] == (0, "1 scenario, no problems\n")
    given = ("--planner", "straight_ahead", "--scenarios", folder, "--workers", 0, "--quiet", "--out", folder / "run")
    code, _, err = ran(capsys, "run", *given)
    assert (code, err) == (0, "")
    assert [each.id for each in interplan_sumo.scenarios(folder)] == [QUIET]
    assert interplan_sumo.load_scenario(folder).id == QUIET


def test_known_scenarios_are_each_named_once(capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = ran(capsys, "scenarios", "show", "qqq")
    known = err.partition("Known: ")[2].partition(", ...")[0].split(", ")
    assert (code, len(known)) == (2, 20)
    assert len(set(known)) == 20


def test_validate_checks_a_suite(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = ran(capsys, "scenarios", "validate", "--suite", "smoke==1", "--quick")
    assert (code, err) == (0, "")
    assert out == f"{len(find_suite('smoke==1').scenarios)} scenarios, no problems\n"


@pytest.mark.slow
def test_render_draws_an_id_a_file_and_a_sheet(file: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    for what in (QUIET, file):
        place = tmp_path / "one.png"
        assert ran(capsys, "scenarios", "render", what, place)[:2] == (0, f"wrote {place}\n")
        assert place.read_bytes().startswith(b"\x89PNG")
    first = (tmp_path / "one.png").read_bytes()
    again = file.read_text().replace(f"id: {QUIET}", "id: mine/1")
    file.write_text(f"{file.read_text()}---\n{again}")
    assert ran(capsys, "scenarios", "render", file, tmp_path / "sheet.png")[0] == 0
    assert (tmp_path / "sheet.png").read_bytes() != first


@pytest.mark.slow
def test_an_audit_looks_at_the_drives_of_its_planner_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine.yaml"
    write_scenarios([replace(BUSY, duration_s=1.0)], file)
    for planner in ("straight_ahead", "idm"):
        command = ("scenarios", "audit", file, "--planner", planner, "--out", tmp_path / "out", "--workers", "0")
        code, out, err = ran(capsys, *command, "--quiet", "--json")
        assert code == 0, err
        assert json.loads(out)["scenarios"] == 1
