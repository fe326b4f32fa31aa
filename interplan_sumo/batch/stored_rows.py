"""Stored rows: the rows of a run folder, read when they are asked for."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from interplan_sumo.batch.jobs import JobKey
from interplan_sumo.batch.results import RESULTS, Brief, Row, row_key, row_of, rows_of, unreadable, whole_lines
from interplan_sumo.batch.shards import read_briefs
from interplan_sumo.errors import RunFolderError


class StoredRows(Mapping[JobKey, Row]):
    """The latest row of each job, in the order of the file. What is kept of a row is its place and its brief.

    RunFolderError for a row that is not at its place any more.
    """

    def __init__(self, path: Path, places: Mapping[JobKey, int], briefs: Mapping[JobKey, Brief]) -> None:
        self._path = path
        self._places = places
        """Byte at which the line begins."""
        self.briefs = briefs
        """By job."""

    @classmethod
    def read(cls, run_folder: Path) -> StoredRows:
        """Find every row; RunFolderError names a damaged line."""
        path = run_folder / RESULTS
        places: dict[JobKey, int] = {}
        briefs: dict[JobKey, Brief] = {}
        begin, first = 0, 1
        for number, lines in enumerate(whole_lines(path)):
            found = read_briefs(run_folder, number, lines)
            if found is None:
                found = ((row_key(row), Brief.of(row)) for row in rows_of(lines, path, first))
            for line, (key, brief) in zip(lines, found, strict=True):
                key = (sys.intern(key[0]), sys.intern(key[1]), key[2])
                places[key], briefs[key] = begin, brief
                begin += len(line)
            first += len(lines)
        return cls(path, places, briefs)

    def __getitem__(self, key: JobKey) -> Row:
        begin = self._places[key]
        try:
            with self._path.open("rb") as file:
                file.seek(begin)
                row = row_of(file.readline())
        except OSError as error:
            raise unreadable(self._path, error) from None
        if row is None or row_key(row) != key:
            raise RunFolderError(f"{self._path} was replaced while it was read; repeat the command")
        return row

    def __iter__(self) -> Iterator[JobKey]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def only(self, keys: Iterable[JobKey]) -> StoredRows:
        """The rows of these jobs, as far as they are there."""
        held = [key for key in keys if key in self._places]
        return StoredRows(self._path, {k: self._places[k] for k in held}, {k: self.briefs[k] for k in held})


def briefs_of(rows: Mapping[JobKey, Row]) -> Mapping[JobKey, Brief]:
    """The brief of every row."""
    if isinstance(rows, StoredRows):
        return rows.briefs
    return {key: Brief.of(row) for key, row in rows.items()}
