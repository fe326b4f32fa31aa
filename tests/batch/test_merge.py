"""Shards: a run split over machines and merged is the run that one machine makes; anything else is refused."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from msgspec import json

from interplan_sumo.batch.merge import merge
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.records import PlannerRecord, Shard, encode
from interplan_sumo.batch.results import write_rows
from interplan_sumo.batch.run import run
from interplan_sumo.batch.run_folder import RunFolder, StoredRun, read_run, trace_place
from interplan_sumo.batch.verify import RowSample, note_verified, verify
from interplan_sumo.errors import InputError, RunFolderError
from interplan_sumo.report.table import make_table
from interplan_sumo.report.table_formats import as_json, notes
from interplan_sumo.scenario.files import write_scenarios
from tests.batch.busy import PLAIN
from tests.commands import ran
from tests.records import asked, hashes, manifest, row

SCENES = tuple(replace(PLAIN, id=f"mine/{number}", duration_s=1.5) for number in range(3))
RAISES = "tests.batch.rude_planners:Raises"


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`whole`, a run of three scenes and two planners, and its shards `1` and `2`. Not to be changed."""
    place = tmp_path_factory.mktemp("shards")
    write_scenarios(SCENES, place / "mine.yaml")
    options = RunOptions(("straight_ahead", RAISES), place / "whole", scenarios=(str(place / "mine.yaml"),), workers=0)
    run(options)
    for number in "12":
        run(replace(options, out=place / number, shard=f"{number}/2"))
    return place


@pytest.fixture
def shards(home: Path, tmp_path: Path) -> Path:
    for number in "12":
        shutil.copytree(home / number, tmp_path / number)
    return tmp_path


def joined(place: Path) -> StoredRun:
    return merge([place / "2", place / "1"], place / "merged")


@pytest.mark.slow
def test_merged_shards_are_the_run_that_one_machine_makes(home: Path, shards: Path) -> None:
    whole, made = read_run(home / "whole"), joined(shards)
    assert len(read_run(shards / "1").rows) == len(read_run(shards / "2").rows) == 3
    assert hashes(made) == hashes(whole)
    assert list(made.rows) == whole.keys == made.keys
    assert as_json(make_table([made])) == as_json(make_table([whole]))
    files = [sorted(str(path.relative_to(each.path)) for path in each.path.rglob("*")) for each in (whole, made)]
    assert files[0] == files[1]
    found = verify(made, RowSample(None), RunOptions(workers=0))
    assert found.count("equal") == len(made.rows)


def test_reports_take_shards_side_by_side(home: Path) -> None:
    whole, both = (make_table([read_run(home / each) for each in names]) for names in (("whole",), "21"))
    assert as_json(both) == as_json(whole)
    part = make_table([read_run(home / "2")])
    assert any("2 is shard 2 of 2; `merge` joins them all" in note for note in notes(part))
    assert not any("shard" in note for note in notes(both))
    with pytest.raises(RunFolderError, match="are both shard 1/2"):
        make_table([read_run(home / "1"), read_run(home / "1")])


def test_a_merge_that_was_cut_short_goes_on(shards: Path) -> None:
    whole = hashes(joined(shards))
    lines = (shards / "merged" / "results.jsonl").read_bytes().splitlines(keepends=True)
    (shards / "merged" / "results.jsonl").write_bytes(b"".join(lines[:2]) + lines[2][:50])
    shutil.rmtree(shards / "merged" / "traces")
    again = joined(shards)
    assert hashes(again) == whole
    for each in list(again.rows.values())[2:]:
        assert each.trace is None or (again.path / each.trace / "plans.parquet").is_file()


def test_what_shards_verified_stays_verified(shards: Path) -> None:
    note_verified(verify(read_run(shards / "1"), RowSample(None), RunOptions(workers=0)))
    assert sum(line.verified for line in make_table([joined(shards)]).lines) == 3


def test_a_merged_run_goes_on_with_more(home: Path, shards: Path) -> None:
    joined(shards)
    more = RunOptions(("straight_ahead",), shards / "merged", scenarios=(str(home / "mine.yaml"),), workers=0, seeds=2)
    assert len(run(more).rows) == 9


def test_a_shard_folder_holds_one_shard_of_one_request(home: Path, shards: Path) -> None:
    again = RunOptions(("straight_ahead", RAISES), shards / "1", scenarios=(str(home / "mine.yaml"),), workers=0)
    with pytest.raises(RunFolderError, match="holds shard 1/2 of a run of 6 drives, this is shard 2/2 of a run of 6"):
        run(replace(again, shard="2/2"))
    with pytest.raises(RunFolderError, match="this is a run of 6 drives"):
        run(again)
    with pytest.raises(RunFolderError, match="this is shard 1/2 of a run of 12 drives"):
        run(replace(again, shard="1/2", seeds=2))
    assert len(run(replace(again, shard="1/2")).rows) == 3


def test_more_shards_than_drives_is_one_line(home: Path, tmp_path: Path) -> None:
    options = RunOptions(("straight_ahead",), tmp_path, scenarios=(str(home / "mine.yaml"),), workers=0, shard="4/4")
    with pytest.raises(InputError, match="--shard 4/4 has none of the 3 drives"):
        run(options)


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "1/0", "-1/2", "1/2/3", "a/b", "", "٣/٤", "1/" + "9" * 5000])
def test_what_is_no_shard_is_one_line(text: str) -> None:
    with pytest.raises(InputError, match="give I/N"):
        RunOptions(shard=text)


def test_shards_are_equal_parts_and_together_all() -> None:
    drives = list(range(10))
    parts = [Shard(number, 4).of(drives) for number in range(1, 5)]
    assert sorted(drive for part in parts for drive in part) == drives
    assert {len(part) for part in parts} == {2, 3}


