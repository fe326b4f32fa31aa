"""Reading: a dataset as batches, and what is no dataset."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from recorded import request

from interplan_sumo.dataset.columns import Columns, ragged
from interplan_sumo.dataset.export import export
from interplan_sumo.dataset.reading import Dataset, read_dataset
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.features import schema


@pytest.fixture(scope="module")
def folder(driven: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dataset")
    export(request(folder, driven, every_s=1.0, shard_samples=25))
    return folder


@pytest.fixture
def dataset(folder: Path) -> Dataset:
    return read_dataset(folder)


def keys(batches: list[Columns]) -> list[tuple[int, int]]:
    return [(int(d), int(t)) for each in batches for d, t in zip(each["drive"], each["tick"], strict=True)]


def test_in_order_every_sample_comes_once_and_batches_reach_across_shards(dataset: Dataset) -> None:
    train = dataset.split("train")
    assert len(train.shards) > 2
    batches = list(train.batches(32, fields=("drive", "tick")))
    assert [len(each["tick"]) for each in batches[:-1]] == [32] * (len(batches) - 1)
    found = keys(batches)
    assert found == sorted(set(found))
    assert len(found) == len(train) == len(dataset)
    assert list(dataset.split("test").batches(4)) == []


def test_shuffled_every_sample_comes_once_in_an_order_that_the_generator_settles(dataset: Dataset) -> None:
    train = dataset.split("train")
    plain, one, same, other = (
        keys(list(train.batches(32, rng, fields=("drive", "tick"))))
        for rng in (None, *(np.random.default_rng(seed) for seed in (1, 1, 2)))
    )
    assert one == same
    assert one != other
    assert sorted(one) == plain


def test_a_batch_holds_the_fields_that_were_asked_for_in_their_shapes(dataset: Dataset) -> None:
    batch = next(iter(dataset.split("train").batches(7, np.random.default_rng(0), ("agents", "expert_edges"))))
    assert list(batch) == ["agents", "expert_edges", "expert_edges_offsets"]
    assert batch["agents"].shape == (7, 30, 21, 13)
    assert len(ragged(batch, "expert_edges")) == 7
    everything = next(iter(dataset.split("train").batches(2)))
    assert {field.name for field in schema.FIELDS} <= set(everything)


def test_names_that_do_not_exist_are_told(dataset: Dataset) -> None:
    with pytest.raises(UnknownNameError, match=r"no split named 'tain'. Did you mean 'train'"):
        dataset.split("tain")
    with pytest.raises(UnknownNameError, match=r"no field named 'ego_futur'. Did you mean 'ego_future'"):
        dataset.split("train").batches(4, fields=("ego_futur",))
    with pytest.raises(InputError, match="batch size is 0"):
        dataset.split("train").batches(0)
    with pytest.raises(UnknownNameError, match=r"no map in .* named 'atlantis'"):
        dataset.lane_graph("atlantis")


def test_a_folder_that_is_no_dataset_is_told_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"is no dataset: it has no manifest.json"):
        read_dataset(tmp_path)
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(InputError, match=r"cannot read .*manifest\.json"):
        read_dataset(tmp_path)
    (tmp_path / "manifest.json").write_text(json.dumps({"kind": "cat pictures", "format": 1}))
    with pytest.raises(InputError, match="tells of 'cat pictures'"):
        read_dataset(tmp_path)


@pytest.mark.parametrize("where", ["format", "features"])
def test_another_version_is_refused(folder: Path, tmp_path: Path, where: str) -> None:
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    (manifest if where == "format" else manifest["features"])["format"] = 99
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(InputError, match=r"format 99, this version .* 1; export the data again"):
        read_dataset(tmp_path)


def test_a_file_that_was_changed_is_found_out(folder: Path, tmp_path: Path) -> None:
    dataset = read_dataset(shutil.copytree(folder, tmp_path, dirs_exist_ok=True))
    for path in (*tmp_path.glob("shards/*"), *tmp_path.glob("maps/*"), tmp_path / "drives.jsonl"):
        path.write_bytes(path.read_bytes() + b" ")
    with pytest.raises(InputError, match=r"train-00000\.npz is not the file that was exported"):
        next(dataset.split("train").batches(4))
    with pytest.raises(InputError, match="its hash differs"):
        dataset.lane_graph(next(iter(dataset.manifest.maps)))
    with pytest.raises(InputError, match=r"drives\.jsonl"):
        _ = dataset.drives
    (tmp_path / "shards" / "train-00001.npz").unlink()
    with pytest.raises(InputError, match="cannot read"):
        dataset.split("train").shard(1)
