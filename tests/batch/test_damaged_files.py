"""Damaged run folders: whatever stands in their files, a command says so in one line and never breaks down."""

from __future__ import annotations

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import pytest

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.results import RESULTS
from interplan_sumo.batch.run import run
from interplan_sumo.batch.run_folder import MANIFEST
from interplan_sumo.cli import main
from interplan_sumo.scenario.files import write_scenarios
from tests.batch.busy import BUSY

FAILS: Final = "tests.batch.rude_planners:NeverBegins"
"""Ends a drive before its first frame: what a damage makes to be driven again takes no time."""
ODD: Final[tuple[Any, ...]] = (
    None, True, False, 0, -1, 1, 2**31, 2**63, 10**400, -(10**400), 0.5, 1.5, -0.0, 1e-320, 1e308,
    float("nan"), float("inf"), float("-inf"), "", "x", "\ud800", "\x00", "\x1b[2J", "../..", "é" * 40, "x" * 100_000,
    "1", "null", [], [0], ["x", None], [[[]]], {}, {"x": 0}, {"class": "planner"}, {"score": "x"},
    {"queries": 3, "fallbacks": {"a": "b"}},
)  # fmt: skip
COMMANDS: Final[tuple[tuple[str, ...], ...]] = (
    ("report", "RUN"),
    ("report", "RUN", "--json"),
    ("report", "RUN", "--why", "--details"),
    ("compare", "RUN", "RUN", "--planner-a", "straight_ahead", "--planner-b", FAILS),
    ("score", "RUN", "--json"),
    ("verify", "RUN", "--planner", FAILS, "--workers", "0", "--quiet"),
    (*"run --planner straight_ahead --scenarios FILE --out RUN --workers 0 --quiet --planner".split(), FAILS),
)  # fmt: skip


def places(value: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Where there is something in plain data, from the whole to the last leaf."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [at, *(place for key, each in inside for place in places(each, (*at, key)))]


def changed(text: bytes, chance: random.Random) -> bytes:
    """JSON with one thing in it replaced, dropped, doubled or renamed."""
    held = json.loads(text)
    *way, last = chance.choice(places(held)[1:])
    parent = held
    for key in way:
        parent = parent[key]
    action = chance.randrange(5)
    if action == 0:
        del parent[last]
    elif action == 1 and isinstance(parent, dict):
        parent[chance.choice(("x", "", "class", "score", "\ud800"))] = parent.pop(last)
    elif action == 2 and isinstance(parent, list):
        parent.extend(parent * chance.choice((1, 1000)))
    else:
        parent[last] = chance.choice(ODD)
    return json.dumps(held).encode()


def torn(text: bytes, chance: random.Random) -> bytes:
    """Bytes with a piece cut out, overwritten or put in."""
    at = chance.randrange(len(text))
    put_in = chance.choice(
        (b"", b"\xff", b"\x00", b"\xc3", b"NaN", b"}", b"]", b'"', b"\n", b"[" * 5000, b"1e999", b"\r\n\r\n")
    )
    return text[:at] + put_in + text[at + chance.choice((0, 0, 1, 7, len(text))) :]


def damaged_line(text: bytes, chance: random.Random, how: Callable[[bytes, random.Random], bytes]) -> bytes:
    lines = text.splitlines()
    number = chance.randrange(len(lines))
    lines[number] = how(lines[number], chance)
    return b"\n".join(lines) + b"\n" * chance.choice((0, 1, 1, 2))


@pytest.fixture
def made(run_of_two: Path, tmp_path: Path) -> Path:
    """A copy of it, to be damaged."""
    return Path(shutil.copytree(run_of_two, tmp_path / "copy"))


@pytest.fixture(scope="module")
def run_of_two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scenario file and a run of it: one drive with a score, one that never began."""
    place = tmp_path_factory.mktemp("damaged")
    write_scenarios((BUSY,), place / "mine.yaml")
    run(RunOptions(("straight_ahead", FAILS), place / "run", scenarios=(str(place / "mine.yaml"),), workers=0))
    return place


def check(made: Path, capsys: pytest.CaptureFixture[str], seeds: range) -> None:
    """Damage the run in as many ways; each time a command answers in a line, or goes on where it does not matter."""
    files = {name: (made / "run" / name).read_bytes() for name in (RESULTS, MANIFEST)}
    codes: dict[int, int] = {}
    for seed in seeds:
        chance = random.Random(seed)
        name, how = chance.choice((RESULTS, RESULTS, MANIFEST)), chance.choice((changed, changed, changed, torn))
        whole = files[name]
        wrong = damaged_line(whole, chance, how) if name == RESULTS else how(whole, chance)
        for each, text in files.items():
            (made / "run" / each).write_bytes(wrong if each == name else text)
        words = {"RUN": str(made / "run"), "FILE": str(made / "mine.yaml")}
        command = [words.get(word, word) for word in COMMANDS[seed % len(COMMANDS)]]
        code = main(command)
        said = capsys.readouterr().err
        what = f"damage {seed} of {name}, {command[0]}: {said[:2000]}"
        assert code in ((0, 1, 2, 3) if command[0] == "verify" else (0, 2, 3)), what
        assert "Traceback" not in said, what
        if code == 2:
            errors = [line for line in said.splitlines() if not line.startswith("warning: ")]
            assert len(errors) == 1, what
            assert errors[0].startswith("error: "), what
            assert len(said) < 2000, what
        codes[code] = codes.get(code, 0) + 1
    assert codes[2] > len(seeds) / 4
    assert codes[0] + codes[3] > len(seeds) / 20


def test_a_damaged_file_is_one_line(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check(made, capsys, range(60))


@pytest.mark.nightly
def test_two_thousand_damaged_files_are_one_line_each(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check(made, capsys, range(60, 2000))
