"""kill -9 of parent or worker at any moment: the same command again gives what an undisturbed run gives."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from tests.batch.toy_run import main
from tests.quick import few

COUNT = 12


def finished(folder: Path) -> dict[str, str]:
    """The results of a finished run, from its lines and from its pieces."""
    found = results(folder)
    frame = pd.read_parquet(folder / "results")
    assert dict(zip(frame["scenario_id"], frame["trace_hash"], strict=True)) == found
    return found


def results(folder: Path) -> dict[str, str]:
    lines = (folder / "results.jsonl").read_text().splitlines()
    rows = [json.loads(line) for line in lines]
    assert len(rows) == len({row["scenario_id"] for row in rows}), "a row counts twice"
    return {row["scenario_id"]: row["trace_hash"] for row in rows}


def workers_of(parent: int) -> list[int]:
    found: list[int] = []
    try:
        threads = list(Path(f"/proc/{parent}/task").iterdir())
    except OSError:
        return found
    for thread in threads:
        try:
            for pid in (thread / "children").read_text().split():
                if "spawn_main" in Path(f"/proc/{pid}/cmdline").read_text():
                    found.append(int(pid))
        except OSError:
            continue
    return found


def started(folder: Path, count: int, stderr: int) -> subprocess.Popen[str]:
    """A run by two workers in a process of its own, whose main module is nothing that workers would import again."""
    program = f"from pathlib import Path; from tests.batch.toy_run import main; main(Path({str(folder)!r}), {count}, 2)"
    return subprocess.Popen([sys.executable, "-c", program], stderr=stderr, text=True)


def size(folder: Path) -> int:
    file = folder / "results.jsonl"
    return file.stat().st_size if file.exists() else 0


def kill_at_random(folder: Path, chance: random.Random) -> bool:
    """Run into `folder` and kill something at a random moment; whether the run was cut short.

    One time in four that is any moment since its start, else one while rows come in.
    """
    before = size(folder)
    process = started(folder, COUNT, stderr=subprocess.PIPE)
    if chance.random() < 0.25:
        time.sleep(chance.uniform(0.0, 1.0))
    else:
        while size(folder) == before and process.poll() is None:
            time.sleep(0.005)
        time.sleep(chance.uniform(0.0, 0.1))
    workers = workers_of(process.pid)
    try:
        if workers and chance.random() < 0.5:
            os.kill(chance.choice(workers), signal.SIGKILL)
        else:
            process.kill()
    except ProcessLookupError:
        pass
    _, errors = process.communicate(timeout=30)
    assert process.returncode in (0, -signal.SIGKILL), errors
    deadline = time.monotonic() + 5.0
    while any(Path(f"/proc/{worker}").exists() for worker in workers) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not any(Path(f"/proc/{worker}").exists() for worker in workers), "a worker outlived its run"
    return process.returncode != 0


def check_kills(place: Path, kills: int, seed: int) -> None:
    """At least so many kills, and as many more as it takes to cut a run short: a quick machine may end each before."""
    main(place / "undisturbed", COUNT, 2)
    expected = finished(place / "undisturbed")
    assert len(expected) == COUNT
    chance = random.Random(seed)
    number = cut_short = 0
    folder = place / "run-0"
    while number < kills or not cut_short:
        assert number < 20 * kills, "no kill cuts a run short"
        number += 1
        cut_short += kill_at_random(folder, chance)
        if (folder / "results.jsonl").exists():
            whole = (folder / "results.jsonl").read_text().rpartition("\n")[0].count("\n")
            if whole >= COUNT - 3:
                main(folder, COUNT, 2)
                assert finished(folder) == expected
                folder = place / f"run-{number}"
    main(folder, COUNT, 2)
    assert finished(folder) == expected


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="finds the workers in /proc")
def test_a_run_killed_again_and_again_ends_like_an_undisturbed_one(tmp_path: Path) -> None:
    check_kills(tmp_path, kills=3, seed=1)


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform != "linux", reason="finds the workers in /proc")
def test_two_hundred_kills_lose_nothing_and_double_nothing(tmp_path: Path) -> None:
    check_kills(tmp_path, kills=200, seed=2)


POLITE = ((signal.SIGTERM,), (signal.SIGINT,), (signal.SIGINT, signal.SIGINT))


@pytest.mark.slow
@pytest.mark.parametrize("signals", few(((each,) for each in POLITE), 1))
def test_a_polite_end_leaves_a_folder_that_goes_on(signals: tuple[signal.Signals, ...], tmp_path: Path) -> None:
    with started(tmp_path, 60, stderr=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + 20.0
        while size(tmp_path) == 0:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        for each in signals:
            process.send_signal(each)
            time.sleep(0.02)
        assert process.wait(timeout=20) != 0
    before = results(tmp_path)
    assert 0 < len(before) < 60
    main(tmp_path, 60, 2)
    assert before.items() <= finished(tmp_path).items()
