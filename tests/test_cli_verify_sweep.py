"""The commands `verify` and `sweep`: exit codes, forms that scripts rely on, and what a killed sweep leaves."""

from __future__ import annotations

import csv
import io
import json
import shutil
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.cli import main
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.scenario import TrafficDemand
from tests.batch.busy import BUSY
from tests.commands import ran, started

HERE = ("--planner", "straight_ahead", "--workers", "0")
TAU = ("--param", "tau=1,3")


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scenario with traffic and one without."""
    path = tmp_path_factory.mktemp("scenarios") / "mine.yaml"
    write_scenarios((BUSY, replace(BUSY, id="mine/1", traffic=TrafficDemand())), path)
    return path


@pytest.fixture(scope="module")
def run_folder(file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A complete run; not to be changed."""
    place = tmp_path_factory.mktemp("cli_verify") / "run"
    overrides = ("--set", "behaviour=assertive")
    assert main(["run", *HERE, *overrides, "--scenarios", str(file), "--out", str(place), "--quiet"]) == 0
    return place


@pytest.fixture(scope="module")
def swept(file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A complete sweep; not to be changed."""
    place = tmp_path_factory.mktemp("cli_sweep") / "sweep"
    assert main(["sweep", *HERE, *TAU, "--scenarios", str(file), "--out", str(place), "--quiet"]) == 0
    return place


# --- verify ---


@pytest.mark.slow
def test_verify_says_that_a_run_comes_again(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = ran(capsys, "verify", run_folder, "--workers", 0)
    assert code == 0
    assert "2 of 2 drives come again exactly from their stored plans (sampled from 2)" in out
    assert "2/2 done" in err
    assert "Verified: 2 of 2 drives came again from their stored plans." in ran(capsys, "report", run_folder)[1]
    out = ran(capsys, "verify", run_folder, "--workers", 0, "--with-planner", "--quiet")[1]
    assert "2 of 2 drives come again exactly from their planners" in out
    assert ran(capsys, "verify", run_folder, "--workers", 0, "--quiet", "--sample", 1)[2] == ""


def test_verify_of_an_official_scenario_has_the_documented_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", *HERE, "--suite", "smoke==1", "--limit", "1", "--out", str(tmp_path / "run"), "--quiet"]) == 0
    code, out, err = ran(capsys, "verify", tmp_path / "run", "--workers", 0, "--all", "--quiet", "--json")
    found = json.loads(out)
    assert (code, err) == (0, "")
    assert {name: found[name] for name in ("drives", "verified", "equal", "differs", "unverifiable")} == {
        "drives": 1, "verified": 1, "equal": 1, "differs": 0, "unverifiable": 0,
    }  # fmt: skip
    (row,) = found["rows"]
    assert row["trace_hash"] == row["trace_hash_now"]
    assert row["score"] == row["score_now"]
    assert (row["verdict"], row["difference"], row["within_bars"], row["versions"]) == ("equal", None, None, {})


def tampered(place: Path, copy: Path, **changes: Any) -> Path:
    """A copy of a run folder with the first row changed."""
    shutil.copytree(place, copy)
    lines = (copy / "results.jsonl").read_text().splitlines()
    lines[0] = json.dumps(json.loads(lines[0]) | changes)
    (copy / "results.jsonl").write_text("\n".join(lines) + "\n")
    return copy


@pytest.mark.slow
def test_verify_finds_a_tampered_row_and_exits_with_1(
    run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tampered(run_folder, tmp_path / "run", trace_hash="f" * 64)
    for options in ((), ("--tolerant",)):
        code, out, _ = ran(capsys, "verify", copy, "--workers", 0, *options)
        assert code == 1
        assert "mine/0, straight_ahead, seed 0: differs: " in out
        assert "the hash in results.jsonl was changed" in " ".join(out.split())
    code, out, _ = ran(capsys, "verify", copy, "--workers", 0, "--json", "--quiet")
    assert (code, json.loads(out)["differs"]) == (1, 1)
    assert ran(capsys, "verify", copy, "--workers", 0, "--scenarios", "mine/1")[0] == 0


def test_verify_exits_with_3_where_a_row_cannot_be_verified(
    run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tampered(run_folder, tmp_path / "run", scenario_hash="f" * 64)
    code, out, _ = ran(capsys, "verify", copy, "--workers", 0)
    assert code == 3
    assert "unverifiable: the scenario has changed" in out


def test_verify_takes_one_size(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = ran(capsys, "verify", run_folder, "--all", "--sample", 3)
    assert (code, err.count("\n")) == (2, 1)
    assert "give one of them" in err
    assert ran(capsys, "verify", run_folder, "--sample", 0)[0] == 2


# --- sweep ---


def test_a_sweep_leaves_runs_a_table_and_a_picture(swept: Path, file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert sorted(path.name for path in swept.iterdir()) == [
        "sweep.csv",
        "sweep.html",
        "sweep.png",
        "tau=1",
        "tau=3",
        "traffic",
    ]
    rows = list(csv.DictReader(io.StringIO((swept / "sweep.csv").read_text())))
    assert [(row["tau"], row["planner"], row["drives"]) for row in rows] == [
        ("1", "straight_ahead", "2"), ("3", "straight_ahead", "2"),
    ]  # fmt: skip
    before = (swept / "sweep.csv").read_bytes()
    code, out, err = ran(capsys, "sweep", *HERE, *TAU, "--scenarios", file, "--out", swept)
    assert code == 0
    assert "straight_ahead" in out
    assert "2 combinations, 4 drives; all done already" in err
    assert "no traffic to change, so equal results, in mine/1\n" in err
    assert (swept / "sweep.csv").read_bytes() == before


@pytest.mark.slow
def test_equal_sweeps_give_equal_tables_and_a_changed_parameter_other_hashes(
    swept: Path, file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = ran(
        capsys, "sweep", *HERE, *TAU, "--scenarios", file, "--out", tmp_path / "again", "--quiet", "--json"
    )
    found = json.loads(out)
    assert code == 0
    assert (tmp_path / "again" / "sweep.csv").read_bytes() == (swept / "sweep.csv").read_bytes()
    assert (found["parameters"], found["complete"]) == ({"tau": ["1", "3"]}, True)
    assert [row["setting"] for row in found["rows"]] == [{"tau": "1"}, {"tau": "3"}]
    short, long = (read_run(swept / name).rows for name in ("tau=1", "tau=3"))
    differ = [short[key].trace_hash != long[key].trace_hash for key in short]
    assert differ == [True, False]  # where nobody else drives, nothing changes


def test_a_sweep_of_three_parameters_has_no_picture_and_says_so(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    params = ("--param", "tau=1", "--param", "density=low", "--param", "behaviour=mixed")
    code, out, err = ran(
        capsys, "sweep", *HERE, *params, "--scenarios", file, "--limit", 1, "--out", tmp_path / "sweep"
    )
    assert code == 0
    assert "behaviour" in out
    assert "no plot: 3 parameters are varied" in err
    assert not (tmp_path / "sweep" / "sweep.png").exists()


@pytest.mark.nightly
def test_an_interrupted_sweep_goes_on_where_it_was(file: Path, tmp_path: Path) -> None:
    place = tmp_path / "sweep"
    command = [
        "sweep", "--planner", "tests.batch.rude_planners:Slow", "--param", "tau=1,2", "--scenarios", str(file),
        "--workers", "0", "--out", str(place),
    ]  # fmt: skip
    with started(place / "tau=1", *command) as process:
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60.0)
    assert process.returncode == 3
    assert f"Go on with: interplan-sumo {' '.join(command)}" in err
    assert not (place / "sweep.csv").exists()
    kept = (place / "tau=1" / "results.jsonl").read_bytes()
    assert main(command) == 0
    assert (place / "tau=1" / "results.jsonl").read_bytes().startswith(kept)
    assert (place / "sweep.csv").is_file()
