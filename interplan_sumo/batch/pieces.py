"""Pieces: `results/part-00000.parquet` and so on, a flat copy of `results.jsonl` for data frames.

A piece holds as many rows as `results.LINES_AT_ONCE`, the last one what is left; its number says which.
Each carries the SHA-256 of the lines that it was made from, and of its own columns. One that does not have that of
the lines which are there now, or whose columns are not those that it was made with, is made again. The program itself
reads none.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from interplan_sumo.batch.briefs import Brief
from interplan_sumo.batch.records import Row
from interplan_sumo.batch.results import RESULTS, rows_of, whole_lines
from interplan_sumo.metrics.profile import PROFILES, row_metrics
from interplan_sumo.world.files import replacing

FOLDER = "results"
"""In the run folder, and nothing else is in it: `pandas.read_parquet` reads it as a whole."""
FORMAT = 3
"""Of the columns; a piece of another format is made again."""
MARK: Final = b"interplan_sumo"
"""The key of what a piece says about itself."""
PHASES: Final = ("setup", "simulation", "planner", "loop", "storing", "scoring", "total")


@dataclass(frozen=True, slots=True)
class PieceColumn:
    """A column of a piece."""

    name: str
    type: pa.DataType
    value: Callable[[Row], Any]
    """None where the row has no such thing."""


def _metric(name: str) -> Callable[[Row], Any]:
    return lambda row: row.metrics[name].score if name in row.metrics else None


def _beside(profile: str) -> Callable[[Row], Any]:
    return lambda row: row.beside.get(profile)


def _time_s(phase: str) -> Callable[[Row], Any]:
    return lambda row: row.times_s.get(phase)


TEXT, NUMBER, BOOL = pa.string(), pa.float64(), pa.bool_()
COLUMNS: Final = (
    PieceColumn("scenario_id", TEXT, attrgetter("scenario_id")),
    PieceColumn("family", TEXT, attrgetter("family")),
    PieceColumn("planner", TEXT, attrgetter("planner")),
    PieceColumn("seed", pa.int64(), attrgetter("seed")),
    PieceColumn("score", NUMBER, attrgetter("score")),
    *(PieceColumn(f"metric_{name}", NUMBER, _metric(name)) for name in row_metrics()),
    PieceColumn("done", BOOL, attrgetter("done")),
    PieceColumn("unsafe", BOOL, attrgetter("unsafe")),
    *(PieceColumn(f"score_{name}", NUMBER, _beside(name)) for name in PROFILES),
    PieceColumn("reached_goal", BOOL, attrgetter("reached_goal")),
    PieceColumn("reached_goal_lane", BOOL, lambda row: Brief.of(row).goal_lane),
    PieceColumn("fault_class", TEXT, lambda row: row.fault and row.fault.kind),
    PieceColumn("fault_message", TEXT, lambda row: row.fault and row.fault.message),
    PieceColumn("official", BOOL, attrgetter("official")),
    PieceColumn("override_density", TEXT, attrgetter("overrides.density")),
    PieceColumn("override_behaviour", TEXT, attrgetter("overrides.behaviour")),
    PieceColumn("override_perception", TEXT, attrgetter("overrides.perception")),
    PieceColumn("override_traffic", TEXT, attrgetter("overrides.traffic")),
    PieceColumn("perception", TEXT, attrgetter("perception")),
    PieceColumn("trace", TEXT, attrgetter("trace")),
    PieceColumn("trace_hash", TEXT, attrgetter("trace_hash")),
    PieceColumn("scenario_hash", TEXT, attrgetter("scenario_hash")),
    PieceColumn("site", TEXT, attrgetter("site")),
    *(PieceColumn(f"{phase}_s", NUMBER, _time_s(phase)) for phase in PHASES),
    PieceColumn("versions", TEXT, lambda row: json.dumps(row.versions)),
    PieceColumn("questions", pa.int64(), lambda row: Brief.of(row).questions),
    PieceColumn("unanswered", pa.int64(), lambda row: Brief.of(row).unanswered),
)
SCHEMA: Final = pa.schema([pa.field(column.name, column.type) for column in COLUMNS])


def keep_pieces(run_folder: Path) -> None:
    """Make the pieces that are missing or not of these lines, and take away what is none of them.

    Constant memory; a kill leaves whole pieces only. OSError if they cannot be
    written, RunFolderError for a damaged line.
    """
    folder, results = run_folder / FOLDER, run_folder / RESULTS
    folder.mkdir(exist_ok=True)
    wanted: set[str] = set()
    first = 1
    for number, lines in enumerate(whole_lines(results)):
        path = folder / f"part-{number:05}.parquet"
        wanted.add(path.name)
        about = _about(lines)
        if not _says(path, about):
            with replacing(path) as fresh:
                fresh.write_bytes(_piece(lines, results, first, about))
        first += len(lines)
    for path in folder.iterdir():
        if path.name not in wanted and path.is_file():
            path.unlink()


def _about(lines: Sequence[bytes]) -> dict[str, Any]:
    """What a piece of these lines says about itself."""
    digest = hashlib.sha256()
    for line in lines:
        digest.update(line)
    return {"format": FORMAT, "rows": len(lines), "sha256": digest.hexdigest()}


def _says(path: Path, about: dict[str, Any]) -> bool:
    """Whether a file is a whole piece that says this about itself."""
    try:
        file = pq.ParquetFile(path, page_checksum_verification=True)
        held = file.schema_arrow
        if not held.equals(SCHEMA):
            return False
        return json.loads((held.metadata or {})[MARK]) == about | {"columns": _columns_hash(file.read())}
    except (OSError, pa.ArrowException, KeyError, ValueError, TypeError):
        return False


def _columns_hash(table: pa.Table) -> str:
    """SHA-256 over all values."""
    values = [column.to_pylist() for column in table.columns]
    return hashlib.sha256(json.dumps(values).encode()).hexdigest()


def _piece(lines: Sequence[bytes], results: Path, first: int, about: dict[str, Any]) -> bytes:
    """A Parquet file of these lines."""
    columns: list[list[Any]] = [[] for _ in COLUMNS]
    for row in rows_of(lines, results, first):
        for column, values in zip(COLUMNS, columns, strict=True):
            values.append(column.value(row))
    arrays = [pa.array(values, column.type) for column, values in zip(COLUMNS, columns, strict=True)]
    table = pa.Table.from_arrays(arrays, schema=SCHEMA)
    mark = json.dumps(about | {"columns": _columns_hash(table)}).encode()
    table = table.replace_schema_metadata({MARK: mark})
    file = io.BytesIO()
    pq.write_table(table, file, compression="zstd", write_page_checksum=True)
    return file.getvalue()
