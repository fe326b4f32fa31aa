"""Progress: what a run says while it goes on."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from interplan_sumo.batch.briefs import Brief
from interplan_sumo.report.progress import FAULTS_TOLD, LiveProgress, PlainProgress, Tally
from tests.report.rows import drive

ROWS = [
    drive("nudge/0", 1.0, times_s={"simulation": 3.0, "planner": 1.0, "total": 4.0}),
    drive("nudge/1", 0.0, fault=("planner", "plan() raised"), times_s={"total": 4.0}),
    drive("nudge/2", None, fault=("timeout", "killed"), times_s={"total": 2.0}),
]


def spoken(kind: type[PlainProgress] | type[LiveProgress], terminal: bool) -> str:
    file = io.StringIO()
    with kind(Console(file=file, width=120, force_terminal=terminal)) as progress:
        progress.begin(4, [(ROWS[0].key, Brief.of(ROWS[0]))])
        for row in ROWS[1:]:
            progress.finished(row)
    return file.getvalue()


def test_the_tally_knows_mean_faults_and_where_the_time_goes() -> None:
    tally = Tally(3, ())
    assert tally.left == "--:--"
    for row in ROWS:
        tally.add(row)
    assert "mean score 50.0" in tally.summary
    assert "faults: 1 planner, 1 timeout" in tally.summary
    assert "SUMO 30%, planner 10%" in tally.summary
    assert tally.left == "0:00"


@pytest.mark.parametrize(("kind", "terminal"), [(PlainProgress, False), (LiveProgress, True)])
def test_each_fault_is_told_and_the_end_is_summed_up(
    kind: type[PlainProgress] | type[LiveProgress], terminal: bool
) -> None:
    text = spoken(kind, terminal)
    assert "nudge/1, idm, seed 0: planner fault: plan() raised" in text
    assert "nudge/2, idm, seed 0: timeout fault: killed" in text
    assert "3/4 done" in text
    assert "mean score 50.0" in text


def test_each_of_few_planners_has_its_mean_and_many_have_one() -> None:
    for count, words in ((1, "mean score 10.0;"), (2, "mean score p0 10.0, p1 20.0;"), (5, "mean score 30.0;")):
        tally = Tally(count, ())
        for number in range(count):
            tally.add(drive("nudge/0", 0.1 * (number + 1), planner=f"p{number}"))
        assert words in tally.summary


def test_a_planner_that_fails_always_is_no_line_per_drive() -> None:
    file = io.StringIO()
    with PlainProgress(Console(file=file, width=120), "1 scenario") as progress:
        progress.begin(100, ())
        for number in range(100):
            progress.finished(drive(f"nudge/{number}", 0.0, fault=("planner", "plan() raised")))
    lines = file.getvalue().splitlines()
    assert lines[0] == "1 scenario: 100 jobs"
    assert len(lines) == 1 + FAULTS_TOLD + 1
    assert lines[-2].endswith("further faults are only counted")
    assert "100/100 done" in lines[-1]


def test_plain_progress_says_what_was_done_before_without_control_characters() -> None:
    said = spoken(PlainProgress, False)
    assert "4 jobs, 1 of them done already" in said
    assert "\x1b" not in said
