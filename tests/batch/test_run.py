"""Runs with real SUMO: the same hashes everywhere, one named fault per misbehaving planner, resumable, re-scorable."""

from __future__ import annotations

import gzip
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from msgspec import structs

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import AppliedOverrides
from interplan_sumo.batch.run import check_inputs, run
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.batch.score_job import rescore
from interplan_sumo.batch.trace_difference import difference
from interplan_sumo.batch.verify import RowSample, verify
from interplan_sumo.errors import (
    InputError,
    MapError,
    PlannerLoadError,
    RunFolderError,
    UnknownNameError,
    VehicleTypeError,
)
from interplan_sumo.maps.store import find_map
from interplan_sumo.planner_source import PlannerSource
from interplan_sumo.scenario.suite import find_suite
from interplan_sumo.world.trace import Trace
from tests.batch.busy import Log
from tests.records import hashes

RUDE = "tests.batch.rude_planners"
SUITE = "smoke==1"
SCENES = 2
"""What is proved here does not depend on how many there are."""
FIRST = find_suite(SUITE).scenarios[0]


def request(folder: Path, *planners: str, workers: int = 0, **changes: Any) -> RunOptions:
    base = RunOptions(planners=planners, suite=SUITE, out=folder, limit=1, workers=workers)
    return replace(base, **changes)


@pytest.fixture(scope="module")
def official(tmp_path_factory: pytest.TempPathFactory) -> StoredRun:
    """One planner on some scenarios of the suite, in this process; not to be changed."""
    return run(request(tmp_path_factory.mktemp("official") / "run", "straight_ahead", limit=SCENES))


def copied(original: StoredRun, place: Path) -> StoredRun:
    shutil.copytree(original.path, place)
    return read_run(place)


def test_a_row_has_the_documented_fields(official: StoredRun) -> None:
    row = official.rows[FIRST.id, "straight_ahead", 0]
    assert row.family == FIRST.family
    assert row.fault is None
    assert row.official is True
    assert row.overrides == AppliedOverrides()
    assert row.score is not None
    assert {"simulation", "planner", "scoring"} <= row.times_s.keys()
    assert {"interplan_sumo", "sumo", "python"} <= row.versions.keys()
    assert set(row.gates) | set(row.weights) <= row.metrics.keys()
    assert len(row.trace_hash or "") == 64


def test_a_trace_opens_in_one_line_of_pandas(official: StoredRun) -> None:
    row = official.rows[FIRST.id, "straight_ahead", 0]
    ego = pd.read_parquet(official.path / str(row.trace) / "ego.parquet")
    assert {"time_us", "x", "y", "heading"} <= set(ego.columns)
    about = json.loads((official.path / str(row.trace) / "scenario.json").read_text())
    assert about["scenario_hash"] == row.scenario_hash == FIRST.hash()
    assert about["trace_hash"] == row.trace_hash


