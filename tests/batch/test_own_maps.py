"""Scenarios with maps of their own run anywhere, in any number of processes, and their runs need nothing else."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest

from interplan_sumo.batch.jobs import ScenarioSource, own_maps
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.run import run
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.batch.score_job import rescore
from interplan_sumo.cli import main
from interplan_sumo.errors import InputError, MapError, RunFolderError
from interplan_sumo.maps.store import find_map, load_roads
from interplan_sumo.scenario.files import read_scenarios
from interplan_sumo.verification.recorded_scenes import Moments, recorded_scenes, write_scenes
from interplan_sumo.world.recording import Recording
from tests.records import hashes
from tests.scenario.made_recordings import recording, track

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A generated folder on a map that is not shipped and is gone by now; not to be changed."""
    place = tmp_path_factory.mktemp("generated")
    shutil.copytree(find_map("strip").folder, place / "maps" / "backwater" / "1.0")
    command = ["scenarios", "generate", "--map", str(place / "maps" / "backwater"), "--family", "nudge", "--count", "1"]
    assert main([*command, "--seed", "3", "--workers", "0", "--out", str(place / "made"), "--json"]) == 0
    shutil.rmtree(place / "maps")
    return place / "made"


def driven(file: Path, out: Path, workers: int = 0, planners: Sequence[str] = ("straight_ahead",)) -> StoredRun:
    return run(RunOptions(planners=tuple(planners), out=out, scenarios=(str(file),), workers=workers))


def test_a_moved_folder_gives_the_same_drives_in_any_number_of_processes(folder: Path, tmp_path: Path) -> None:
    here = driven(folder / "scenarios.yaml", tmp_path / "here")
    shutil.copytree(folder, tmp_path / "elsewhere")
    there = driven(tmp_path / "elsewhere" / "scenarios.yaml", tmp_path / "there", workers=2)
    assert hashes(here) == hashes(there)
    assert all(row.fault is None for row in there.rows.values())
    assert here.manifest.suite_hash == there.manifest.suite_hash


def test_a_run_can_be_scored_again_without_the_files_that_it_came_from(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "made")
    expected = hashes(driven(tmp_path / "made" / "scenarios.yaml", tmp_path / "run"))
    shutil.rmtree(tmp_path / "made")
    (tmp_path / "run").rename(tmp_path / "moved")
    again, problems = rescore(read_run(tmp_path / "moved"), "interplan-strict")
    assert problems == []
    assert hashes(again) == expected


def test_a_folder_of_a_run_on_another_map_of_that_name_is_refused(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "made")
    file = tmp_path / "made" / "scenarios.yaml"
    driven(file, tmp_path / "run")
    driven(file, tmp_path / "run")  # the same one goes on
    ids = tmp_path / "made" / "maps" / "backwater" / "1.0" / "ids.json"
    ids.write_text(ids.read_text() + "\n")
    with pytest.raises(RunFolderError, match="suite_hash"):
        driven(file, tmp_path / "run")


def test_two_maps_of_one_name_in_one_run_are_refused_unless_they_are_equal(folder: Path, tmp_path: Path) -> None:
    scenarios = read_scenarios(folder / "scenarios.yaml")
    shutil.copytree(folder, tmp_path / "twin")
    both = [*scenarios, *read_scenarios(tmp_path / "twin" / "scenarios.yaml")]
    assert [each.name for each in own_maps(both)] == ["backwater"]
    ids = tmp_path / "twin" / "maps" / "backwater" / "1.0" / "ids.json"
    ids.write_text(ids.read_text() + "\n")
    with pytest.raises(InputError, match="two maps of one name"):
        own_maps(both)


def test_a_map_beside_that_has_a_shipped_name_is_refused(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "made")
    (tmp_path / "made" / "maps" / "backwater").rename(tmp_path / "made" / "maps" / "strip")
    file = tmp_path / "made" / "scenarios.yaml"
    file.write_text(file.read_text().replace("map: backwater", "map: strip"))
    with pytest.raises(MapError, match="map 'strip' is a shipped one"):
        ScenarioSource.of(None, (str(file),))


