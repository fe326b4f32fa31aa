"""The engine: whatever a task does to its process, every task is accounted for once and the others are unharmed."""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from interplan_sumo.batch import engine, worker_pool
from interplan_sumo.batch.engine import run_tasks, run_with
from interplan_sumo.batch.records import Fault
from interplan_sumo.batch.tasks import Answer, Limits, Outcome, SharedPhase, Task
from interplan_sumo.batch.worker import attempt
from interplan_sumo.batch.worker_pool import ProcessPool, Worker
from interplan_sumo.errors import InputError, PlannerLoadError
from tests.batch.toys import open_toy
from tests.quick import nightly

pytestmark = pytest.mark.slow  # each starts processes of its own; CI runs them

QUICK = Limits(task_s=2.0, load_s=10.0, memory_bytes=4 << 30)


def run(group: str, folder: Path, *, count: int = 4, workers: int = 2, limits: Limits = QUICK) -> list[Outcome]:
    tasks = [Task((group, n), group, (n, str(folder))) for n in range(count)]
    outcomes = list(run_tasks(tasks, open_toy, workers=workers, limits=limits))
    assert len(outcomes) == count
    assert {o.task.key for o in outcomes} == {t.key for t in tasks}
    return sorted(outcomes, key=lambda o: o.task.payload[0])


def children() -> list[str]:
    """The processes that this one has started and not yet reaped; Linux only."""
    found: list[str] = []
    if sys.platform != "linux":
        return found
    for thread in Path("/proc/self/task").iterdir():
        for pid in (thread / "children").read_text().split():
            command = Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
            if "resource_tracker" not in command:
                found.append(f"{pid} {command}")
    return found


@pytest.mark.parametrize("workers", [0, 1, 3])
def test_every_task_is_done_once_whatever_the_number_of_workers(workers: int, tmp_path: Path) -> None:
    outcomes = run("works", tmp_path, count=7, workers=workers)
    assert [o.value["square"] for o in outcomes] == [0, 1, 4, 9, 16, 25, 36]
    assert all(o.fault is None for o in outcomes)


def test_a_worker_opens_its_group_once_and_serves_many_tasks(tmp_path: Path) -> None:
    outcomes = run("works", tmp_path, count=5, workers=1)
    assert [o.value["nth"] for o in outcomes] == [1, 2, 3, 4, 5]
    assert len({o.value["process"] for o in outcomes}) == 1


def test_a_machine_that_refuses_a_process_ends_the_run_and_blames_no_planner(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "TURN", 1)
    groups = (f"is refused a process in {tmp_path / 'mark'}", "works")
    tasks = [Task((group, n), group, (n, str(tmp_path))) for group in groups for n in range(3)]
    done: list[Outcome] = []
    with pytest.raises(InputError, match="cannot start a process"):
        done.extend(run_tasks(tasks, open_toy, workers=1, limits=QUICK))
    assert not any(outcome.fault for outcome in done)


def test_groups_take_turns_where_workers_are_few(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "TURN", 2)
    tasks = [Task((group, n), group, (n, str(tmp_path))) for group in ("works", "works too") for n in range(3)]
    done = [o.task.group for o in run_tasks(tasks, open_toy, workers=1, limits=QUICK)]
    first, second = dict.fromkeys(done)
    assert done[:4] == [first, first, second, second]
    assert len(done) == len(tasks)


def test_two_groups_never_share_a_process(tmp_path: Path) -> None:
    tasks = [Task((g, n), g, (n, str(tmp_path))) for g in ("one", "two", "three") for n in range(3)]
    outcomes = list(run_tasks(tasks, open_toy, workers=2, limits=QUICK))
    assert len(outcomes) == 9
    served = {o.value["process"]: set[str]() for o in outcomes}
    for outcome in outcomes:
        served[outcome.value["process"]].add(outcome.task.group)
    assert all(len(groups) == 1 for groups in served.values())


