"""Printing: what stands on a terminal is text, whoever wrote it."""

from __future__ import annotations

import json

import pytest

from interplan_sumo.report.printing import print_json


def test_json_holds_every_text_and_nothing_in_it_commands_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    document = {"answer": "Grüße\x1b[2J, \x9b1m\x7f, über \udc80.yaml und 道路"}
    print_json(document)
    printed = capsys.readouterr().out
    assert json.loads(printed) == document
    assert "Grüße" in printed
    assert "道路" in printed
    assert all(char == "\n" or char.isprintable() for char in printed)


def test_a_number_that_json_does_not_have_is_refused() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        print_json({"score": float("nan")})
