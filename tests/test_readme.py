"""The README's promises: its planner runs, its commands exist, its files are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from interplan_sumo.cli import main
from interplan_sumo.planner import Planner
from interplan_sumo.testing import check_planner

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_planner_of_the_readme_conforms() -> None:
    code = next(block for block in re.findall(r"```python\n(.*?)```", README, re.DOTALL) if "class Careful" in block)
    names: dict[str, type[Planner]] = {}
    exec(code, names)
    assert not [finding for finding in check_planner(names["Careful"]()) if finding.severity == "error"]


COMMANDS = sorted(
    set(re.findall(r"interplan-sumo ((?:scenarios|planners|maps) \w+|run|report|score|doctor)\b", README))
)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_the_readme_exists(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*command.split(), "--help"]) == 0
    assert command.split()[-1] in capsys.readouterr().out


@pytest.mark.parametrize("option", sorted(set(re.findall(r"interplan-sumo run[^\n]*?(--[a-z]+)", README))))
def test_an_option_of_the_readme_exists(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    main(["run", "--help"])
    assert option in capsys.readouterr().out


@pytest.mark.parametrize("link", sorted(set(re.findall(r"\]\(([^)#:]+)\)", README))))
def test_a_link_of_the_readme_leads_somewhere(link: str) -> None:
    assert (ROOT / link).exists()


@pytest.mark.parametrize("target", ["setup", "check", "test", "test-all", "golden", "smoke", "benchmark"])
def test_every_make_target_exists(target: str) -> None:
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
