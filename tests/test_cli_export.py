"""The command `export`: its words on stdout and stderr, its JSON, and its refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import typer

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.run import run
from interplan_sumo.cli.export import export
from interplan_sumo.dataset.reading import read_dataset

APP = typer.Typer()
APP.command()(export)


def called(*arguments: object) -> int:
    return APP([str(each) for each in arguments], standalone_mode=False)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "mine"
    run(RunOptions(("idm",), folder, suite="smoke==1", scenarios=("nudge/0",), seeds=2, workers=0))
    return folder


def test_it_says_what_it_wrote(driven: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = called(driven, "--out", tmp_path / "data", "--min-score", 0, "--holdout-seeds", 1, "--workers", 0)
    said = capsys.readouterr()
    dataset = read_dataset(tmp_path / "data")
    train, val = len(dataset.split("train")), len(dataset.split("val"))
    assert code == 0
    assert f"{train + val} samples ({train} train, {val} val) of 2 drives: {tmp_path / 'data'}" in said.out
    assert f"hash {dataset.hash[:16]}" in said.out
    assert said.err.splitlines() == ["[1/2] nudge/0, idm, seed 0", "[2/2] nudge/0, idm, seed 1"]


def test_as_json_it_is_one_document_and_quiet_is_quiet(
    driven: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = (driven, "--out", tmp_path / "data", "--min-score", 0, "--every", 2, "--workers", 0)
    assert called(*arguments, "--json", "--quiet") == 0
    said = capsys.readouterr()
    found: dict[str, Any] = json.loads(said.out)
    assert said.err == ""
    assert found["hash"] == read_dataset(tmp_path / "data").hash
    assert found["drives"] == 2
    assert found["by_split"] == {"train": found["samples"]}
    assert found["by_family"] == {"nudge": found["samples"]}
    assert found["bytes"] > 0


def test_what_was_left_out_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("--out", tmp_path / "data", "--certificates", "smoke==1", "--every", 5, "--workers", 0)
    families = ("construction", "accident", "jaywalker", "overtake", "lane_change_ltd", "lane_change_mtd")
    excluded = [text for family in (*families, "lane_change_htd") for text in ("--exclude", family)]
    assert called(*arguments, *excluded) == 0
    assert "left out: 7 family excluded" in capsys.readouterr().out
