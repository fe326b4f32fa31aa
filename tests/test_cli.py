"""The command line: forms that other people's scripts rely on, and one line for whatever goes wrong."""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.cli import main
from interplan_sumo.maps.store import find_map
from interplan_sumo.planner import RECOMMENDED
from interplan_sumo.scenario.suite import DEFAULT_SUITE, Suite, find_suite
from tests.commands import ran, started
from tests.records import hashes

FIRST = find_suite(DEFAULT_SUITE).scenarios[0].id
SLOW = "tests.batch.rude_planners:Slow"


def said(capsys: pytest.CaptureFixture[str], *arguments: object) -> Any:
    code, out, _ = ran(capsys, *arguments)
    assert code == 0
    return json.loads(out)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A complete run of one scenario with two planners; not to be changed."""
    place = tmp_path_factory.mktemp("cli") / "run"
    planners = ("--planner", "straight_ahead", "--planner", "idm")
    assert main(["run", *planners, "--limit", "1", "--workers", "0", "--out", str(place), "--quiet"]) == 0
    return place


def test_scenarios_list_has_the_documented_fields(capsys: pytest.CaptureFixture[str]) -> None:
    entries = said(capsys, "scenarios", "list", "--suite", DEFAULT_SUITE, "--json")
    assert [entry["id"] for entry in entries] == [s.id for s in find_suite(DEFAULT_SUITE).scenarios]
    documented = "id family map site driving_side density behaviour lane_changes certificate hash"
    assert all(set(documented.split()) <= entry.keys() for entry in entries)
    assert {entry["lane_changes"] for entry in entries} == {0, 1, 2}
    assert entries[0]["driving_side"] in ("left", "right")


def test_scenarios_show_prints_what_is_staged(capsys: pytest.CaptureFixture[str]) -> None:
    entry = said(capsys, "scenarios", "show", FIRST, "--json")
    assert entry["id"] == FIRST
    assert entry["scenario"]["route"]
    code, out, _ = ran(capsys, "scenarios", "show", FIRST)
    assert code == 0
    assert f"id: {FIRST}" in out


@pytest.mark.slow
def test_scenarios_freeze_writes_the_lock_anew(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped = find_suite("smoke==1").folder
    before = {path.name: path.read_bytes() for path in shipped.iterdir() if path.is_file()}
    monkeypatch.setattr(Suite, "folder", property(lambda _: tmp_path / "suite"))  # the shipped one must stay
    code, out, _ = ran(capsys, "scenarios", "freeze", "--suite", "smoke==1")
    assert code == 0
    assert out.split() == [str(tmp_path / "suite" / "lock.json")]
    lock = json.loads((tmp_path / "suite" / "lock.json").read_text())
    assert set(lock["scenarios"]) == {s.id for s in find_suite("smoke==1").scenarios}
    assert {path.name: path.read_bytes() for path in shipped.iterdir() if path.is_file()} == before
    code, _, err = ran(capsys, "scenarios", "freeze", "--suite", "smok==1")
    assert code == 2
    assert "Did you mean 'smoke==1'?" in err


def test_planners_list_recommends_exactly_one(capsys: pytest.CaptureFixture[str]) -> None:
    entries = said(capsys, "planners", "list", "--json")
    assert all({"name", "source", "parameters", "recommended"} <= entry.keys() for entry in entries)
    assert sum(entry["recommended"] for entry in entries) == 1
    assert {"idm", "straight_ahead"} <= {entry["name"] for entry in entries}


@pytest.mark.slow
def test_planners_check_tells_a_conforming_planner_from_a_failing_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert said(capsys, "planners", "check", "straight_ahead", "--json")["ok"] is True
    code, out, _ = ran(capsys, "planners", "check", "tests.batch.rude_planners:ReturnsNan")
    assert code == 2
    assert "error: " in out
    assert "does not conform" in out
    code, _, err = ran(capsys, "planners", "check", "strait_ahead")
    assert code == 2
    assert "Did you mean 'straight_ahead'?" in err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("", "exited with code 0 inside plan()"),
        ("?method=start", "exited with code 0 inside start()"),
        (f"?number={signal.SIGABRT.value}", "was killed by SIGABRT inside plan()"),
    ],
    ids=["exit", "exit-in-start", "signal"],
)
def test_planners_check_tells_a_planner_that_ends_its_process_what_it_did(
    capsys: pytest.CaptureFixture[str], options: str, said: str
) -> None:
    planner = f"tests.batch.rude_planners:Leaves{options}"
    code, out, _ = ran(capsys, "planners", "check", planner)
    assert code == 2
    assert out.splitlines() == [
        f"error: process: its process {said}; a planner returns a plan or raises an error",
        f"{planner} does not conform: 1 error",
    ]


def test_planners_check_tells_a_planner_that_ends_its_process_while_it_is_built(
    capsys: pytest.CaptureFixture[str],
) -> None:
    planner = "tests.batch.rude_planners:Leaves?method=__init__"
    code, out, err = ran(capsys, "planners", "check", planner)
    assert (code, out) == (2, "")
    assert err.startswith(f"error: planner '{planner}' could not be built: its process exited with code 0")
    assert len(err.splitlines()) == 1


def test_planners_check_passes_on_what_a_planner_prints(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = ran(capsys, "planners", "check", "tests.batch.rude_planners:Chatters")
    assert code == 0
    assert "conforms" in out
    assert "xxx" in err
    assert "xxx" not in out
    assert "plan leaves" in ran(capsys, "planners", "check", "tests.batch.rude_planners:Leaves")[2]


def test_maps_check_passes_for_a_shipped_map_and_fails_for_a_foreign_network(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    name = find_suite(DEFAULT_SUITE).scenarios[0].map
    report = said(capsys, "maps", "check", name, "--json")
    documented = "ok lanes connectors lane_deviation_m connector_deviation_m missing extra problems"
    assert set(documented.split()) <= report.keys()
    assert report["ok"] is True
    assert {"max", "p99"} <= report["lane_deviation_m"].keys()
    folder = tmp_path / name / "1.0"
    shutil.copytree(find_map(name).folder, folder)
    ids = json.loads((folder / "ids.json").read_text())
    ids["origin_m"][0] += 1.0
    (folder / "ids.json").write_text(json.dumps(ids))
    code, out, _ = ran(capsys, "maps", "check", folder)
    assert code == 1
    assert "problem: " in out


def test_maps_convert_builds_the_same_network_again(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    files = find_map(find_suite(DEFAULT_SUITE).scenarios[0].map)
    folder = tmp_path / files.name / files.version
    folder.mkdir(parents=True)
    shutil.copy(files.gpkg, folder)
    assert ran(capsys, "maps", "convert", folder)[0] == 0
    assert (folder / "ids.json").read_text() == files.ids.read_text()
    assert said(capsys, "maps", "check", folder, "--json")["ok"] is True


@pytest.mark.slow
def test_maps_render_draws_a_picture(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    name = find_suite(DEFAULT_SUITE).scenarios[0].map
    assert ran(capsys, "maps", "render", name, tmp_path / "map.png")[0] == 0
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    code, _, err = ran(capsys, "maps", "render", name, tmp_path / "no" / "map.png")
    assert code == 2
    assert err.count("\n") == 1


def test_maps_list_has_the_documented_fields(capsys: pytest.CaptureFixture[str]) -> None:
    entries = said(capsys, "maps", "list", "--json")
    assert entries
    for entry in entries:
        assert {"name", "path", "lanes", "lane_km", "driving_side"} <= entry.keys()
        assert (Path(entry["path"]) / "map.gpkg").is_file()
        assert entry["lanes"] > 0


def test_report_json_is_the_paper_table(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = said(capsys, "report", folder, "--json", "--paper", "--why")
    assert (report["suite"], report["complete"]) == (DEFAULT_SUITE, True)
    assert [row["planner"] for row in report["rows"]] == ["straight_ahead", "idm"]
    keys = "interplan construction accident jaywalker nudge overtake ltd mtd htd driv goal no_col scenarios faults"
    assert all(set(keys.split()) <= row.keys() for row in report["rows"])
    assert len(report["paper"]["rows"]) == 14


def test_a_run_leaves_a_page_in_its_folder(folder: Path) -> None:
    assert FIRST in (folder / "report.html").read_text()


def test_report_csv_markdown_and_html(folder: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, out, _ = ran(capsys, "report", folder, "--csv")
    assert code == 0
    assert [row["planner"] for row in csv.DictReader(io.StringIO(out))] == ["straight_ahead", "idm"]
    assert ran(capsys, "report", folder, "--markdown")[1].startswith("| planner | interPlan |")
    assert ran(capsys, "report", folder, "--html", tmp_path / "page.html")[0] == 0
    assert FIRST in (tmp_path / "page.html").read_text()
    assert ran(capsys, "report", folder, "--csv", "--json")[0] == 2
    assert ran(capsys, "report", folder, "--html", tmp_path / "no" / "page.html")[0] == 2


def test_an_incomplete_run_is_reported_with_exit_code_3(
    folder: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    place = tmp_path / "run"
    place.mkdir()
    for name in ("manifest.json", "results.jsonl"):
        lines = (folder / name).read_text().splitlines(keepends=True)
        (place / name).write_text("".join(lines if name == "manifest.json" else lines[:1]))
    code, out, _ = ran(capsys, "report", place)
    assert code == 3
    assert "INCOMPLETE" in out
    code, out, _ = ran(capsys, "report", place, "--json")
    assert code == 3
    assert json.loads(out)["complete"] is False


def test_score_prints_the_table_under_another_profile(
    folder: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code, out, _ = ran(capsys, "score", folder, "--profile", "nuplan", "--json", "--out", tmp_path / "rows.jsonl")
    assert code == 0
    assert json.loads(out)["profile"] == "nuplan"
    assert all(json.loads(line)["profile"] == "nuplan" for line in (tmp_path / "rows.jsonl").read_text().splitlines())
    code, _, err = ran(capsys, "score", folder, "--profile", "nuplam")
    assert code == 2
    assert "Did you mean 'nuplan'?" in err


@pytest.mark.slow
def test_a_run_without_a_planner_drives_the_recommended_one(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    arguments = ("run", "--limit", 1, "--workers", 0, "--out", tmp_path / "run", "--quiet", "--json")
    assert [row["planner"] for row in said(capsys, *arguments)["rows"]] == [RECOMMENDED]


def test_compare_pairs_two_planners_drive_by_drive(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    planners = ("--planner-a", "straight_ahead", "--planner-b", "idm")
    found = said(capsys, "compare", folder, folder, *planners, "--json")
    rows = {row["planner"]: row["interplan"] for row in said(capsys, "report", folder, "--json")["rows"]}
    assert found["overall"]["difference"] == pytest.approx(rows["idm"] - rows["straight_ahead"], abs=1e-3)
    assert [change["scenario_id"] for change in found["changes"]] == [FIRST]
    assert said(capsys, "compare", folder, folder, *planners, "--profile", "nuplan", "--json")["profile"] == "nuplan"
    code, out, _ = ran(capsys, "compare", folder, folder, *planners)
    assert code == 0
    assert "b - a" in out
    code, _, err = ran(capsys, "compare", folder, folder)
    assert code == 2
    assert "name one: --planner-a" in err


def test_compare_is_incomplete_where_a_drive_is_missing(
    folder: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    shutil.copytree(folder, tmp_path / "run")
    (tmp_path / "run" / "results.jsonl").write_text("")
    code, out, _ = ran(capsys, "compare", folder, tmp_path / "run", "--planner-a", "idm", "--json")
    assert code == 3
    assert json.loads(out)["missing"]["b"] == [{"scenario_id": FIRST, "seed": 0}]


def test_score_names_a_damaged_trace_scores_the_rest_and_ends_with_3(
    folder: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    place = tmp_path / "run"
    shutil.copytree(folder, place)
    trace = next(place.glob("traces/*/idm-*/seed0/ego.parquet"))
    trace.write_bytes(trace.read_bytes()[:-100])
    code, out, err = ran(capsys, "score", place, "--quiet", "--json")
    assert code == 3
    assert err.count("\n") == 1
    assert str(trace) in err
    report = json.loads(out)
    assert report["complete"] is False
    assert {row["planner"]: row["interplan"] is None for row in report["rows"]} == {
        "straight_ahead": False,
        "idm": True,
    }


@pytest.mark.slow
def test_scoring_again_needs_no_sumo(folder: Path) -> None:
    code = (
        f"import sys; from interplan_sumo.cli import main; main(['score', {str(folder)!r}, '--profile', 'nuplan']);"
        "print([m for m in ('libsumo', 'interplan_sumo.simulation.sumo') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip().endswith("[]")


def test_json_of_a_run_is_alone_on_stdout_whatever_the_planner_prints(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    planner = "tests.batch.rude_planners:Chatters"
    code, out, err = ran(
        capsys, "run", "--planner", planner, "--limit", 1, "--workers", 0, "--out", tmp_path / "run", "--json"
    )
    assert code == 0
    assert json.loads(out)["complete"] is True
    assert "1/1 done" in err


def test_a_run_ends_with_what_cost_most_and_what_to_do_next(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    planners = ("--planner", "straight_ahead", "--planner", "idm")
    code, _, err = ran(capsys, "run", *planners, "--limit", 1, "--workers", 0, "--out", folder)
    assert code == 0
    begin, *_, one, two, place, why, replay, verify = err.splitlines()
    assert begin.startswith(f"1 scenario of {DEFAULT_SUITE}, 2 planners (straight_ahead, idm), 1 seed, no workers, in ")
    assert begin.endswith(": 2 jobs, 2 of them done already")
    assert one.startswith("straight_ahead lost most of 100 points by: ")
    assert "(1 drive)" in one
    assert two.startswith("idm lost ")
    assert place.endswith("report.html; next:")
    assert why == f"  interplan-sumo report {folder} --why"
    assert replay.startswith(f"  interplan-sumo replay {folder} {FIRST} --planner ")
    assert verify == f"  interplan-sumo verify {folder}"


def test_a_planner_that_fails_in_every_drive_is_bad_input(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    planner = "tests.batch.rude_planners:NeverBegins"
    code, out, err = ran(
        capsys, "run", "--planner", planner, "--limit", 1, "--workers", 0, "--out", tmp_path / "run", "--quiet"
    )
    assert code == 2
    assert planner in out
    assert err.startswith(f"error: planner '{planner}' failed in its only drive, first: start() raised ValueError")
    assert err.endswith(f"see: interplan-sumo planners check {planner}\n")


def test_all_planners_that_fail_in_every_drive_are_named(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    rude = [f"tests.batch.rude_planners:{name}" for name in ("NeverBegins", "ReturnsNan")]
    planners = ("--planner", rude[0], "--planner", rude[1], "--planner", "straight_ahead")
    code, _, err = ran(capsys, "run", *planners, "--limit", 1, "--workers", 0, "--out", tmp_path / "run", "--quiet")
    assert code == 2
    assert f"planner '{rude[0]}' failed in its only drive" in err
    assert f"; so did '{rude[1]}'; see: " in err


def test_quiet_says_nothing_on_stderr(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    planners = ("--planner", "straight_ahead", "--planner", "idm")
    code, out, err = ran(capsys, "run", *planners, "--limit", 1, "--workers", 0, "--out", folder, "--quiet")
    assert (code, err) == (0, "")
    assert "straight_ahead" in out


@pytest.mark.slow
def test_doctor_finds_everything_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    found = said(capsys, "doctor", "--json")
    assert found["ok"] is True
    assert {"interplan_sumo", "python", "sumo"} <= found["versions"].keys()
    checks = {check["name"]: check for check in found["checks"]}
    assert "driven and scored" in checks["self-test"]["detail"]
    assert found["machine"]["platform class"].startswith(f"{sys.platform}-")
    declared = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    assert {f"extra [{name}]" for name in declared["optional-dependencies"]} <= checks.keys()
    assert checks["extra [dev]"]["detail"] == "installed"
    code, out, _ = ran(capsys, "doctor")
    assert code == 0
    assert "FAILED" not in out


@pytest.mark.slow
def test_a_second_run_on_the_folder_is_refused_and_ctrl_c_leaves_one_that_goes_on(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    place = tmp_path / "run"
    arguments = ("run", "--planner", SLOW, "--limit", 1, "--seeds", 2, "--out", place)
    with started(place, *arguments, "--workers", 1) as process:
        code, _, err = ran(capsys, *arguments, "--workers", 0, "--quiet")
        assert code == 2
        assert f"in use by another run (process {process.pid})" in err
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)
    assert process.returncode == 3
    assert "stopped; what was done is kept. Go on with: interplan-sumo run --planner" in err
    before = hashes(read_run(place))
    assert len(before) == 1
    assert ran(capsys, *arguments, "--workers", 0, "--quiet")[0] == 0
    after = hashes(read_run(place))
    assert len(after) == 2
    assert before.items() <= after.items()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="counts descriptors as Linux does")
def test_too_few_descriptors_are_one_line_and_the_folder_goes_on(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ("run", "--planner", "straight_ahead", "--limit", "1", "--out", str(tmp_path / "run"), "--quiet")
    command = ["sh", "-c", 'ulimit -n 12; exec "$@"', "sh", sys.executable, "-m", "interplan_sumo", *arguments]
    ended = subprocess.run(command, stderr=subprocess.PIPE, text=True)
    assert ended.returncode == 2
    (line,) = ended.stderr.splitlines()
    assert line.startswith("error: Too many open files")
    assert line.endswith("allow more open files (ulimit -n), and repeat the command")
    assert ran(capsys, *arguments, "--workers", 0)[0] == 0


@pytest.mark.parametrize("place", ["argument", "working folder"])
def test_a_folder_whose_name_is_no_text_is_refused_before_anything_is_driven(
    place: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / os.fsdecode(b"l\xe4ufe")  # as older archives hold it
    out = folder / "run"
    if place == "working folder":
        try:
            folder.mkdir()
        except OSError:
            pytest.skip("this file system takes text only")
        monkeypatch.chdir(folder)
        out = Path("run")
    code, _, said = ran(capsys, "run", "--planner", "straight_ahead", "--suite", "smoke==1", "--limit", 1, "--out", out)
    assert code == 2
    assert said.startswith("error: '")
    assert r"l\udce4ufe" in said
    assert said.endswith("' is no text in the encoding of this system (utf-8); give it another name\n")
    assert not out.exists()


def test_a_terminal_that_knows_fewer_characters_gets_what_it_knows() -> None:
    command = [sys.executable, "-m", "interplan_sumo", "scenarios", "list"]
    ended = subprocess.run(command, env={**os.environ, "PYTHONIOENCODING": "ascii"}, capture_output=True)
    assert ended.returncode == 0, ended.stderr
    assert b"nudge/0" in ended.stdout
    code = "from interplan_sumo.report.printing import print_json; print_json(['Straße'])"
    told = subprocess.run([sys.executable, "-c", code], env={**os.environ, "PYTHONIOENCODING": "ascii"}, stdout=-1)
    assert json.loads(told.stdout) == ["Straße"]


@pytest.mark.slow
def test_output_that_cannot_be_written_is_one_line_and_closed_output_none() -> None:
    command = [sys.executable, "-m", "interplan_sumo", "planners", "list", "--json"]
    if sys.platform == "linux":
        with open("/dev/full", "w") as full:
            ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
        assert ended.returncode == 2
        assert ended.stderr.splitlines() == [
            "error: No space left on device: free some space where the output goes, and repeat the command"
        ]
    ended = subprocess.run(["sh", "-c", 'exec "$@" >&-', "sh", *command], stderr=subprocess.PIPE, text=True)
    assert (ended.returncode, ended.stderr) == (0, "")