@pytest.mark.parametrize(
    ("group", "words"),
    [
        ("raises", "ValueError: I cannot"),
        ("exits", "SystemExit: enough"),
        ("interrupts", "KeyboardInterrupt"),
        ("exits hard", "exited with code 3 inside plan()"),
        ("crashes", "SIGSEGV inside plan()"),
        nightly(("hangs", "no result after 2 s")),
        ("hangs deaf", "no result after 2 s"),
        nightly(("forks and hangs", "no result after 2 s")),
        ("allocates", "MemoryError"),
        ("breaks the interpreter", ""),  # how that ends depends on what breaks first
        ("is killed always", "SIGKILL inside plan()"),
    ],
)
def test_a_planner_that_misbehaves_is_one_planner_fault(group: str, words: str, tmp_path: Path) -> None:
    outcomes = run(group, tmp_path)
    fault = outcomes[1].fault
    assert fault is not None
    assert fault.kind == "planner"
    assert words in fault.message
    for n in (0, 2, 3):
        assert outcomes[n].fault is None
        assert outcomes[n].value["square"] == n * n
    assert children() == []


@pytest.mark.parametrize("workers", [0, 2])
@pytest.mark.parametrize("group", ["forks", "chatters"])
def test_a_planner_that_is_merely_rude_gets_its_result(group: str, workers: int, tmp_path: Path) -> None:
    assert all(o.fault is None for o in run(group, tmp_path, workers=workers))
    if group == "forks" and not workers:  # nobody reaps what a planner forks in the user's own process
        os.wait()
    assert children() == []


def test_what_a_planner_started_dies_with_its_worker(tmp_path: Path) -> None:
    run("forks and hangs", tmp_path)
    child = int((tmp_path / "child").read_text())
    with pytest.raises(ProcessLookupError):
        os.kill(child, 0)


def test_the_last_words_of_a_planner_are_kept_with_its_fault(tmp_path: Path) -> None:
    assert "my last words" in run("exits hard", tmp_path)[1].printed


def test_a_task_whose_worker_somebody_kills_is_done_again(tmp_path: Path) -> None:
    outcomes = run("is killed once", tmp_path)
    assert [o.fault for o in outcomes] == [None] * 4
    assert (tmp_path / "kills").read_text() == "xx"


@pytest.mark.parametrize("others", [(), ("works",)])
def test_a_planner_that_is_killed_while_it_is_built_is_built_again(others: tuple[str, ...], tmp_path: Path) -> None:
    marks = tmp_path / "marks"
    once, always = (f"is killed while opening {how} in {marks}" for how in ("once", "always"))
    tasks = [Task((group, 0), group, (0, str(tmp_path))) for group in (once, *others)]
    assert [o.fault for o in run_tasks(tasks, open_toy, workers=2, limits=QUICK)] == [None] * len(tasks)
    assert marks.read_text() == "xx"
    marks.unlink()
    with pytest.raises(PlannerLoadError, match="its process was killed"):
        list(run_tasks([Task(g, g, (0, "")) for g in (always, *others)], open_toy, workers=2, limits=QUICK))
    assert marks.read_text() == "xxx"


@pytest.mark.parametrize("workers", [0, 2])
def test_a_traffic_fault_is_retried_once(workers: int, tmp_path: Path) -> None:
    assert [o.fault for o in run("loses SUMO once", tmp_path, workers=workers)] == [None] * 4
    assert (tmp_path / "losses").read_text() == "xx"


@pytest.mark.parametrize("workers", [0, 2])
def test_a_second_traffic_fault_is_reported(workers: int, tmp_path: Path) -> None:
    fault = run("loses SUMO always", tmp_path, workers=workers)[1].fault
    assert fault is not None
    assert fault.kind == "traffic"
    assert (tmp_path / "losses").read_text() == "xx"


@pytest.mark.parametrize(
    ("group", "kind"),
    [
        ("raises in simulate", "harness"),
        ("is refused by SUMO in simulate", "traffic"),
        ("crashes in simulate", "traffic"),
        ("is killed always in simulate", "timeout"),
        ("hangs in simulate", "timeout"),
    ],
)
def test_what_goes_wrong_outside_plan_is_not_the_planners_fault(group: str, kind: str, tmp_path: Path) -> None:
    outcomes = run(group, tmp_path, limits=Limits(task_s=1.2))
    fault = outcomes[1].fault
    assert fault is not None
    assert fault.kind == kind
    assert [outcomes[n].fault for n in (0, 2, 3)] == [None] * 3


