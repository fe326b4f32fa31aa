"""Progress: what a run says while it goes on."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from interplan_sumo.batch.briefs import Brief
from interplan_sumo.report.progress import LiveProgress, PlainProgress, Tally
from tests.report.rows import drive

ROWS = [
    drive("nudge/0", 1.0, times_s={"simulation": 3.0, "planner": 1.0, "total": 4.0}),
    drive("nudge/1", 0.0, fault=("planner", "plan() raised"), times_s={"total": 4.0}),
    drive("nudge/2", None, fault=("timeout", "killed"), times_s={"total": 2.0}),
]


def spoken(kind: type[PlainProgress] | type[LiveProgress], terminal: bool) -> str:
    file = io.StringIO()
    with kind(Console(file=file, width=120, force_terminal=terminal)) as progress:
        progress.begin(4, [Brief.of(ROWS[0])])
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


def test_plain_progress_says_what_was_done_before_without_control_characters() -> None:
    said = spoken(PlainProgress, False)
    assert "4 jobs, 1 of them done already" in said
    assert "\x1b" not in said
