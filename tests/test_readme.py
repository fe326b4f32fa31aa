"""The README's promises: its planner runs, its commands exist, its files are there."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from interplan_sumo.cli import main
from interplan_sumo.planner import Planner
from interplan_sumo.testing import check_planner
from tests.environments import environment

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_planner_of_the_readme_conforms() -> None:
    code = next(block for block in re.findall(r"```python\n(.*?)```", README, re.DOTALL) if "class Careful" in block)
    names: dict[str, type[Planner]] = {}
    exec(code, names)
    assert not [finding for finding in check_planner(names["Careful"]()) if finding.severity == "error"]


@pytest.mark.slow
def test_the_planner_of_the_readme_runs_from_the_folder_that_it_lies_in(tmp_path: Path) -> None:
    code = next(block for block in re.findall(r"```python\n(.*?)```", README, re.DOTALL) if "class Careful" in block)
    (tmp_path / "my_planner.py").write_text(code)
    command = [sys.executable, "-c", "import sys; from interplan_sumo.cli import main; sys.exit(main())"]
    told = environment(PYTHONSAFEPATH="1")
    for arguments in (
        "planners check my_planner:Careful",
        "run --planner my_planner:Careful --suite smoke==1 --limit 1 --workers 1 --out out --quiet",
    ):
        done = subprocess.run(
            [*command, *arguments.split()], cwd=tmp_path, env=told, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    missing = subprocess.run(
        [*command, "run", "--planner", "your_planner:Careful", "--out", "other"],
        cwd=tmp_path, env=told, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert missing.returncode == 2
    assert "there is no module 'your_planner'" in missing.stderr
    assert not (tmp_path / "other").exists()


@pytest.mark.slow
def test_the_eight_commands_go_on_from_one_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    block = README[README.index("## Eight commands") : README.index("Every command takes")]
    commands = [shlex.split(line, comments=True) for line in block.splitlines() if line.startswith("    ")]
    assert len(commands) == 8
    monkeypatch.chdir(tmp_path)
    for name, *arguments in commands:
        assert name == "interplan-sumo"
        if arguments[0] == "run":  # the scene of the replay shows as much as all that `make smoke` drives
            arguments += ["--scenarios", "overtake/0"]
        assert main(arguments) == 0, (arguments, capsys.readouterr().err)


def test_the_readme_fits_three_screens() -> None:
    assert len(README.splitlines()) <= 110


@pytest.mark.parametrize("target", ["setup", "check", "test", "test-all", "golden", "smoke", "benchmark"])
def test_every_make_target_exists(target: str) -> None:
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
