"""Reading: a dataset on disk as batches of arrays, one shard in memory at a time.

dataset = read_dataset("data/ordinary")
for batch in dataset.split("train").batches(64, np.random.default_rng(0), fields=("ego_history", "ego_future")):
    ...
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from interplan_sumo.dataset import folder as layout
from interplan_sumo.dataset.columns import RAGGED, Columns, count_of, joined, offsets_name, picked, read_arrays
from interplan_sumo.dataset.records import SPLITS, DatasetManifest, DriveRecord, ShardRecord, read_drive_records
from interplan_sumo.errors import InputError, UnknownNameError, check_names
from interplan_sumo.features import schema
from interplan_sumo.world.files import file_hash


def read_dataset(folder: str | os.PathLike[str]) -> Dataset:
    """Open a dataset; InputError if it is none, is not finished, or of another version."""
    path = Path(folder)
    manifest = layout.read_manifest(path)
    held = manifest.features.format
    if held != schema.FORMAT:
        raise InputError(
            f"{path} holds features of format {held}, this version makes {schema.FORMAT}; export the data again"
        )
    return Dataset(path, manifest)


@dataclass(frozen=True, eq=False)
class Dataset:
    """A dataset, not yet read but for its manifest."""

    folder: Path
    manifest: DatasetManifest

    @property
    def hash(self) -> str:
        """SHA-256 over all its files."""
        return self.manifest.hash

    def __len__(self) -> int:
        return self.manifest.counts.samples

    @cached_property
    def drives(self) -> tuple[DriveRecord, ...]:
        """What is known of each drive: the field `drive` of a sample is a place in here."""
        path = self.folder / layout.DRIVES
        _check_hash(path, self.manifest.drives.sha256)
        return read_drive_records(path)

    def lane_graph(self, map_name: str) -> Columns:
        """The tables of `features.lane_graph.LaneGraph` of a map."""
        maps = self.manifest.maps
        if map_name not in maps:
            raise UnknownNameError(f"map in {self.folder}", map_name, maps)
        path = self.folder / layout.MAPS / f"{map_name}.npz"
        _check_hash(path, maps[map_name].sha256)
        return read_arrays(path)

    def split(self, name: str) -> SplitData:
        """`train`, `val` or `test`; may be empty."""
        if name not in SPLITS:
            raise UnknownNameError("split", name, SPLITS)
        return SplitData(self.folder, tuple(each for each in self.manifest.shards if each.split == name))


@dataclass(frozen=True, eq=False)
class SplitData:
    """The samples of one split, read shard by shard. Each shard's hash is checked when it is first read."""

    folder: Path
    shards: tuple[ShardRecord, ...]
    _checked: set[str] = field(default_factory=set[str], init=False, repr=False)

    def __len__(self) -> int:
        return sum(each.samples for each in self.shards)

    def shard(self, number: int, fields: Sequence[str] | None = None) -> Columns:
        """All samples of one shard; of ragged fields the offsets, too (`columns.ragged` takes them apart)."""
        about = self.shards[number]
        path = self.folder / about.file
        if about.file not in self._checked:
            _check_hash(path, about.sha256)
            self._checked.add(about.file)
        return read_arrays(path, _names(fields))

    def batches(
        self, size: int, rng: np.random.Generator | None = None, fields: Sequence[str] | None = None
    ) -> Iterator[Columns]:
        """Once through the split in batches of `size`, the last one maybe smaller; every field is (B, ...).

        With `rng` the shards come in random order and the samples of each are
        shuffled, else all is in stored order. UnknownNameError for a field
        that there is not.
        """
        if size < 1:
            raise InputError(f"batch size is {size}, expected 1 or more")
        _names(fields)
        return self._batches(size, rng, fields)

    def _batches(self, size: int, rng: np.random.Generator | None, fields: Sequence[str] | None) -> Iterator[Columns]:
        order = np.arange(len(self.shards)) if rng is None else rng.permutation(len(self.shards))
        left: Columns | None = None
        for number in order.tolist():
            shard = self.shard(number, fields)
            if rng is not None:
                shard = picked(shard, rng.permutation(count_of(shard)))
            whole = shard if left is None else joined((left, shard))
            full = count_of(whole) - count_of(whole) % size
            for first in range(0, full, size):
                yield picked(whole, np.arange(first, first + size))
            left = picked(whole, np.arange(full, count_of(whole)))
        if left is not None and count_of(left):
            yield left


def _names(fields: Sequence[str] | None) -> list[str] | None:
    """The arrays that hold some fields."""
    if fields is None:
        return None
    check_names("field", fields, schema.BY_NAME)
    return [array for name in fields for array in ((name, offsets_name(name)) if name in RAGGED else (name,))]


def _check_hash(path: Path, wanted: str) -> None:
    try:
        found = file_hash(path)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}; export the data again") from None
    if found != wanted:
        raise InputError(f"{path} is not the file that was exported: its hash differs; export the data again")
