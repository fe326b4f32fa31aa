"""The commands `llm try` and `llm export`: questions of drives, with what came of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.run import run
from interplan_sumo.cli import main
from interplan_sumo.planner import Mission, Observation
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.suite import find_scenario
from interplan_sumo.world.trajectory import Trajectory


def test_one_decision_is_shown_with_prompt_options_answer_and_cost(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["llm", "try", "construction/0", "--model", "scripted:merge_left"]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("construction/0 at ")
    answer = "[answer of scripted:merge_left]"
    for part in ("[system]", "[user]\nOwn speed", "- merge_left: ", answer, "cost: 0 tokens"):
        assert part in shown
    assert shown.endswith("done: merge_left\n")


def test_as_json_it_is_one_document(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["llm", "try", "construction/0", "--model", "scripted:fly", "--at", "3", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["time_s"] >= 3.0
    assert found["failure"]["cause"] == "parse"
    assert found["taken"] in found["options"]


def test_the_waypoints_planner_can_be_asked_as_well(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["llm", "try", "nudge/0", "--planner", "llm_waypoints", "--model", "scripted:hello"]) == 0
    assert "failed (parse)" in capsys.readouterr().out


class Failing:
    """Knows how to ask, and fails before it does."""

    def __init__(self) -> None:
        self.exchanges: list[object] = []

    def start(self, mission: Mission) -> None: ...

    def plan(self, observation: Observation) -> Trajectory:
        raise ZeroDivisionError(f"at {observation.time_s}")


def test_an_answer_keeps_its_lines_and_reaches_no_terminal_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    answer = "  one\x1b[2J\n\ntwo \x9b1m"
    assert main(["llm", "try", "nudge/0", "--planner", "llm_waypoints", "--model", f"scripted:{answer}"]) == 0
    assert "\n  one\\x1b[2J\n\ntwo \\x9b1m\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nudge/0", "--planner", "idm"], "planner 'idm' asks no language model; give llm_hybrid or llm_waypoints"),
        (["nudge/0", "--model", "rules"], "planner 'llm_hybrid?model=rules' asks no language model"),
        (
            ["nudge/0", "--planner", f"{__name__}:Failing"],
            ":Failing' failed in nudge/0: plan() raised ZeroDivisionError: at 0",
        ),
        (["nudge/0", "--model", "scripted:x", "--at", "900"], "nudge/0: nothing is asked from 900 s on"),
        (["nudge/99", "--model", "scripted:x"], "no scenario named 'nudge/99'"),
        (["nudge/0", "--model", "oracle"], "no kind of language model named 'oracle'"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_one_line(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["llm", "try", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


# --- export ---


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clean drive of a scene of one's own."""
    folder = tmp_path_factory.mktemp("runs")
    scene = replace(find_scenario("following_lane_with_lead/0"), id="mine/0", start_speed_mps=5.0, duration_s=12.0)
    write_scenarios([scene], folder / "mine.yaml")
    files = (str(folder / "mine.yaml"),)
    run(RunOptions(("idm",), folder / "run", scenarios=files, workers=0, profile="interplan-paper"))
    return folder / "run"


def test_a_run_becomes_chats_with_a_card(driven: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "chats.jsonl"
    assert main(["llm", "export", str(driven), "--out", str(out)]) == 0
    said = capsys.readouterr()
    card = json.loads((tmp_path / "chats.json").read_text(encoding="utf-8"))
    assert said.err == "[1/1] mine/0, idm, seed 0\n"
    assert said.out.startswith(f"samples: 1 (of 600 asked for; a scenario gives 1 at most), in {out}, SHA-256 ")
    assert "by family: 1 following_lane_with_lead" in said.out
    assert card["options"]["centerline"] is True
    (line,) = out.read_text(encoding="utf-8").splitlines()
    system, user, assistant = json.loads(line)["messages"]
    assert (system["role"], user["role"], assistant["role"]) == ("system", "user", "assistant")
    assert "Lane ahead" in user["content"]
    assert "Goal: forward" in user["content"]
    assert len(json.loads(assistant["content"])["waypoints"]) == 16


def test_chats_as_json_and_without_the_lanes_line(
    driven: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "chats.jsonl"
    options = "--no-centerline --count 1 --quiet --json".split()
    assert main(["llm", "export", str(driven), "--out", str(out), *options]) == 0
    said = capsys.readouterr()
    card = json.loads(said.out)
    assert said.err == ""
    assert card["path"] == str(out)
    assert card["samples"] == 1
    assert "Lane ahead" not in out.read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_scene_of_the_benchmark_is_refused_under_any_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_scenarios([replace(find_scenario("nudge/0"), id="mine/0")], tmp_path / "mine.yaml")
    run(RunOptions(("idm",), tmp_path / "run", scenarios=(str(tmp_path / "mine.yaml"),), workers=0))
    out = ["--out", str(tmp_path / "chats.jsonl"), "--min-score", "0", "--quiet"]
    assert main(["llm", "export", str(tmp_path / "run"), *out]) == 2
    error = capsys.readouterr().err
    assert "scenes of the benchmark's suites (mine/0) test no model that was trained on them" in error
    assert error.count("\n") == 1
    assert main(["llm", "export", str(tmp_path / "run"), *out, "--allow-benchmark"]) == 0
    assert "of the benchmark's suites: 1; say so" in capsys.readouterr().out
