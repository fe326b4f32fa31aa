"""Export: what lands in a dataset, what is left out, and that equal inputs give equal files."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded import ANY_SCORE, recorded_run, request

from interplan_sumo.batch.run_folder import read_run
from interplan_sumo.batch.stored_drive import StoredDrives
from interplan_sumo.dataset.columns import ragged
from interplan_sumo.dataset.drives import DriveSelection, _check_maps, chosen_drives
from interplan_sumo.dataset.export import export
from interplan_sumo.dataset.observation_replay import ObservationReplay
from interplan_sumo.dataset.reading import read_dataset
from interplan_sumo.dataset.samples import sample_frames
from interplan_sumo.errors import InputError, InterplanError
from interplan_sumo.features import schema
from interplan_sumo.features.view import EgoView
from interplan_sumo.scenario.suite import find_suite


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def exported(driven: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The dataset of the run, which is given twice and counts once; nobody changes it."""
    folder = tmp_path_factory.mktemp("exported") / "a"
    export(request(folder, driven, driven.parent / "." / "mine"))
    return folder


@pytest.mark.nightly
def test_equal_drives_give_equal_files_whatever_the_workers(driven: Path, exported: Path, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    one = export(request(tmp_path / "b", driven, workers=1), lambda _drive, done, drives: told.append((done, drives)))
    assert files_of(tmp_path / "b") == files_of(exported)
    assert one.hash == read_dataset(exported).manifest.hash
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_samples_hold_what_the_planner_saw_and_what_came_of_it(driven: Path, exported: Path) -> None:
    dataset = read_dataset(exported)
    (batch,) = dataset.split("train").batches(10_000)
    stored = StoredDrives(read_run(driven))
    row = next(k for k in range(len(batch["tick"])) if batch["tick"][k] > 0)
    about = dataset.drives[batch["drive"][row]]
    drive = stored.read(stored.run.rows[(about.scenario_id, about.planner, about.seed)])
    again = ObservationReplay(drive.scenario, drive.roads, drive.trace)
    tick = int(batch["tick"][row])
    for name, values in EgoView(again.mission).arrays(again.at(tick)).items():
        assert values.tobytes() == batch[name][row].tobytes(), name
    track = drive.trace.ego
    ahead_m = float(np.hypot(track.x_m[tick + 1] - track.x_m[tick], track.y_m[tick + 1] - track.y_m[tick]))
    assert batch["ego_future"][row, 0, 0] == pytest.approx(ahead_m, abs=0.01)
    nodes = batch["expert_nodes"][row]
    graph = dataset.lane_graph(about.map)
    assert str(graph["node_lane_ids"][nodes[0]]) in drive.roads
    edges = graph["edges"][ragged(batch, "expert_edges")[row]]
    assert (edges[1:, 0] == edges[:-1, 1]).all()  # a chain


def test_drives_carry_what_splits_and_audits_need_and_shards_are_full_but_for_the_last(exported: Path) -> None:
    dataset = read_dataset(exported)
    manifest = dataset.manifest
    found = [(d.scenario_id, d.family, d.map, d.planner, d.seed, d.origin) for d in dataset.drives]
    assert found == [
        ("lane_change_mtd/1", "lane_change_mtd", "bathurst", "idm", 0, "run"),
        ("lane_change_mtd/1", "lane_change_mtd", "bathurst", "idm", 1, "run"),
        ("nudge/0", "nudge", "roosevelt", "idm", 0, "run"),
        ("nudge/0", "nudge", "roosevelt", "idm", 1, "run"),
    ]
    first = dataset.drives[0]
    assert first.route
    assert first.goal_lane
    assert first.generator
    assert sum(d.samples for d in dataset.drives) == manifest.counts.samples == len(dataset)
    assert manifest.sources[0].name == "mine"
    assert set(manifest.maps) == {d.map for d in dataset.drives}
    *full, last = (each.samples for each in manifest.shards)
    assert set(full) == {4}
    assert 1 <= last <= 4


@pytest.mark.slow
def test_maps_and_seeds_are_held_out_whole(driven: Path, tmp_path: Path) -> None:
    choice = replace(ANY_SCORE, holdout_maps=("roosevelt",), holdout_seeds=(1,))
    manifest = export(request(tmp_path / "a", driven, choice=choice))
    dataset = read_dataset(tmp_path / "a")
    for split, expected in (
        ("train", {("lane_change_mtd", 0)}),
        ("val", {("lane_change_mtd", 1)}),
        ("test", {("nudge", 0), ("nudge", 1)}),
    ):
        rows = [int(n) for batch in dataset.split(split).batches(5, fields=("drive",)) for n in batch["drive"]]
        assert {(dataset.drives[n].family, dataset.drives[n].seed) for n in rows} == expected
        assert {dataset.drives[n].split for n in rows} == {split}
        assert len(rows) == len(dataset.split(split)) == manifest.counts.by_split[split]


@pytest.mark.slow
def test_low_scores_and_excluded_families_stay_out_and_are_counted(driven: Path, tmp_path: Path) -> None:
    scores = sorted({drive.score or 0.0 for drive in chosen_drives([driven], (), ANY_SCORE).drives})
    exactly = export(request(tmp_path / "a", driven, choice=DriveSelection(min_score=scores[-1])))
    just_above = scores[0] + 1e-9
    assert exactly.counts.drives >= 1
    above = export(request(tmp_path / "c", driven, choice=DriveSelection(min_score=just_above)))
    assert above.counts.drives < 4
    assert above.left_out == {f"score below {just_above:g}": 4 - above.counts.drives}
    excluded = export(request(tmp_path / "b", driven, choice=replace(ANY_SCORE, exclude=("nudge",))))
    assert excluded.left_out == {"family excluded": 2}
    assert set(excluded.counts.by_family) == {"lane_change_mtd"}


@pytest.mark.slow
def test_certificates_are_replayed_with_their_traffic(tmp_path: Path) -> None:
    families = {scenario.family for scenario in find_suite("smoke==1").scenarios}
    choice = DriveSelection(exclude=tuple(sorted(families - {"lane_change_mtd"})))
    manifest = export(request(tmp_path / "a", choice=choice, certificates=("smoke==1",)))
    dataset = read_dataset(tmp_path / "a")
    (drive,) = dataset.drives
    found = (drive.origin, drive.source, drive.planner, drive.seed)
    assert found == ("certificate", "smoke==1", "certificate", 0)
    assert manifest.sources[0].origin == "certificate"
    (batch,) = dataset.split("train").batches(1000, fields=("agents", "agent_futures"))
    assert batch["agents"][:, :, -1, -1].sum() > 10.0
    assert batch["agent_futures"][..., 3].sum() > 500.0


def test_nothing_to_export_is_refused_with_the_way_out(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing to export: give run folders.*--certificates"):
        export(request(tmp_path / "a"))
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"every_s": 0.25}, "every is 0.25 s, expected a positive multiple of 0.1 s"),
        ({"every_s": 0.0}, "every is 0 s"),
        ({"certificates": ("smoke==9",)}, "no suite named"),
        ({"workers": -1}, "workers is -1"),
        ({"shard_samples": 0}, "shard_samples is 0"),
        ({"choice": DriveSelection(min_score=90.0)}, "min-score is 90, expected 0 to 1"),
        ({"choice": DriveSelection(min_score=1.0)}, r"no drive is left to export \(4 score below 1\)"),
        ({"choice": replace(ANY_SCORE, exclude=("nuge",))}, "no family named 'nuge'. Did you mean 'nudge'"),
        ({"choice": replace(ANY_SCORE, holdout_maps=("stripe",))}, "no map among the drives named 'stripe'"),
        ({"choice": replace(ANY_SCORE, holdout_seeds=(7,))}, "no seed among the drives named '7'. Known: 0, 1."),
    ],
)
def test_what_cannot_be_is_named_before_anything_is_written(
    driven: Path, tmp_path: Path, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        export(request(tmp_path / "a", driven, **options))
    assert not (tmp_path / "a").exists()


def test_a_strangers_folder_is_left_alone(driven: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match=r"holds 'thesis.txt' and is no dataset; give an empty or a new folder"):
        export(request(tmp_path, driven))
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]
    with pytest.raises(InputError, match="is a file; give a folder"):
        export(request(tmp_path / "thesis.txt", driven))


