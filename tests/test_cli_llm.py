"""The command `llm try`: one question of a drive, with what came of it."""

from __future__ import annotations

import json

import pytest

from interplan_sumo.cli import main


def test_one_decision_is_shown_with_prompt_options_answer_and_cost(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["llm", "try", "construction/2", "--model", "scripted:merge_left"]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("construction/2 at ")
    for part in (
        "[system]",
        "[user]\nOwn speed",
        "- merge_left: ",
        "[answer of scripted:merge_left]",
        "cost: 0 tokens",
    ):
        assert part in shown
    assert shown.endswith("done: merge_left\n")


def test_as_json_it_is_one_document(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["llm", "try", "construction/2", "--model", "scripted:fly", "--at", "3", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["time_s"] >= 3.0
    assert found["failure"]["cause"] == "parse"
    assert found["taken"] in found["options"]


def test_the_waypoints_planner_can_be_asked_as_well(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["llm", "try", "nudge/0", "--planner", "llm_waypoints", "--model", "scripted:hello"]) == 0
    assert "failed (parse)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nudge/0", "--planner", "idm"], "planner 'idm' asks no language model; give llm_hybrid or llm_waypoints"),
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
