"""Results: `results.jsonl`, the one truth about what the drives of a run gave, line by line."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path

from msgspec import structs

from interplan_sumo.batch.briefs import Brief, brief_of
from interplan_sumo.batch.records import Fault, JobKey, RecordError, Row, encode, row_of
from interplan_sumo.errors import RunFolderError
from interplan_sumo.world.files import replacing, writing

RESULTS = "results.jsonl"
"""In the run folder."""
LINES_AT_ONCE = 2048
"""Lines that are read together, some 8 MB; a Parquet piece has as many rows."""


class StoredRows(Mapping[JobKey, Row]):
    """The latest row of each job, in the order of the file, read when it is asked for.

    What is kept of a row is its place and its brief. RunFolderError for a row
    that is damaged, or is not at its place any more.
    """

    def __init__(self, path: Path, places: Mapping[JobKey, tuple[int, int]], briefs: Mapping[JobKey, Brief]) -> None:
        self._path = path
        self._places = places
        """Byte at which the line begins, and its number."""
        self.briefs = briefs
        """By job."""

    @classmethod
    def read(cls, run_folder: Path) -> StoredRows:
        """Find every row; RunFolderError names a damaged line."""
        path = run_folder / RESULTS
        places: dict[JobKey, tuple[int, int]] = {}
        briefs: dict[JobKey, Brief] = {}
        begin = 0
        for number, (line, key, brief) in enumerate(read_briefs(path), start=1):
            key = (sys.intern(key[0]), sys.intern(key[1]), key[2])
            places[key], briefs[key] = (begin, number), brief
            begin += len(line)
        return cls(path, places, briefs)

    def __getitem__(self, key: JobKey) -> Row:
        begin, number = self._places[key]
        try:
            with self._path.open("rb") as file:
                file.seek(begin)
                line = file.readline()
        except OSError as error:
            raise unreadable(self._path, error) from None
        try:
            row = row_of(line)
        except RecordError as error:
            raise damaged(self._path, number, error) from None
        if row.key != key:
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


def whole_lines(path: Path) -> Iterator[list[bytes]]:
    """The lines of the file, LINES_AT_ONCE at a time; a last one without its end was torn by a kill and is left out.

    Nothing for a file that is not there; RunFolderError for one that cannot be read.
    """
    try:
        with path.open("rb") as file:
            while lines := list(islice(file, LINES_AT_ONCE)):
                if not lines[-1].endswith(b"\n"):
                    lines.pop()
                if lines:
                    yield lines
    except FileNotFoundError:
        return
    except OSError as error:
        raise unreadable(path, error) from None


def read_briefs(path: Path) -> Iterator[tuple[bytes, JobKey, Brief]]:
    """All whole lines, one by one, each with its job and brief; RunFolderError for a damaged one."""
    first = 1
    for lines in whole_lines(path):
        for number, line in enumerate(lines, start=first):
            try:
                yield line, *brief_of(line)
            except RecordError as error:
                raise damaged(path, number, error) from None
        first += len(lines)


def rows_of(lines: Sequence[bytes], path: Path, first: int) -> Iterator[Row]:
    """Lines as rows, one by one; RunFolderError names the first that is damaged, counted from `first`."""
    for number, line in enumerate(lines, start=first):
        try:
            yield row_of(line)
        except RecordError as error:
            raise damaged(path, number, error) from None


def damaged(path: Path, number: int, error: Exception) -> RunFolderError:
    return RunFolderError(
        f"{path}, line {number} is damaged ({error}); delete the line and repeat the command to do that job again"
    )


def unreadable(path: Path, error: OSError) -> RunFolderError:
    return RunFolderError(f"cannot read {path}: {error.strerror or error}")


def line_of(row: Row) -> bytes:
    return encode(row) + b"\n"


def storable(row: Row) -> tuple[Row, bytes]:
    """A row and its line; in place of one that could not be read again, a fault that says why."""
    try:
        line = line_of(row)
        row_of(line)
    except (RecordError, ValueError, TypeError, RecursionError) as error:
        nothing = {"score": None, "metrics": {}, "gates": (), "weights": {}, "beside": {}, "times_s": {}}
        fault = Fault("harness", f"its row cannot be stored: {type(error).__name__}: {error}")
        unsaid = {"done": None, "unsafe": None, "planner_report": None, "traceback": "", "printed": ""}
        row = structs.replace(row, fault=fault, **nothing, **unsaid)
        line = line_of(row)
    return row, line


def write_lines(path: Path, lines: Iterable[bytes]) -> None:
    """Write results.jsonl anew, in place of what was there. OSError if that cannot be."""
    with replacing(path) as fresh, fresh.open("wb") as file:
        file.writelines(lines)


def write_rows(path: Path, rows: Iterable[Row]) -> None:
    """Write rows as results.jsonl has them; RunFolderError if the file cannot be written."""
    with writing(path, kind=RunFolderError):
        write_lines(path, map(line_of, rows))
