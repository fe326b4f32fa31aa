"""Pages of the documentation as blocks and commands, and the process in which a page does what it says."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from tests.environments import environment

SLOW = "<!-- docs: slow -->"
"""Stands before a fenced block that only the slow tests run."""
ELSEWHERE = "<!-- docs: elsewhere -->"
"""Stands before a fenced block that needs what no test may count on, a server or the network: it is only parsed."""
SKETCHES = ("/.../",)
"""What holds one of these is shortened for readers, and only read."""
PLACEHOLDERS = {"N": "1", "S": "1"}
"""Words of listings that stand for a number of the reader's; those for names and folders may stand for themselves."""

_FENCE = re.compile(r"^```(\w*)\s*$")
_FILE = re.compile(r"^(?:#|<!--) ([\w./-]+\.(?:py|toml|xml|yaml))(?: -->)?$")
_BRACES = re.compile(r"([^{}]*)\{([^{}]*,[^{}]*)\}([^{}]*)")
_OPERATORS = {"|", "||", "&&", ";", ">", ">>", "2>", "2>&1", "<"}
COMMAND = "interplan-sumo"


@dataclass(frozen=True)
class Block:
    """A fenced block; one whose first line is a comment with a file's name is that file."""

    page: str
    line: int
    """Of its first line, counted from 1."""
    language: str
    text: str
    slow: bool
    elsewhere: bool = False

    @property
    def file(self) -> str | None:
        found = _FILE.match(self.text.partition("\n")[0])
        return found.group(1) if found else None

    @property
    def is_sketch(self) -> bool:
        return any(sketch in self.text for sketch in SKETCHES)

    @property
    def runs(self) -> bool:
        return (
            not self.is_sketch and not self.elsewhere and (self.file is not None or self.language in ("python", "sh"))
        )


def blocks_of(page: Path) -> list[Block]:
    """The fenced blocks of a page, in order."""
    found: list[Block] = []
    lines = page.read_text(encoding="utf-8").splitlines()
    opened: tuple[int, str] | None = None
    for number, line in enumerate(lines):
        fence = _FENCE.match(line)
        if opened is None and fence:
            opened = (number, fence.group(1))
        elif opened is not None and line == "```":
            begun, language = opened
            text = "\n".join(lines[begun + 1 : number]) + "\n"
            mark = lines[begun - 1]
            found.append(Block(page.name, begun + 2, language, text, mark == SLOW, mark == ELSEWHERE))
            opened = None
    assert opened is None, f"{page.name}: the block of line {opened} has no end"
    return found


def commands_of(page: Path) -> list[tuple[int, list[str]]]:
    """Every interplan-sumo command of a page's sh blocks and indented listings: its line, and its words after the name.

    Lines that end in a backslash go on; comments and what follows a shell's operator are left out.
    """
    found: list[tuple[int, list[str]]] = []
    language: str | None = None
    lines = enumerate(page.read_text(encoding="utf-8").splitlines(), start=1)
    for number, line in lines:
        if fence := _FENCE.match(line):
            language = fence.group(1) if language is None else None
        elif language == "sh" or (language is None and line.startswith("    ")):
            text = line
            while text.endswith("\\"):
                text = text[:-1] + next(lines)[1]
            found += [(number, words) for words in _commands(text)]
    return found


def mentions_of(page: Path) -> list[list[str]]:
    """Every interplan-sumo command in the text of a page, between backticks: its words after the name."""
    spans = re.findall(rf"(?<!`)`({COMMAND} [^`]+)`", page.read_text(encoding="utf-8"))
    return [words for span in spans for words in _commands(" ".join(span.split()))]


def _commands(line: str) -> list[list[str]]:
    if not line.lstrip().startswith(COMMAND):
        return []
    found: list[list[str]] = []
    is_ours = False
    for word in shlex.split(line, comments=True):
        if word == COMMAND:
            found.append([])
            is_ours = True
        elif word in _OPERATORS:
            is_ours = False
        elif is_ours:
            found[-1] += [PLACEHOLDERS.get(each, each) for each in _braces(word)]
    return found


def _braces(word: str) -> list[str]:
    """A word as the shell expands it: a{0,1} is a0 a1."""
    found = _BRACES.fullmatch(word)
    return [f"{found[1]}{each}{found[3]}" for each in found[2].split(",")] if found else [word]


# --- running a page ------------------------------------------------------------------------------


def drive_page(blocks: list[Block], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run blocks one after the other in one new process, in `folder`."""
    places = folder / ".places"
    places.mkdir()
    command = places / COMMAND
    command.write_text(
        "#!/bin/sh\n"
        f'exec "{sys.executable}" -c "import sys; from interplan_sumo.cli import main; sys.exit(main())" "$@"\n'
    )
    command.chmod(0o755)
    installed = folder / ".installed"
    pip = places / "pip"  # what a page installs is there for this page only
    pip.write_text(
        f'#!/bin/sh\n[ "$1" = install ] && shift\nexec "{sys.executable}" -m pip install --quiet --no-deps '
        f'--no-build-isolation --disable-pip-version-check --target "{installed}" "$@"\n'
    )
    pip.chmod(0o755)
    programs = f"{places}:{Path(sys.executable).parent}:{os.environ['PATH']}"
    return subprocess.run(
        [sys.executable, "-c", "from docs_pages import main; main()"],
        input=json.dumps([asdict(block) for block in blocks]),
        cwd=folder,
        env=environment(installed, PATH=programs),
        capture_output=True,
        text=True,
        check=False,
        timeout=1200,
    )


def main() -> None:
    """In the page's process: do the blocks of stdin, as a reader with a notebook and a shell would."""
    sys.path.append("")  # as a notebook has it: modules that the page writes
    notebook: dict[str, Any] = vars(sys.modules["__main__"])
    for each in json.load(sys.stdin):
        block = Block(**each)
        print(f"{block.page}, line {block.line}", flush=True)
        if block.file is not None:
            Path(block.file).parent.mkdir(parents=True, exist_ok=True)
            Path(block.file).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            # the lines before it, empty, so that a traceback names the line of the page
            exec(compile("\n" * (block.line - 1) + block.text, block.page, "exec"), notebook)
        else:
            subprocess.run(["bash", "-euo", "pipefail", "-c", block.text], check=True)