@pytest.mark.slow
def test_another_spacing_is_another_dataset_and_an_older_one_is_replaced(
    driven: Path, exported: Path, tmp_path: Path
) -> None:
    other = export(request(tmp_path / "a", driven, shard_samples=1, every_s=5.0))
    assert other.hash != read_dataset(exported).manifest.hash
    export(request(tmp_path / "a", driven))
    assert files_of(tmp_path / "a") == files_of(exported)


@pytest.mark.slow
def test_half_a_dataset_is_known_as_such_and_is_replaced(driven: Path, tmp_path: Path) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(request(tmp_path / "a", driven), stop)
    with pytest.raises(InputError, match="was not finished; repeat the export"):
        read_dataset(tmp_path / "a")
    export(request(tmp_path / "a", driven))
    assert len(read_dataset(tmp_path / "a")) > 0


@pytest.mark.slow
def test_a_trace_that_is_not_the_one_that_was_driven_is_refused(tmp_path: Path) -> None:
    folder = recorded_run(tmp_path / "run", "nudge/0")
    lines = [json.loads(line) for line in (folder / "results.jsonl").read_text().splitlines()]
    lines[0]["trace_hash"] = "0" * 64
    (folder / "results.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    with pytest.raises(InputError, match="the trace is not the one that was driven"):
        export(request(tmp_path / "a", folder))


def test_two_maps_of_one_name_are_refused(driven: Path, tmp_path: Path) -> None:
    one, *_ = chosen_drives([driven], (), ANY_SCORE).drives
    for name in ("map.gpkg", "map.net.xml.gz", "ids.json"):
        (tmp_path / name).write_text("another map")
    other = replace(one, map=replace(one.map, folder=tmp_path))
    _check_maps([one, one])
    with pytest.raises(InputError, match="are two maps of one name; export their drives apart"):
        _check_maps([one, other])


def test_a_fault_of_a_worker_ends_the_export_and_names_the_drive(driven: Path, tmp_path: Path) -> None:
    def sabotage(*_: object) -> None:
        shutil.rmtree(tmp_path / "a" / "parts")

    with pytest.raises(InterplanError, match=r"lane_change_mtd/1, harness fault: FileNotFoundError.*repeat the export"):
        export(request(tmp_path / "a", driven), sabotage)
    with pytest.raises(InputError, match="was not finished"):
        read_dataset(tmp_path / "a")


def test_the_last_sample_has_three_seconds_ahead(driven: Path) -> None:
    stored = StoredDrives(read_run(driven))
    trace = stored.read(next(iter(stored.run.rows.values()))).trace
    frames = sample_frames(trace, 1)
    assert frames[0] == 0
    assert len(trace) - 1 - frames[-1] == 30
    assert schema.FUTURE_FRAMES > 30
