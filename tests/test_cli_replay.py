"""The command `replay`: what it writes, for whom, and what it says where it cannot."""

from __future__ import annotations

from pathlib import Path

import pytest
import typer

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.run import run
from interplan_sumo.cli.replay import replay
from interplan_sumo.errors import InputError, UnknownNameError

PLANNERS = ("straight_ahead", "tests.batch.rude_planners:Raises", "tests.batch.rude_planners:NeverBegins")


command = typer.Typer()
command.command()(replay)


def replayed(folder: Path, *arguments: object) -> None:
    command([str(folder), *map(str, arguments)], standalone_mode=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of one scenario: a planner that drives, one that fails on the way, one that never begins."""
    place = tmp_path_factory.mktemp("replayed") / "run"
    run(RunOptions(planners=PLANNERS, suite="smoke==1", scenarios=("nudge/0",), out=place, workers=0))
    return place


def title(page: Path) -> str:
    return page.read_text(encoding="utf-8").partition("<title>")[2].partition("</title>")[0]


def test_without_a_planner_the_first_two_of_the_run_are_shown_also_one_that_failed(
    folder: Path, tmp_path: Path
) -> None:
    replayed(folder, "nudge/0", "--html", tmp_path / "drive.html")
    assert title(tmp_path / "drive.html") == "nudge/0 with straight_ahead and tests.batch.rude_planners:Raises"


def test_planners_are_shown_once_and_in_the_order_in_which_they_are_named(folder: Path, tmp_path: Path) -> None:
    chosen = [word for number in (1, 0, 1) for word in ("--planner", PLANNERS[number])]
    replayed(folder, "nudge/0", *chosen, "--html", tmp_path / "drive.html")
    assert title(tmp_path / "drive.html") == "nudge/0 with tests.batch.rude_planners:Raises and straight_ahead"


def test_several_things_can_be_asked_for_at_once(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib", reason="films need the plots extra")
    wanted = [tmp_path / "drive.html", tmp_path / "drive.png", tmp_path / "drive.gif"]
    asked = [word for path in wanted for word in (f"--{path.suffix[1:]}", path)]
    replayed(folder, "nudge/0", "--planner", "straight_ahead", *asked, "--at", 1, "--from", 0, "--to", 0.4)
    assert capsys.readouterr().err.splitlines() == [f"wrote {path}" for path in (wanted[0], wanted[2], wanted[1])]
    assert all(path.stat().st_size > 1000 for path in wanted)


def test_sumo_gui_gets_a_folder_for_one_planner_and_one_each_for_two(folder: Path, tmp_path: Path) -> None:
    replayed(folder, "nudge/0", "--planner", "straight_ahead", "--sumo-gui", tmp_path / "one")
    assert (tmp_path / "one" / "playback.sumocfg").is_file()
    replayed(folder, "nudge/0", "--sumo-gui", tmp_path / "two")
    assert len(list((tmp_path / "two").glob("*/playback.sumocfg"))) == 2


def test_asking_for_nothing_names_what_could_be_asked_for(folder: Path) -> None:
    with pytest.raises(InputError, match="give --html FILE, --gif, --mp4, --png or --sumo-gui DIR"):
        replayed(folder, "nudge/0")


def test_an_unknown_scenario_and_an_unknown_planner_are_met_with_those_of_the_run(folder: Path, tmp_path: Path) -> None:
    page = ("--html", tmp_path / "drive.html")
    with pytest.raises(UnknownNameError, match=r"no scenario in .*run named 'nuge/0'. Did you mean 'nudge/0'\?"):
        replayed(folder, "nuge/0", *page)
    with pytest.raises(UnknownNameError, match=r"named 'straight'. Did you mean 'straight_ahead'\?"):
        replayed(folder, "nudge/0", "--planner", "straight", *page)
    with pytest.raises(InputError, match="has no drive of nudge/0 with seed 7; it has seed 0"):
        replayed(folder, "nudge/0", "--seed", 7, *page)
    assert not page[1].exists()


def test_a_drive_that_left_no_trace_is_refused_with_its_fault(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="NeverBegins on nudge/0, seed 0, left no trace: planner fault"):
        replayed(folder, "nudge/0", "--planner", PLANNERS[2], "--html", tmp_path / "drive.html")