@pytest.mark.parametrize(
    ("group", "words"), [("raises", "I cannot"), ("exits", "enough"), ("interrupts", "KeyboardInterrupt")]
)
def test_in_process_a_misbehaving_planner_is_one_fault_too(group: str, words: str, tmp_path: Path) -> None:
    outcomes = run(group, tmp_path, workers=0)
    fault = outcomes[1].fault
    assert fault is not None
    assert (fault.kind, [outcomes[n].fault for n in (0, 2, 3)]) == ("planner", [None] * 3)
    assert words in fault.message


@pytest.mark.parametrize("workers", [0, 2])
def test_bad_input_ends_the_run_with_its_own_words(workers: int, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no map named 'nowhere'"):
        run("finds no map in simulate", tmp_path, workers=workers)
    assert children() == []


@pytest.mark.parametrize(
    ("group", "words"),
    [
        ("unopenable", "no toy named 'unopenable'"),
        ("raises while opening", "RuntimeError: no weights"),
        ("exits while opening", "exited with code 7; it printed last: these are my last words"),
    ],
)
def test_a_planner_that_cannot_be_built_ends_the_run_before_any_task(group: str, words: str, tmp_path: Path) -> None:
    tasks = [Task((g, n), g, (n, str(tmp_path))) for g in ("works", "works too", group) for n in range(3)]
    with pytest.raises(InputError) as caught:
        next(run_tasks(tasks, open_toy, workers=2, limits=QUICK))
    assert words in str(caught.value)
    assert children() == []


def test_more_groups_than_workers_are_tried_a_few_at_a_time(tmp_path: Path) -> None:
    most = 0

    class Counted(ProcessPool):
        def start(self, group: str) -> Worker:
            nonlocal most
            worker = super().start(group)
            most = max(most, len(self.workers))
            return worker

    pool = Counted(open_toy, QUICK, tmp_path)
    try:
        assert len(list(run_with(pool, [Task(g, g, (0, str(tmp_path))) for g in "abc"], 2))) == 3
    finally:
        pool.stop_all()
    assert most == 2


@pytest.mark.parametrize(
    ("group", "others", "load_s", "words"),
    [
        ("exits while opening", (), 10.0, "exited with code 7"),
        ("exits while opening", ("works",), 10.0, "exited with code 7"),
        ("opens forever", (), 0.5, r"took longer than 0\.5 s to build"),
    ],
)
def test_a_planner_that_spoils_its_own_building_is_built_once_and_named(
    group: str, others: tuple[str, ...], load_s: float, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker_pool, "GRACE_S", 0.5)
    started: Counter[str] = Counter()

    class Counted(ProcessPool):
        def start(self, group: str) -> Worker:
            started[group] += 1
            return super().start(group)

    pool = Counted(open_toy, replace(QUICK, load_s=load_s), tmp_path)
    try:
        with pytest.raises(PlannerLoadError, match=words):
            list(run_with(pool, [Task(each, each, (0, str(tmp_path))) for each in (group, *others)], 1))
    finally:
        pool.stop_all()
    assert started[group] == 1
    assert children() == []


def test_closing_the_run_early_leaves_no_process(tmp_path: Path) -> None:
    tasks = [Task(n, "hangs", (n, str(tmp_path))) for n in range(4)]
    outcomes = run_tasks(tasks, open_toy, workers=2, limits=Limits())
    assert next(outcomes).fault is None
    time.sleep(0.2)
    outcomes.close()
    assert children() == []


def test_nothing_to_do_starts_no_process() -> None:
    assert list(run_tasks([], open_toy, workers=2, limits=QUICK)) == []
    assert children() == []


def test_whatever_a_task_gives_or_raises_can_be_stored_and_printed() -> None:
    phases = SharedPhase([0])
    found = attempt(lambda _: ({"inf": float("inf"), "two": np.float64(2.0)}, Fault("planner", "\x1b[2J")), 0, phases)
    assert (found.value, found.fault) == ({"inf": None, "two": 2.0}, Fault("planner", "\\x1b[2J"))
    odd = attempt(lambda _: ({"text": "\ud800"}, None), 0, phases)
    assert odd.fault is not None
    assert (odd.value, odd.fault.kind) == ({}, "harness")

    def raises(_: object) -> Answer:
        raise ValueError("\ud800" + "x" * 1_000_000)

    fault = attempt(raises, 0, phases).fault
    assert fault is not None
    assert fault.message.startswith("ValueError: \\ud800xxx")
    assert len(fault.message) == 500
