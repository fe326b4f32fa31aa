"""The Python API: what the command line does, from a notebook."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from types import FunctionType

import numpy as np
import pandas as pd
import pytest

import interplan_sumo as ips
from interplan_planners.straight_ahead import StraightAhead
from interplan_sumo.batch.records import ScoreRecord
from interplan_sumo.errors import PlannerLoadError, RunFolderError, UnknownNameError
from interplan_sumo.report.compare import Comparison
from interplan_sumo.world.trajectory import Trajectory
from tests.batch.busy import Log
from tests.environments import environment

SCENE = "nudge/0"
METHODS = (FunctionType, classmethod, staticmethod, property, cached_property)
MINE = replace(ips.load_scenario("overtake/0"), id="mine/0", family="mine", duration_s=3.0)


class Creeping:
    """Straight on at a walk; in a module, so workers can import it."""

    def __init__(self, speed_mps: float = 1.0) -> None:
        self.speed_mps = speed_mps

    def start(self, mission: ips.Mission) -> None:  # noqa: ARG002
        self.ahead_s = np.linspace(0.0, 2.0, 21)

    def plan(self, observation: ips.Observation) -> Trajectory:
        ego, ahead_m = observation.ego, self.speed_mps * self.ahead_s
        x, y = ego.x_m + np.cos(ego.heading_rad) * ahead_m, ego.y_m + np.sin(ego.heading_rad) * ahead_m
        return Trajectory(observation.time_s + self.ahead_s, x, y, np.full(21, ego.heading_rad))


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    """Two planners on one scene; not to be changed."""
    folder = tmp_path_factory.mktemp("api") / "run"
    return ips.run(["straight_ahead", Creeping(3.0)], scenarios=SCENE, workers=0, out=folder)


# --- importing -----------------------------------------------------------------------------------


def _python(*arguments: str, folder: Path | None = None) -> str:
    done = subprocess.run(
        [sys.executable, *arguments], env=environment(), cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_importing_the_package_loads_nothing_heavy_and_nothing_of_its_own() -> None:
    code = (
        "import sys; import interplan_sumo; "
        "heavy = {'numpy', 'pandas', 'libsumo', 'shapely', 'pyarrow', 'typer', 'rich', 'gymnasium'}; "
        "print(sorted(heavy & set(sys.modules)), [m for m in sys.modules if m.startswith('interplan_sumo.')])"
    )
    assert _python("-c", code) == "[] []"


@pytest.mark.parametrize("name", ips.__all__)
def test_every_promised_name_is_there_and_has_a_docstring_as_all_that_one_can_call_on_it(name: str) -> None:
    found = getattr(ips, name)
    members = vars(found).items() if isinstance(found, type) else ()
    methods = [each for part, each in members if not part.startswith("_") and isinstance(each, METHODS)]
    assert all(each.__doc__ for each in (found, *methods))
    assert not str(found.__doc__).startswith(f"{name}("), "a dataclass makes one up"
    assert name in dir(ips)
    with pytest.raises(AttributeError, match=f"has no attribute '{name}_'"):
        getattr(ips, f"{name}_")


# --- run -----------------------------------------------------------------------------------------


def test_a_run_is_a_frame_with_a_row_per_drive(drives: pd.DataFrame) -> None:
    assert drives[["scenario_id", "family", "planner", "seed"]].to_numpy().tolist() == [
        [SCENE, "nudge", "straight_ahead", 0],
        [SCENE, "nudge", "Creeping", 0],
    ]
    assert drives["score"].dtype == np.float64
    assert drives["score"].tolist() == [0.0, 0.0]
    assert drives.loc[0, "no_collision"] == 0.0
    assert drives["reasons"].str.contains("drove into")[0]
    assert drives["fault"].tolist() == [None, None]
    assert drives["official"].all()
    assert all(len(text) == 64 for text in drives["trace_hash"])
    assert all((Path(folder) / "ego.parquet").is_file() for folder in drives["trace"])
    assert {"lane_crossings", "diagnostics"}.isdisjoint(drives.columns)


def test_its_folder_gives_the_same_frame_again(drives: pd.DataFrame) -> None:
    again = ips.load_run(drives.attrs["run_folder"])
    pd.testing.assert_frame_equal(again, drives)
    assert again.attrs == drives.attrs
    assert drives.attrs["suite"] == "interplan==1"
    assert drives.attrs["complete"] is True


@pytest.mark.slow
def test_classes_and_names_go_to_workers_and_give_the_same_traces(drives: pd.DataFrame, tmp_path: Path) -> None:
    found = ips.run([StraightAhead, "straight_ahead?horizon_s=4.0"], scenarios=SCENE, workers=1, out=tmp_path / "run")
    assert found["planner"].tolist() == ["straight_ahead", "straight_ahead?horizon_s=4.0"]
    assert found["trace_hash"][0] == drives["trace_hash"][0]


def test_a_class_of_this_module_is_named_for_workers() -> None:
    from interplan_sumo.batch.given_planners import named_planners

    assert named_planners(Creeping) == (["test_api:Creeping"], {})


@pytest.mark.slow
def test_objects_functions_and_local_classes_drive_in_this_process(capsys: pytest.CaptureFixture[str]) -> None:
    class Local(Creeping):
        pass

    found = ips.run({"walk": Creeping(2.0), "crawl": lambda: Creeping(0.5), "local": Local}, scenarios=MINE)
    assert found["planner"].tolist() == ["walk", "crawl", "local"]
    assert capsys.readouterr().err == (
        "walk, crawl, local: only this process knows it, so it drives here, without workers\n"
    )
    ends = [ips.load_trace(found, "mine/0", name).ego for name in found["planner"]]
    moved = [float(np.hypot(e.x_m[-1] - e.x_m[0], e.y_m[-1] - e.y_m[0])) for e in ends]
    assert moved[0] > moved[2] > moved[1]


def test_a_planner_of_this_process_refuses_workers_and_says_the_way_out() -> None:
    with pytest.raises(ips.InputError, match=r"'Creeping' exists in this process only.*workers=0"):
        ips.run(Creeping(), workers=2)


@pytest.mark.slow
def test_a_script_without_a_main_guard_may_use_workers(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(
        "import interplan_sumo as ips\n"
        f"found = ips.run('interplan_planners.straight_ahead:StraightAhead', scenarios={SCENE!r}, workers=1)\n"
        "print(len(found), found.attrs['run_folder'])\n"
    )
    count, folder = _python("script.py", folder=tmp_path).split()
    assert count == "1"
    assert not Path(folder).exists(), "the temporary folder goes when Python ends"


def test_no_scenarios_are_all_of_the_suite_however_that_is_said() -> None:
    from interplan_sumo.api import _chosen

    assert _chosen("smoke==1", None) == _chosen("smoke==1", ()) == ("smoke==1", ())


def test_an_unchanged_official_scenario_is_official_and_a_changed_one_is_not() -> None:
    from interplan_sumo.api import _chosen

    scene = ips.load_scenario(SCENE)
    assert _chosen(None, scene) == ("interplan==1", (SCENE,))
    assert _chosen("smoke==1", [scene]) == ("smoke==1", (SCENE,))
    suite, (file,) = _chosen(None, replace(scene, duration_s=2.0))
    assert suite is None
    assert ips.load_scenario(file).duration_s == 2.0


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: ips.run("idm2"), UnknownNameError, "Did you mean 'idm'"),
        (lambda: ips.run([]), ips.InputError, "no planner given"),
        (lambda: ips.run("idm", "interplan==9"), UnknownNameError, "suite"),
        (lambda: ips.run("idm", scenarios="nuge/0"), UnknownNameError, "Did you mean 'nudge/"),
        (lambda: ips.run("idm", scenarios=[SCENE, MINE]), ips.InputError, "give one kind"),
        (lambda: ips.run("idm", seeds=0), ips.InputError, "seeds is 0"),
        (lambda: ips.run("idm", density="huge"), UnknownNameError, "density"),  # type: ignore[arg-type]
        (lambda: ips.run(lambda: 3, scenarios=MINE, workers=0), PlannerLoadError, "needs start"),  # type: ignore[arg-type,return-value]
        (lambda: ips.run([Creeping(), Creeping()]), ips.InputError, "two planners are called 'Creeping'"),
        (lambda: ips.run("idm", "smoke==1", progress="x"), ips.InputError, "progress is 'x'; give True, F"),  # type: ignore[arg-type]
        (lambda: ips.run("idm", scenarios=[3]), ips.InputError, "scenarios holds 3; give ids"),  # type: ignore[list-item]
        (lambda: ips.run("idm", scenarios=3), ips.InputError, "scenarios holds 3; give ids"),  # type: ignore[arg-type]
        (lambda: ips.load_planner(Creeping), PlannerLoadError, "takes a name, such as 'idm' .*, and no type"),  # type: ignore[arg-type]
        (lambda: ips.load_run("nowhere"), RunFolderError, "is not a run folder"),
        (lambda: ips.load_scenario("nudge/99"), UnknownNameError, "scenario"),
        (lambda: ips.scenarios("interplan"), UnknownNameError, "Did you mean 'interplan==1'"),
        (lambda: ips.table(), ips.InputError, "needs a run"),
        (lambda: ips.table(pd.DataFrame()), ips.InputError, "run_folder"),
    ],
)
def test_what_cannot_be_used_is_one_line_with_the_way_out(
    call: Callable[[], object], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message) as raised:
        call()
    assert "\n" not in str(raised.value)


# --- what was stored -----------------------------------------------------------------------------


def test_the_table_is_the_papers_with_a_line_per_planner(drives: pd.DataFrame) -> None:
    found = ips.table(drives)
    assert found.index.tolist() == ["straight_ahead", "Creeping"]
    assert found[["interPlan", "Nudge"]].to_numpy().tolist() == [[0.0, 0.0], [0.0, 0.0]]
    assert "LTD" not in found.columns
    pd.testing.assert_frame_equal(found, ips.table(drives.attrs["run_folder"]))


def test_a_drive_is_loaded_with_all_that_its_score_came_from(drives: pd.DataFrame) -> None:
    drive = ips.load_drive(drives, SCENE, "Creeping")
    assert drive.scenario == ips.load_scenario(SCENE)
    assert drive.trace.hash() == drives["trace_hash"][1]
    assert ips.score(drive).score == drives.loc[1, "score"]
    assert ScoreRecord.of(ips.score(drive.trace, SCENE, profile="nuplan")) == ScoreRecord.of(drive.sheet("nuplan"))


def test_a_drive_or_two_are_played_on_a_page(drives: pd.DataFrame, tmp_path: Path) -> None:
    both = [ips.load_drive(drives, SCENE, planner) for planner in drives["planner"]]
    one, two = ips.replay(both[0], tmp_path / "one.html"), ips.replay(both, tmp_path / "two.html")
    assert "Creeping" not in one.read_text(encoding="utf-8")
    assert "Creeping" in two.read_text(encoding="utf-8")


def test_which_drive_is_meant_must_be_said(drives: pd.DataFrame) -> None:
    with pytest.raises(ips.InputError, match="say which: planner=NAME"):
        ips.load_trace(drives, SCENE)
    with pytest.raises(UnknownNameError, match="Did you mean 'Creeping'"):
        ips.load_trace(drives, SCENE, "Creepin")
    with pytest.raises(ips.InputError, match="with seed 7; it has seed 0"):
        ips.load_trace(drives, SCENE, "Creeping", seed=7)
    with pytest.raises(ips.InputError, match="give its scenario"):
        ips.score(ips.load_trace(drives, SCENE, "Creeping"))


def test_two_runs_are_compared_pair_by_pair(drives: pd.DataFrame) -> None:
    found = ips.compare(drives, drives, "straight_ahead", "Creeping", profile="nuplan")
    assert isinstance(found, Comparison)
    assert found.profile == "nuplan"
    assert found.overall.drives == 1


def test_planners_that_two_runs_share_are_compared_with_themselves(drives: pd.DataFrame, tmp_path: Path) -> None:
    again = shutil.copytree(drives.attrs["run_folder"], tmp_path / "again")
    found = ips.compare_all(drives, again)
    assert [pair.overall.difference for pair in found.pairs] == [0.0] * len(found.pairs)
    assert {pair.b for pair in found.pairs} >= {"again: straight_ahead", "again: Creeping"}
    with pytest.raises(ips.InputError, match=r"name one as planner_a, or take compare_all\(a, b\)"):
        ips.compare(drives, again)
    with pytest.raises(ips.InputError, match="name one: --planner-a"):
        ips.compare_all(drives, drives)


def test_scenarios_are_listed_by_suite_and_by_file_and_a_watch_is_told_of_every_drive(tmp_path: Path) -> None:
    from interplan_sumo.scenario.files import write_scenarios

    assert len(ips.scenarios()) == 80
    assert ips.scenarios("smoke==1")[0].id == "construction/0"
    write_scenarios((MINE,), tmp_path / "mine.yaml")
    assert ips.scenarios(str(tmp_path / "mine.yaml")) == (MINE,)
    assert ips.load_scenario(tmp_path / "mine.yaml") == MINE
    watch = Log()
    found = ips.run(Creeping(), scenarios=tmp_path / "mine.yaml", workers=0, progress=watch)
    assert found["scenario_id"].tolist() == ["mine/0"]
    assert (watch.jobs, watch.done, [row.scenario_id for row in watch.rows]) == (1, [], ["mine/0"])