def test_a_folder_of_maps_that_no_scenario_names_changes_no_hash(tmp_path: Path) -> None:
    assert main(["scenarios", "export", "nudge/0", str(tmp_path / "mine.yaml")]) == 0
    before = ScenarioSource.of(None, (str(tmp_path / "mine.yaml"),)).hash
    (tmp_path / "maps" / "other").mkdir(parents=True)
    assert ScenarioSource.of(None, (str(tmp_path / "mine.yaml"),)).hash == before


def test_every_command_about_scenarios_finds_the_map_beside_the_file(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(folder, tmp_path / "made")
    monkeypatch.chdir(tmp_path)
    file = "made/scenarios.yaml"
    assert main(["scenarios", "validate", file]) == 0
    assert "1 scenario, no problems" in capsys.readouterr().out
    assert main(["scenarios", "show", file, "--json"]) == 0
    (shown,) = json.loads(capsys.readouterr().out)
    assert (shown["map"], shown["id"]) == ("backwater", "backwater.nudge/3-0")
    assert main(["scenarios", "render", file, "made.png"]) == 0
    assert main(["scenarios", "certify", "--scenarios", file, "--check", "--workers", "0"]) == 0
    assert "1 of 1 certified" in capsys.readouterr().out
    assert main(["scenarios", "audit", file, "--workers", "0", "--quiet", "--planner", "straight_ahead"]) == 0


@pytest.mark.nightly
def test_certificates_of_a_file_are_stored_beside_it(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(folder, tmp_path / "made")
    proofs = tmp_path / "made" / "certificates.parquet"
    before = proofs.read_bytes()
    proofs.unlink()
    file = str(tmp_path / "made" / "scenarios.yaml")
    assert main(["scenarios", "certify", "--scenarios", file, "--panel", "", "--workers", "0"]) == 0
    assert proofs.read_bytes() == before
    assert main(["scenarios", "certify", "--scenarios", file, "--suite", "smoke==1"]) == 2
    assert "two sources of scenarios" in capsys.readouterr().err


# --- recorded scenes -----------------------------------------------------------------------------


def on_the_strip() -> Recording:
    """The ego behind two cars on the longest road of the map `strip`."""
    roads = load_roads("strip")
    lane = max(roads.lanes.values(), key=lambda each: (each.centerline.length_m, each.id))
    starts_m = {"ego": 5.0, "a": 25.0, "b": 45.0}
    poses = {id: lane.centerline.poses_at([start_m + k for k in range(60)]) for id, start_m in starts_m.items()}
    return recording(*(track(id, each) for id, each in poses.items()), crs=roads.crs)


@pytest.mark.nightly
def test_scenes_of_a_recording_are_driven_to_the_end_in_both_forms(tmp_path: Path) -> None:
    shutil.copytree(find_map("strip").folder, tmp_path / "own" / "backwater" / "1.0")
    files = find_map(tmp_path / "own" / "backwater")
    made = recorded_scenes((on_the_strip(),), files, Moments((0.5,)), tmp_path / "scenes")
    write_scenes(tmp_path / "scenes", made, ())
    shutil.rmtree(tmp_path / "own")
    (tmp_path / "scenes").rename(tmp_path / "moved")
    file = tmp_path / "moved" / "scenarios.yaml"
    kinds = [(len(each.replayed), len(each.vehicles)) for each in read_scenarios(file)]
    assert kinds == [(2, 0), (0, 2)]
    one = driven(file, tmp_path / "one", planners=("idm",))
    two = driven(file, tmp_path / "two", workers=2, planners=("idm",))
    assert hashes(one) == hashes(two)
    assert [row.fault for row in one.rows.values()] == [None, None]
    assert min(row.beside["interplan-paper"] for row in one.rows.values()) > 0.5
    again, problems = rescore(one, "nuplan")
    assert (problems, len(again.rows)) == ([], 2)
