"""Family: whoever a planner has started is ended with it, and nobody else."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager

import pytest

from interplan_sumo.planner_process.family import descendants, kill_family


@contextmanager
def sleeper() -> Generator[subprocess.Popen[bytes]]:
    with subprocess.Popen([sys.executable, "-S", "-c", "import time; time.sleep(600)"]) as process:
        try:
            yield process
        finally:
            process.kill()


def test_a_number_that_is_somebody_elses_by_now_is_left_alone() -> None:
    with sleeper() as parent, sleeper() as child, sleeper() as stranger:
        began = descendants(os.getpid())
        assert began[child.pid] > 0
        kill_family(parent.pid, known={child.pid: began[child.pid], stranger.pid: began[stranger.pid] - 1})
        assert child.wait(10.0) < 0
        assert parent.wait(10.0) < 0
        assert stranger.poll() is None


def test_a_process_is_ended_where_the_system_has_neither_groups_nor_this_signal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with sleeper() as process:
        with monkeypatch.context() as windows:
            windows.delattr(signal, "SIGKILL", raising=False)
            windows.delattr(os, "killpg", raising=False)
            kill_family(process.pid)
        assert process.wait(10.0) != 0
