"""The command line, in this process or another, as a script sees it."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from interplan_sumo.cli import main


def ran(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a command."""
    capsys.readouterr()
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, out, err


@contextmanager
def started(place: Path, *arguments: object) -> Generator[subprocess.Popen[str]]:
    """The command in a process of its own, once it has written its first row to the run folder `place`."""
    command = [sys.executable, "-m", "interplan_sumo", *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            deadline = time.monotonic() + 30.0
            while not (place / "results.jsonl").exists() or not (place / "results.jsonl").stat().st_size:
                assert time.monotonic() < deadline
                assert process.poll() is None, process.stderr
                time.sleep(0.02)
            yield process
        finally:
            process.kill()
