"""Runs of one's own scenarios: driven from a file, scored against an expert of their own, never official."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from interplan_sumo.batch.custom_references import own_expert
from interplan_sumo.batch.jobs import ScenarioSource, split_files
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import AppliedOverrides
from interplan_sumo.batch.run import run
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.batch.score_job import rescore
from interplan_sumo.errors import InputError, RunFolderError, ScenarioError, UnknownNameError
from interplan_sumo.report.table import make_table
from interplan_sumo.scenario.files import write_scenarios
from interplan_sumo.scenario.scenario import LanePosition, TrafficDemand
from interplan_sumo.scenario.suite import DEFAULT_SUITE, find_suite
from tests.batch.busy import PLAIN

OTHER = replace(PLAIN, id="mine/1", traffic=TrafficDemand("low"))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_scenarios((PLAIN, OTHER), tmp_path / "mine.yaml")
    return tmp_path / "mine.yaml"


def request(folder: Path, *scenarios: object, **changes: object) -> RunOptions:
    base = RunOptions(("straight_ahead",), folder, scenarios=tuple(map(str, scenarios)), workers=0)
    return replace(base, **changes)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> StoredRun:
    """Both scenarios driven by one planner; not to be changed."""
    folder = tmp_path_factory.mktemp("own")
    write_scenarios((PLAIN, OTHER), folder / "mine.yaml")
    return run(request(folder / "run", folder / "mine.yaml"))


def test_every_scenario_of_the_file_is_driven_and_none_is_official(stored: StoredRun) -> None:
    assert [row.scenario_id for row in stored.rows.values()] == ["mine/0", "mine/1"]
    for row in stored.rows.values():
        assert row.fault is None
        assert (row.score or 0.0) > 0.0
        assert row.official is False
    assert stored.manifest.suite == "mine.yaml"
    (line,) = make_table([stored]).lines
    assert not line.official


def test_progress_is_measured_against_a_drive_that_is_kept_in_the_folder(stored: StoredRun) -> None:
    kept = sorted((stored.path / "experts").iterdir())
    assert [path.name.partition("-")[0] for path in kept] == ["mine_0", "mine_1"]
    before = {path: path.stat().st_mtime_ns for path in kept}
    again = own_expert(PLAIN, stored.path)
    assert again.x_m[-1] != again.x_m[0]
    assert {path: path.stat().st_mtime_ns for path in kept} == before


def test_overrides_of_own_scenarios_are_scored_again_too(tmp_path: Path, file: Path) -> None:
    found = run(request(tmp_path / "run", file, "mine/1", density="high"))
    scored, problems = rescore(found, "nuplan")
    assert problems == []
    (row,) = scored.rows.values()
    assert row.overrides == AppliedOverrides(density="high")
    assert row.profile == "nuplan"


def test_globs_choose_among_the_scenarios_of_the_file(tmp_path: Path, file: Path) -> None:
    found = run(request(tmp_path / "run", file, "*/1"))
    assert [row.scenario_id for row in found.rows.values()] == ["mine/1"]
    with pytest.raises(UnknownNameError, match="no scenario named 'nudge/0'"):
        run(request(tmp_path / "run", file, "nudge/0"))


def test_a_file_that_has_changed_is_another_benchmark(tmp_path: Path, file: Path) -> None:
    run(request(tmp_path / "run", file, "mine/0"))
    write_scenarios((replace(PLAIN, start_speed_mps=11.0), OTHER), file)
    with pytest.raises(RunFolderError, match="suite_hash"):
        run(request(tmp_path / "run", file, "mine/0"))


def test_a_source_is_a_suite_or_files(tmp_path: Path, file: Path) -> None:
    suite = ScenarioSource.of(None, ())
    assert (suite.name, suite.official) == (DEFAULT_SUITE, True)
    assert suite.hash == find_suite(DEFAULT_SUITE).hash()
    own = ScenarioSource.of(None, (str(file),))
    assert (own.name, own.scenarios, own.official) == ("mine.yaml", (PLAIN, OTHER), False)
    with pytest.raises(InputError, match=r"--suite smoke==1 and the file .*mine\.yaml are two sources"):
        ScenarioSource.of("smoke==1", (str(file),))
    write_scenarios((PLAIN,), tmp_path / "twin.yaml")
    with pytest.raises(InputError, match=r"twin\.yaml: .*mine\.yaml holds a scenario mine/0, too; rename one"):
        ScenarioSource.of(None, (str(file), str(tmp_path / "twin.yaml")))


def test_files_are_told_from_globs() -> None:
    assert split_files(("nudge/*", "mine.yaml", "accident/0")) == (("mine.yaml",), ("nudge/*", "accident/0"))


def test_what_cannot_be_used_is_refused_before_anything_is_driven(tmp_path: Path, file: Path) -> None:
    with pytest.raises(ScenarioError, match="cannot read"):
        run(request(tmp_path / "run", tmp_path / "nowhere.yaml"))
    write_scenarios((replace(PLAIN, goal=LanePosition("402032", 9999.0)),), file)
    with pytest.raises(ScenarioError, match=r"mine/0: goal: lane 402032 is .* long"):
        run(request(tmp_path / "run", file))
    assert not (tmp_path / "run").exists()


def test_a_damaged_expert_is_named(tmp_path: Path, file: Path) -> None:
    found = run(request(tmp_path / "run", file, "mine/0"))
    (kept,) = (found.path / "experts").iterdir()
    kept.write_bytes(b"nothing")
    with pytest.raises(InputError, match="delete it, and it is made again"):
        own_expert(PLAIN, found.path)
    kept.unlink()
    assert len(own_expert(PLAIN, found.path)) > 10