# --- what is refused ---


def toy_shard(place: Path, number: int, **changes: Any) -> Path:
    """Shard I/2 of a run of three scenes that nobody drove."""
    told = manifest(asked("idm"), **({"shard": Shard(number, 2), "profile": "nuplan"} | changes))
    with RunFolder(place / str(number), told) as folder:
        for key in told.keys:
            planner = told.planners.get("idm")
            folder.append(
                row(key[0], versions=told.versions, overrides=told.overrides, traffic_version=told.traffic_version,
                    planner_hash=None if planner is None else planner.hash)
            )  # fmt: skip
    return place / str(number)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"suite_hash": "2"}, "it has suite_hash 2, that has 1"),
        ({"versions": {"sumo": "1.20.0", "python": "3.11.7"}}, "it has versions sumo 1.20.0, that has 1.28.0"),
        ({"traffic_version": 1}, "it has traffic_version 1, that has 2"),
        ({"profile": "interplan-paper"}, "it has profile interplan-paper, that has nuplan"),
        ({"requests": (asked("idm", seeds=2),)}, "other drives were asked for"),
        ({"shard": Shard(2, 3)}, "it is one of 3 shards, that one of 2"),
        ({"plan_limit_s": None}, "it has --plan-limit 0, that has 10"),
        ({"planners": {"idm": PlannerRecord("2", {"idm.py": "2"})}}, r"planner 'idm' is another one: idm\.py differs"),
        ({"shard": None}, "is no shard: it was run without --shard"),
    ],
)
def test_a_shard_of_another_run_is_refused(changes: dict[str, Any], words: str, tmp_path: Path) -> None:
    told = {"planners": {"idm": PlannerRecord("1", {"idm.py": "1"})}}
    places = [toy_shard(tmp_path, 1, **told), toy_shard(tmp_path, 2, **told | changes)]
    with pytest.raises(RunFolderError, match=words):
        merge(places, tmp_path / "merged")
    assert not (tmp_path / "merged").exists()


def test_missing_and_doubled_shards_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = toy_shard(tmp_path, 1)
    code, _, err = ran(capsys, "merge", first, "--out", tmp_path / "merged")
    assert (code, "there is no folder of shard 2/2" in err, len(err.splitlines())) == (2, True, 1)
    with pytest.raises(RunFolderError, match="are both shard 1/2; leave one of them out"):
        merge([first, first], tmp_path / "merged")
    with pytest.raises(RunFolderError, match="is not a run folder"):
        merge([first, tmp_path], tmp_path / "merged")


def without_its_last_row(place: Path) -> None:
    rows = list(read_run(place).rows.values())
    write_rows(place / "results.jsonl", rows[:-1])


def with_a_row_of_the_other(place: Path) -> None:
    rows = list(read_run(place).rows.values())
    write_rows(place / "results.jsonl", [*rows, row("a/1")])


def with_other_versions(place: Path) -> None:
    rows = list(read_run(place).rows.values())
    write_rows(place / "results.jsonl", [row(rows[0].scenario_id, versions={"sumo": "1"}), *rows[1:]])


def with_a_trace_elsewhere(place: Path) -> None:
    rows = list(read_run(place).rows.values())
    changed = row(rows[0].scenario_id, versions=rows[0].versions, trace="../../secrets")
    write_rows(place / "results.jsonl", [changed, *rows[1:]])


def without_its_traces(place: Path) -> None:
    rows = list(read_run(place).rows.values())
    changed = row(rows[0].scenario_id, versions=rows[0].versions, trace=trace_place(rows[0].key))
    write_rows(place / "results.jsonl", [changed, *rows[1:]])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (without_its_last_row, r"is not finished: 1 of its 2 drives are missing; repeat the command of shard 1/2"),
        (with_a_row_of_the_other, "holds a row of a/1, idm, seed 0, which is no drive of shard 1/2"),
        (with_other_versions, r"the row of a/0, idm, seed 0 has another versions than its manifest\.json"),
        (with_a_trace_elsewhere, r"the row of a/0, idm, seed 0 has another trace than"),
        (without_its_traces, r"ego\.parquet is missing; bring the shard's whole folder"),
    ],
)
def test_a_shard_that_was_changed_is_named(change: Callable[[Path], None], words: str, tmp_path: Path) -> None:
    places = [toy_shard(tmp_path, 1), toy_shard(tmp_path, 2)]
    change(places[0])
    with pytest.raises(RunFolderError, match=words):
        merge(places, tmp_path / "merged")


def test_a_manifest_with_no_such_shard_is_damaged(tmp_path: Path) -> None:
    place = toy_shard(tmp_path, 1)
    text = json.decode((place / "manifest.json").read_bytes()) | {"shard": {"number": 3, "count": 2}}
    (place / "manifest.json").write_bytes(json.encode(text))
    with pytest.raises(RunFolderError, match=r"manifest\.json is damaged \(shard 3 of 2"):
        read_run(place)
    assert b'"shard":null' in encode(manifest(asked()))


def test_scenarios_that_were_changed_are_refused(shards: Path) -> None:
    file = shards / "1" / "scenarios.yaml"
    file.write_text(file.read_text().replace("duration_s: 1.5", "duration_s: 2.0"))
    with pytest.raises(RunFolderError, match=r"scenarios\.yaml or its maps are not those"):
        joined(shards)


def test_experts_that_were_changed_are_refused(shards: Path) -> None:
    for path in (shards / "1" / "experts").iterdir():
        (shards / "2" / "experts" / path.name).write_bytes(b"other")
    with pytest.raises(RunFolderError, match="is not the expert that another shard was scored against"):
        joined(shards)
