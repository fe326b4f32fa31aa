"""Interruption: a batch system's polite end does what Ctrl-C does, in every command."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from interplan_sumo.interruption import terminated_like_interrupted


def test_a_polite_end_is_an_interruption_inside_the_block_only() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), terminated_like_interrupted():
        os.kill(os.getpid(), signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.slow
def test_a_command_that_is_told_to_end_does(tmp_path: Path) -> None:
    given = ("scenarios", "generate", "--map", "strip", "--family", "all", "--count", "5", "--workers", "1")
    command = [sys.executable, "-m", "interplan_sumo", *given, "--out", str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        first = process.stderr.readline()  # it is at work
        process.terminate()
        _, said = process.communicate(timeout=60.0)
    assert first
    assert process.returncode == 130
    assert "Traceback" not in said
