"""Replays beside the page: which drives get one, and what happens to those that cannot."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec import structs
from typer.main import get_command

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import Shard
from interplan_sumo.batch.run import run
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.cli.runs import app
from interplan_sumo.errors import InputError
from interplan_sumo.report.page.drives import pair_replay, replays_folder, shown_drives
from interplan_sumo.report.page.replays import replay_jobs, wanted_drives
from interplan_sumo.report.printing import write_page
from interplan_sumo.report.table import ResultsTable, make_table
from tests.report.rows import drive, stored


def table() -> ResultsTable:
    rows = [drive("nudge/0", 1.0), drive("nudge/1", 0.5, no_collision=0.0), drive("nudge/2", 0.2, no_collision=0.0)]
    return make_table([stored(*rows)])


@pytest.mark.parametrize(
    ("which", "scenarios"),
    [
        ("all", ["nudge/0", "nudge/1", "nudge/2"]), ("lost", ["nudge/1", "nudge/2"]), ("none", []),
        ("0", []), ("1", ["nudge/2"]), ("2", ["nudge/2", "nudge/1"]), ("9", ["nudge/2", "nudge/1", "nudge/0"]),
    ],
)  # fmt: skip
def test_drives_are_chosen_by_a_word_or_by_how_many_of_the_worst(which: str, scenarios: list[str]) -> None:
    assert [each.scenario for each in wanted_drives(table(), which)] == scenarios


@pytest.mark.parametrize("which", ["some", "-1", "1.5", "", "²"])
def test_another_word_is_refused(which: str) -> None:
    with pytest.raises(InputError, match="give all, lost, none or how many"):
        wanted_drives(table(), which)


def test_replays_without_a_page_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--replays lost are made beside a page; give its file as --html"):
        get_command(app)(["report", str(tmp_path), "--replays", "lost"], standalone_mode=False)


def test_several_planners_on_a_scenario_get_a_page_of_the_best_beside_the_worst(tmp_path: Path) -> None:
    held = stored(*(drive("nudge/0", score, planner=name) for name, score in (("a", 0.4), ("b", 0.9), ("c", 0.1))))
    *single, pair = replay_jobs(make_table([held]), [held], tmp_path / "report.html", "all")
    assert len(single) == 3
    assert [key[1] for _, key in pair.drives] == ["b", "c"]
    assert pair.path == tmp_path / "report-replays" / pair_replay(shown_drives(make_table([held])))


def test_a_replay_is_of_the_run_and_the_shard_that_its_line_is_about(tmp_path: Path) -> None:
    rows = [drive(f"nudge/{number}", 0.5) for number in range(2)]
    whole = stored(*rows, path="runs/whole")
    shards = [
        StoredRun(Path(f"runs/{n}"), structs.replace(whole.manifest, shard=Shard(n, 2)), {row.key: row})
        for n, row in enumerate(rows, start=1)
    ]
    runs = [whole, *shards]
    jobs = replay_jobs(make_table(runs), runs, tmp_path / "report.html", "all")
    places = [(place.name, key[0]) for job in jobs for place, key in job.drives]
    assert sorted(places) == [("1", "nudge/0"), ("2", "nudge/1"), ("whole", "nudge/0"), ("whole", "nudge/1")]


def test_the_best_drive_is_shown_beside_the_worst_though_it_lost_nothing_unless_they_are_equal(tmp_path: Path) -> None:
    lost = drive("nudge/0", 0.0, planner="b", no_collision=0.0)
    whole, equal = drive("nudge/0", 1.0, planner="a"), drive("nudge/0", 0.0, planner="a", no_collision=0.0)
    for other, planners in ((whole, [["b"], ["a", "b"]]), (equal, [["a"], ["b"]])):
        held = stored(other, lost)
        jobs = replay_jobs(make_table([held]), [held], tmp_path / "report.html", "lost")
        assert [[key[1] for _, key in job.drives] for job in jobs] == planners


def test_names_of_replays_differ_where_drives_do() -> None:
    rows = [drive("nudge/0", 1.0, planner=name, seed=seed) for name in ("a b", "a_b") for seed in range(2)]
    assert len({each.replay for each in shown_drives(make_table([stored(*rows)]))}) == 4


def test_replays_are_made_and_linked_and_a_drive_without_a_trace_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    planners = ("straight_ahead", "tests.batch.rude_planners:NeverBegins")
    run(RunOptions(planners=planners, suite="smoke==1", scenarios=("nudge/0",), out=tmp_path / "run", workers=0))
    held = read_run(tmp_path / "run")
    page = tmp_path / "my report.html"
    write_page(make_table([held]), page, [held], replays="lost")
    made = list(replays_folder(page).iterdir())
    assert len(made) == 1
    assert f'<a href="my%20report-replays/{made[0].name}#decides">replay</a>' in page.read_text(encoding="utf-8")
    said = capsys.readouterr().err
    assert "replays: 2 of 2" in said
    assert said.count("no replay: ") == 1
    assert "no model for" in said
