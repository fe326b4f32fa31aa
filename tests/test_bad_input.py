"""Bad input: each command in docs/reference/errors.md says the line that stands there, ends with 2, leaves nothing."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from interplan_sumo.cli import main
from tests.commands import ran

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "errors.md"
CASES = re.findall(r"^\$ (.+)\n(.+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
FILES = {
    "mine.py": "class Best:\n    def __init__(self, speed_mps: float = 8.0) -> None:\n        1 / speed_mps\n",
    "typo.py": "class Best:\n    def start(self, mission:\n",
    "empty.yaml": "",
    "scene.yaml": "id: mine/0\nfamly: nudge\n",
    "list.yaml": "[1, 2\n",
    "profile.yaml": "name: mine\ngates: [no_colision]\n",
    "card.yaml": "nmae: mine\n",
    "rude.xml": '<routes><vType id="a" sigmaa="1"/></routes>',
    "broken.xml": "<routes><vType",
    "mine.zip": "no zip",
    "notes/todo.txt": "drive",
}
RUN = "run --planner straight_ahead --planner idm --suite smoke==1 --scenarios nudge/0 --workers 0 --out run --quiet"


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files, and a small run in the folder `run`."""
    place = tmp_path_factory.mktemp("bad")
    for name, text in FILES.items():
        (place / name).parent.mkdir(exist_ok=True)
        (place / name).write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        assert main(RUN.split()) == 0
    return place


def test_the_page_has_sixty_of_them_each_once_and_says_how_many() -> None:
    commands = [command for command, _ in CASES]
    assert len(commands) == len(set(commands)) >= 60
    assert f"Here are {len(commands)} of them" in PAGE.read_text(encoding="utf-8")
    assert PAGE.read_text(encoding="utf-8").count("\nerror: ") == len(commands)


@pytest.mark.parametrize(("command", "line"), CASES)
def test_it_is_one_line_with_the_way_out_exit_code_2_and_nothing_written(
    command: str, line: str, home: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(home)
    before = sorted(home.rglob("*"))
    code, out, err = ran(capsys, *shlex.split(command))
    assert (code, out, err) == (2, "", f"{line}\n")
    assert [each for each in sorted(home.rglob("*")) if each not in before and "__pycache__" not in each.parts] == []
