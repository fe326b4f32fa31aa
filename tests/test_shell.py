"""The shell: help that fits a screen with examples that parse, and completion in bash, zsh and fish."""

from __future__ import annotations

import io
import re
import shlex
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import pytest

from interplan_sumo.cli import command_line, main
from interplan_sumo.cli.completion import VARIABLE
from interplan_sumo.cli.examples import EXAMPLES
from interplan_sumo.scenario.suite import suites
from tests.commands import ran

SCREEN = (80, 50)
"""Columns and rows."""


def commands(command: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    yield path, command
    for name, each in getattr(command, "commands", {}).items():
        yield from commands(each, f"{path} {name}".strip())


def test_the_help_of_every_command_fits_a_screen_and_ends_with_examples(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(SCREEN[0]))
    known = dict(commands(command_line()))
    assert known.keys() == EXAMPLES.keys()
    for path in known:
        code, out, err = ran(capsys, *path.split(), "--help")
        assert (code, err) == (0, "")
        assert f"interplan-sumo {path}".strip() in out
        assert out.count("\n") <= SCREEN[1], path
        assert not re.search(r"<[a-z]+|\.\.\.[]}]", out), f"{path}: a type of Python, or dots twice"
        assert f"interplan-sumo {EXAMPLES[path][0]}"[:60] in out


@pytest.mark.parametrize("example", sorted({each for examples in EXAMPLES.values() for each in examples}))
def test_every_example_parses(example: str) -> None:
    command, words = command_line(), shlex.split(example)
    while getattr(command, "commands", None):
        command = command.commands[words.pop(0)]
    assert command.make_context(example, words).params


def offered(monkeypatch: pytest.MonkeyPatch, *words: str) -> list[str]:
    """What bash would put in for the last of the words, which it breaks at = and :."""
    monkeypatch.setenv(VARIABLE, "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "\n".join(("interplan-sumo", *words)))
    monkeypatch.setenv("COMP_CWORD", str(len(words)))
    said = io.StringIO()
    with redirect_stdout(said):
        assert main([]) == 0
    return said.getvalue().split()


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["com"], ["compare"]),
        (["run", "--planner", "pdm_c"], ["pdm_closed"]),
        (["run", "--profile", "nu"], ["nuplan"]),
        (["run", "--scenarios", "overtake/9"], ["overtake/9"]),
        (["scenarios", "show", "overtake/9"], ["overtake/9"]),
        (["run", "--set", "density", "="], ["low", "medium", "high"]),
        (["run", "--set", "density", "=", "m"], ["medium"]),
        (["run", "--set", "dens"], ["density=low", "density=medium", "density=high"]),
        (["run", "--set", "perception", "=", "noisy+"], ["noisy+occluded", "noisy+late"]),
        (["sweep", "--param", "dens"], ["density="]),
        (["sweep", "--param", "interplan.react"], ["interplan.reactOverlap=", "interplan.reactionTime="]),
        (["sweep", "--param", "density", "=", "low,"], ["low,medium", "low,high"]),
        (["run", "--suite", "smoke"], ["smoke==1"]),
        (["run", "--suite", "smoke", "==", ""], ["1"]),
        (["maps", "check", "str"], ["strip"]),
        (["report", "nowhere/"], []),
    ],
)
def test_bash_is_offered_names_settings_and_values(
    words: list[str], expected: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert offered(monkeypatch, *words) == expected


def test_bash_is_offered_run_folders(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for place in ("runs/one", "runs/two", "alone", "maps/town", "far"):
        (tmp_path / place).mkdir(parents=True)
        if place != "maps/town":
            (tmp_path / place / ("endure.json" if place == "far" else "manifest.json")).touch()
    monkeypatch.chdir(tmp_path)
    assert offered(monkeypatch, "report", "") == ["alone", "runs/one", "runs/two"]
    assert offered(monkeypatch, "compare", "runs/one", "runs/t") == ["runs/two"]
    assert offered(monkeypatch, "rates", "") == ["far"]
    assert offered(monkeypatch, "rates", "far", "--of", "near") == ["near_miss"]
    assert offered(monkeypatch, "verify", f"{tmp_path}/al") == [f"{tmp_path}/alone"]


@pytest.mark.parametrize(("shell", "more"), [("zsh", {}), ("fish", {"_TYPER_COMPLETE_FISH_ACTION": "get-args"})])
def test_zsh_and_fish_are_offered_the_same(
    shell: str, more: dict[str, str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = {VARIABLE: f"complete_{shell}", "_TYPER_COMPLETE_ARGS": "interplan-sumo run --suite "}
    for name, value in (arguments | more).items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SystemExit):
        main([])
    out = capsys.readouterr().out
    assert all(name in out for name in suites())
