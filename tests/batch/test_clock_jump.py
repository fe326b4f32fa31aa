"""The machine's clock jumps by a day in the middle of a run: its rows are those of an undisturbed one."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.run import run
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.scenario.files import write_scenarios
from tests.batch.busy import BUSY
from tests.environments import environment
from tests.records import hashes

PLANNERS = ("straight_ahead", "idm")
SCENES = [replace(BUSY, id=f"mine/{number}", start_speed_mps=8.0 + number) for number in range(4)]
CLOCK = """
import os, time

REAL_S = time.time


def jumped_s():
    return REAL_S() + ({by_s} if os.path.exists({jumps!r}) else 0.0)


open({jumps!r} + " by " + str(os.getpid()), "w").close()
time.time = jumped_s
time.time_ns = lambda: round(1e9 * jumped_s())
"""
"""For every Python process of the run: once the file is there, it is so much later."""


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> StoredRun:
    place = tmp_path_factory.mktemp("undisturbed")
    write_scenarios(SCENES, place / "mine.yaml")
    return run(RunOptions(PLANNERS, place / "run", scenarios=(str(place / "mine.yaml"),), workers=0))


@pytest.mark.nightly
@pytest.mark.parametrize("by_s", [86_400.0, -86_400.0])
def test_a_clock_that_jumps_by_a_day_changes_no_row(by_s: float, undisturbed: StoredRun, tmp_path: Path) -> None:
    jumps = tmp_path / "jumps"
    (tmp_path / "clock").mkdir()
    (tmp_path / "clock" / "sitecustomize.py").write_text(CLOCK.format(by_s=by_s, jumps=str(jumps)))
    folder = tmp_path / "run"
    command = [sys.executable, "-m", "interplan_sumo", "run", "--quiet", "--workers", "2", "--out", str(folder)]
    command += ["--scenarios", str(undisturbed.path.parent / "mine.yaml")]
    command += [word for planner in PLANNERS for word in ("--planner", planner)]
    lines, deadline_s = folder / "results.jsonl", time.monotonic() + 120.0
    with subprocess.Popen(command, env=environment(tmp_path / "clock"), stdout=subprocess.DEVNULL) as process:
        while not (lines.exists() and lines.stat().st_size):
            assert process.poll() is None
            assert time.monotonic() < deadline_s
            time.sleep(0.005)
        jumps.touch()
        before = lines.read_text().count("\n")
        assert process.wait(timeout=120) == 0
    assert len(list(tmp_path.glob("jumps by *"))) >= 3  # the command and its workers
    assert 0 < before < len(SCENES) * len(PLANNERS)
    assert hashes(read_run(folder)) == hashes(undisturbed)