@pytest.mark.parametrize("name", ["Interrupted", "Terminated"])
def test_a_polite_end_while_a_planner_plans_ends_the_run_and_is_no_fault_of_its(name: str, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(request(tmp_path, f"{RUDE}:{name}"))
    assert read_run(tmp_path).rows == {}


def test_the_same_call_again_does_only_what_is_left(official: StoredRun, tmp_path: Path) -> None:
    place = copied(official, tmp_path / "run").path
    lines = (place / "results.jsonl").read_text().splitlines(keepends=True)
    (place / "results.jsonl").write_text("".join(lines[:-1]) + lines[-1][:50])
    log = Log()
    stored = run(request(place, "straight_ahead", limit=SCENES), log)
    assert (log.jobs, len(log.done), len(log.rows)) == (len(lines), len(lines) - 1, 1)
    assert hashes(stored) == hashes(official)


def test_seeds_may_be_added_and_differ_in_traffic_only(official: StoredRun, tmp_path: Path) -> None:
    place = copied(official, tmp_path / "run").path
    log = Log()
    stored = run(request(place, "straight_ahead", seeds=2), log)
    assert len(log.rows) == 1
    one, two = (stored.rows[FIRST.id, "straight_ahead", seed] for seed in (0, 1))
    assert one.trace_hash != two.trace_hash
    assert one.scenario_hash == two.scenario_hash


def test_overridden_traffic_is_marked_and_kept_apart(official: StoredRun, tmp_path: Path) -> None:
    overrides: dict[str, Any] = {"density": "medium", "behaviour": "assertive"}
    with pytest.raises(RunFolderError, match="overrides density none, this one has medium"):
        run(request(copied(official, tmp_path / "run").path, "straight_ahead", **overrides))
    stored = run(request(tmp_path / "other", "straight_ahead", **overrides))
    (row,) = stored.rows.values()
    assert row.official is False
    assert row.overrides == AppliedOverrides("medium", "assertive")
    assert row.scenario_hash != FIRST.hash()
    again, problems = rescore(stored, "interplan-strict")
    assert problems == []
    assert hashes(again) == hashes(stored)


def test_a_vehicle_type_file_of_ones_own_replaces_the_traffic(official: StoredRun, tmp_path: Path) -> None:
    mine = tmp_path / "mine.xml"
    mine.write_text('<routes><vType id="traffic" maxSpeed="15" tau="3"/></routes>')
    stored = run(request(tmp_path / "run", "straight_ahead", traffic=mine))
    (row,) = stored.rows.values()
    assert row.official is False
    assert str(row.overrides.traffic).startswith("mine.xml sha256:")
    assert row.trace_hash != official.rows[FIRST.id, "straight_ahead", 0].trace_hash
    mine.write_text('<routes><vType id="traffic" maxSpeed="16" tau="3"/></routes>')
    with pytest.raises(RunFolderError, match="with overrides traffic"):
        run(request(tmp_path / "run", "straight_ahead", traffic=mine))


@pytest.mark.slow
def test_hostile_planners_get_zeros_and_change_no_other_row(official: StoredRun, tmp_path: Path) -> None:
    hostile = "tests.planner_process.hostile_planners:Hostile?how="
    killed, leaves = f"{hostile}be killed once&mark={tmp_path / 'mark.log'}", f"{hostile}exit in report"
    found = run(request(tmp_path / "run", leaves, killed, workers=2))
    assert all(row.isolated and row.planner_hash for row in found.rows.values())
    fault = found.rows[FIRST.id, leaves, 0].fault
    assert fault is not None
    assert (fault.kind, found.rows[FIRST.id, leaves, 0].score) == ("planner", 0.0)
    assert (tmp_path / "mark.log").exists()
    assert found.rows[FIRST.id, killed, 0].trace_hash == official.rows[FIRST.id, "straight_ahead", 0].trace_hash


def test_only_a_planner_of_the_run_can_be_driven_again(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="planner of this run to redo"):
        run(request(tmp_path / "run", "straight_ahead", redo=("idm",)))
    assert not (tmp_path / "run").exists()


def test_a_planner_that_cannot_be_built_any_more_leaves_its_drives(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = request(tmp_path / "run", "straight_ahead")
    before = hashes(run(asked))

    def broken(*_: object) -> object:
        raise PlannerLoadError("a slip of the pen")

    monkeypatch.setattr("interplan_planners.straight_ahead.StraightAhead.__init__", broken)
    with pytest.raises(PlannerLoadError):
        run(replace(asked, redo=("straight_ahead",)))
    assert hashes(read_run(tmp_path / "run")) == before


@pytest.mark.nightly
def test_a_worse_perception_is_another_drive_whoever_does_it_and_comes_again(tmp_path: Path) -> None:
    asked = request(tmp_path / "here", "idm", perception="noisy+occluded")
    here, there = run(asked), run(replace(asked, out=tmp_path / "there", workers=2))
    (row,) = here.rows.values()
    assert (row.perception, row.official) == ("occluded+noisy", False)
    assert row.overrides == AppliedOverrides(perception="occluded+noisy")
    assert hashes(here) == hashes(there)
    assert [each.isolated for run_ in (here, there) for each in run_.rows.values()] == [False, True]
    assert row.planner_hash == PlannerSource.of("idm").hash
    again, problems = rescore(here, "interplan-strict")
    assert (hashes(again), problems) == (hashes(here), [])
    assert [check.verdict for check in verify(here, RowSample(), RunOptions(workers=0)).checks] == ["equal"]
    assert row.trace is not None
    stored = Trace.read(here.path / row.trace)
    assert stored.seen is not None
    moved = replace(stored, seen=replace(stored.seen, x_m=stored.seen.x_m + 0.5))
    parted = difference(stored, moved)
    assert parted is not None
    assert (parted.frame, parted.largest_m, parted.what[:5]) == (-20, pytest.approx(0.5), "seen ")
    (here.path / row.trace / "seen.parquet").unlink()
    assert rescore(here, "interplan-strict")[1][0].endswith("delete its line in results.jsonl and repeat the run")


@pytest.mark.slow
@pytest.mark.parametrize("workers", [0, 1])
def test_scoring_again_gives_the_same_scores_without_simulating_whoever_does_it(
    workers: int, official: StoredRun
) -> None:
    again, problems = rescore(official, "interplan-strict", workers=workers)
    assert problems == []
    assert hashes(again) == hashes(official)
    assert [*again.rows] == [*official.rows]


def test_another_profile_has_its_own_terms(official: StoredRun) -> None:
    again, problems = rescore(official, "nuplan")
    assert problems == []
    assert again.manifest.profile == "nuplan"
    assert all("lane_changes" not in row.weights for row in again.rows.values())
    with pytest.raises(UnknownNameError, match="Did you mean 'nuplan'"):
        rescore(official, "nuplam")


@pytest.mark.slow
def test_a_run_is_scored_by_the_profile_that_it_is_given_and_goes_on_with_no_other(tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text("needs_scenario: true\nhonours_exemptions: true\nweights:\n- {metric: progress, weight: 1}\n")
    stored = run(request(tmp_path / "run", "straight_ahead", profile=str(mine)))
    (row,) = stored.rows.values()
    assert (row.gates, row.weights, row.score) == ((), {"progress": 1.0}, row.metrics["progress"].score)
    assert stored.manifest.profile.startswith("mine@")
    with pytest.raises(RunFolderError, match=r"with profile mine@.*, this one has interplan-strict"):
        run(request(tmp_path / "run", "straight_ahead"))
    mine.write_text(mine.read_text().replace("progress", "comfort"))
    with pytest.raises(RunFolderError, match=r"with profile mine@.*, this one has mine@"):
        run(request(tmp_path / "run", "straight_ahead", profile=str(mine)))
    assert verify(stored, RowSample(None), RunOptions(workers=0)).count("equal") == 1


def test_a_planners_fault_is_a_zero_under_any_profile(tmp_path: Path) -> None:
    stored = run(request(tmp_path, f"{RUDE}:Raises"))
    (row,) = stored.rows.values()
    assert row.fault is not None
    assert (row.fault.kind, row.score, stored.missing) == ("planner", 0.0, [])
    again, problems = rescore(stored, "nuplan")
    assert problems == []
    assert [row.score for row in again.rows.values()] == [0.0]


@pytest.mark.slow
def test_a_planner_that_is_edited_while_it_drives_ends_the_run_and_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "edited_planner.py").write_text(
        "from interplan_planners.straight_ahead import StraightAhead\n\n\n"
        "class Edits(StraightAhead):\n"
        "    def plan(self, observation):\n"
        "        open(__file__, 'a').write('# and on\\n')\n"
        "        raise ValueError('I was wrong')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    asked = request(tmp_path / "run", "edited_planner:Edits", workers=1, limit=3)
    with pytest.raises(InputError, match=r"is not the one that this run began with: edited_planner.py differs"):
        run(asked)
    stored = read_run(tmp_path / "run")
    assert [row.fault and row.fault.message.partition(" (")[0] for row in stored.rows.values()] == [
        "plan() raised ValueError: I was wrong"
    ]


@pytest.mark.slow
def test_what_a_planner_printed_before_it_failed_is_kept(tmp_path: Path) -> None:
    (row,) = run(request(tmp_path, f"{RUDE}:Raises", workers=1)).rows.values()
    assert row.fault is not None
    assert "I cannot see" in row.fault.message
    assert row.printed.endswith("at 0.9 s\nat 1.0 s\n")


@pytest.mark.parametrize("damage", ["missing", "truncated", "of another drive", "foreign", "older"])
def test_a_damaged_trace_is_named_and_the_rest_is_scored(damage: str, official: StoredRun, tmp_path: Path) -> None:
    stored = copied(official, tmp_path / "run")
    first, *others = stored.rows.values()
    place = stored.path / str(first.trace)
    if damage == "missing":
        (place / "ego.parquet").unlink()
    elif damage == "truncated":
        content = (place / "actors.parquet").read_bytes()
        (place / "actors.parquet").write_bytes(content[: len(content) // 2])
    elif damage == "foreign":
        pd.DataFrame({"frame": [0], "what": ["no trace"]}).to_parquet(place / "plans.parquet")
    elif damage == "older":
        pd.read_parquet(place / "ego.parquet").drop(columns=["center_x"]).to_parquet(place / "ego.parquet")
    else:
        shutil.rmtree(place)
        shutil.copytree(stored.path / str(others[0].trace), place)
    again, problems = rescore(stored, "interplan-strict")
    assert len(problems) == 1
    assert str(place) in problems[0]
    assert len(again.rows) == len(stored.rows) - 1
    assert len(again.missing) == 1


def test_a_scenario_that_has_changed_since_is_not_scored(official: StoredRun) -> None:
    key, row = next(iter(official.rows.items()))
    changed = replace(official, rows={key: structs.replace(row, scenario_hash="0" * 64)})
    _, problems = rescore(changed, "interplan-strict")
    assert "has changed since it was driven" in problems[0]


def test_a_truncated_network_is_one_error_before_anything_is_driven(tmp_path: Path) -> None:
    folder = tmp_path / FIRST.map / "1.0"
    shutil.copytree(find_map(FIRST.map).folder, folder)
    check_inputs([replace(FIRST, map=str(folder))], None)
    network = gzip.decompress((folder / "map.net.xml.gz").read_bytes())
    (folder / "map.net.xml.gz").write_bytes(gzip.compress(network[: len(network) // 2]))
    with pytest.raises(MapError, match=r"map\.net\.xml\.gz: the file is damaged"):
        check_inputs([replace(FIRST, map=str(folder))], None)
    (folder / "map.net.xml.gz").unlink()
    with pytest.raises(MapError, match="no SUMO network"):
        check_inputs([replace(FIRST, map=str(folder))], None)


def test_bad_input_ends_the_run_before_a_folder_is_made(tmp_path: Path) -> None:
    place = tmp_path / "run"
    wrong = tmp_path / "types.xml"
    wrong.write_text('<routes><vType id="other"/></routes>')
    cases: list[tuple[dict[str, Any], type[InputError], str]] = [
        ({"planners": ("idn",)}, UnknownNameError, "Did you mean 'idm'"),
        ({"suite": "smoke==9"}, UnknownNameError, "Did you mean 'smoke==1'"),
        ({"scenarios": ("nothing/*",)}, UnknownNameError, "no scenario named 'nothing/*'"),
        ({"profile": "nuplam"}, UnknownNameError, "Did you mean 'nuplan'"),
        ({"traffic": wrong}, VehicleTypeError, "traffic"),
        ({"behaviour": "rude"}, UnknownNameError, "no behaviour named 'rude'"),
        ({"out": None}, InputError, "no run folder given"),
    ]
    for given, error, words in cases:
        with pytest.raises(error) as caught:
            run(replace(request(place, "idm"), **given))
        assert words in str(caught.value)
    assert not place.exists()


@pytest.mark.parametrize("workers", [0, 1])
def test_a_planner_that_cannot_be_built_ends_the_run(workers: int, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="could not be built: RuntimeError: no weights"):
        run(request(tmp_path / "run", f"{RUDE}:CannotBeBuilt", workers=workers))
    assert not (tmp_path / "run").exists()


def test_a_planner_that_cannot_be_built_is_not_asked_of_a_folder_that_was_there(tmp_path: Path) -> None:
    before = run(request(tmp_path, "straight_ahead")).manifest
    with pytest.raises(InputError, match="could not be built"):
        run(request(tmp_path, "straight_ahead", f"{RUDE}:CannotBeBuilt"))
    assert read_run(tmp_path).manifest == before
    assert len(read_run(tmp_path).rows) == len(before.keys)
