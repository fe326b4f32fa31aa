"""Large runs: what the parent keeps of a finished job is its name and no more, however long the row is."""

from __future__ import annotations

import gc
import tracemalloc
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from interplan_sumo.batch import results
from interplan_sumo.batch.engine import run_tasks
from interplan_sumo.batch.records import Row
from interplan_sumo.batch.results import write_rows
from interplan_sumo.batch.run_folder import RunFolder, read_run
from interplan_sumo.batch.tasks import Answer, Limits, Publish, Task, Work
from interplan_sumo.errors import RunFolderError
from interplan_sumo.report.progress import PlainProgress, Tally
from tests.batch.toy_run import toy_manifest
from tests.records import row

BYTES_PER_JOB = 1000
ROW_BYTES = 20_000


class WatchedRow(Row, frozen=True, weakref=True):
    """A row that can be watched going away."""


def long_row(number: int) -> WatchedRow:
    made = row(f"toy/{number}", planner="toy", times_s={"total": 0.5}, printed=f"{number} " + "x" * ROW_BYTES)
    return WatchedRow(**{name: getattr(made, name) for name in made.__struct_fields__})


def opened(path: Path, count: int) -> RunFolder:
    return RunFolder(path, toy_manifest(count))


def growth_per_call(call: Callable[[int], object], count: int) -> float:
    """Bytes that Python keeps for each of the later calls."""
    for number in range(20):
        call(number)
    gc.collect()
    tracemalloc.start()
    for number in range(20, count):
        call(number)
    gc.collect()
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return kept / (count - 20)


def test_a_row_that_was_appended_is_not_kept(tmp_path: Path) -> None:
    with opened(tmp_path, 200) as folder:
        assert growth_per_call(lambda number: folder.append(long_row(number)), 200) < BYTES_PER_JOB
        appended = long_row(0)
        gone = weakref.ref(appended)
        folder.append(appended)
        del appended
        assert gone() is None


def test_progress_keeps_sums_and_not_rows() -> None:
    with PlainProgress(Console(quiet=True)) as progress:
        progress.begin(200, ())
        assert growth_per_call(lambda number: progress.finished(long_row(number)), 200) < BYTES_PER_JOB


def test_progress_reads_what_was_done_before_row_by_row() -> None:
    rows = [long_row(number) for number in range(3)]
    watched = [weakref.ref(each) for each in rows]

    def one_by_one() -> Iterator[Any]:  # a tally reads of rows what it does of briefs
        while rows:
            assert sum(each() is not None for each in watched) <= len(rows) + 1
            last = rows.pop()
            key = (last.scenario_id, last.planner, last.seed)
            yield key, last
            del last

    tally = Tally(9, one_by_one())
    assert tally.done == 3
    assert "mean score 50.0" in tally.summary


def test_a_folder_that_is_opened_again_holds_no_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results, "LINES_AT_ONCE", 256)
    count = 3 * results.LINES_AT_ONCE
    opened(tmp_path, count).close()
    write_rows(tmp_path / "results.jsonl", map(long_row, range(count)))
    tracemalloc.start()
    with opened(tmp_path, count) as folder:
        kept, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert len(folder.done) == count
        assert len(list(folder.kept({("toy/5", "toy", 0)}))) == 1
    assert kept / count < BYTES_PER_JOB
    assert peak < 4 * results.LINES_AT_ONCE * ROW_BYTES  # a part of the file at a time, as bytes and as rows


def open_talkative(_group: str, _publish: Publish) -> Work:
    def work(number: int) -> Answer:
        return {"number": number, "text": "x" * ROW_BYTES}, None

    return work


def test_the_engine_keeps_nothing_of_an_outcome() -> None:
    tasks = [Task(n, "toy", n) for n in range(200)]
    outcomes = run_tasks(tasks, open_talkative, workers=1, limits=Limits())
    assert growth_per_call(lambda _number: next(outcomes), 200) < BYTES_PER_JOB
    outcomes.close()


@pytest.mark.parametrize(("line", "number"), [("[]", 1), ("{}, {}", 4), ('{"score": 1, "fault": null}', 5)])
def test_a_line_that_is_no_row_is_named_wherever_it_stands(
    line: str, number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(results, "LINES_AT_ONCE", 4)
    count = 6
    opened(tmp_path, count).close()
    path = tmp_path / "results.jsonl"
    write_rows(path, (row(f"toy/{n}", planner="toy") for n in range(count)))
    lines = path.read_text().splitlines()
    lines[number - 1] = line
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(RunFolderError, match=rf"results\.jsonl, line {number} is damaged"):
        read_run(tmp_path)


def test_of_two_rows_of_one_job_the_later_counts_and_the_earlier_goes(tmp_path: Path) -> None:
    with opened(tmp_path, 2) as folder:
        for score in (0.25, 0.75):
            folder.append(row("toy/0", score, planner="toy"))
    assert [each.score for each in read_run(tmp_path).rows.values()] == [0.75]
    with opened(tmp_path, 2) as folder:
        assert folder.done == {("toy/0", "toy", 0)}
    assert (tmp_path / "results.jsonl").read_text().count("\n") == 1
