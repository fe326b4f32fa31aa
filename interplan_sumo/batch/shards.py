"""Shards: `results/part-00000.parquet` and so on, a flat copy of `results.jsonl` for data frames.

A shard holds as many rows as `results.LINES_AT_ONCE`, the last one what is left; its number says which.
Each carries the SHA-256 of the lines that it was made from. One that does not have that of the lines which
are there now is of no use to anybody and is made again: nothing is in a shard that is not in the lines.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from interplan_sumo.batch.jobs import JobKey
from interplan_sumo.batch.results import RESULTS, Brief, Row, rows_of, whole_lines
from interplan_sumo.errors import RunFolderError
from interplan_sumo.metrics.profile import row_metrics
from interplan_sumo.world.files import replacing

FOLDER = "results"
"""In the run folder, and nothing else is in it: `pandas.read_parquet` reads it as a whole."""
FORMAT = 1
"""Of the columns; a shard of another format is made again."""
MARK: Final = b"interplan_sumo"
"""The key of what a shard says about itself."""
PHASES: Final = ("setup", "simulation", "planner", "loop", "storing", "scoring", "total")


@dataclass(frozen=True, slots=True)
class ShardColumn:
    """A column of a shard."""

    name: str
    type: pa.DataType
    value: Callable[[Row], Any]
    """None where the row has no such thing."""


def _held(name: str) -> Callable[[Row], Any]:
    return lambda row: row.get(name)


def _metric(name: str) -> Callable[[Row], Any]:
    return lambda row: row["metrics"].get(name, {}).get("score")


def _part(whole: str, name: str) -> Callable[[Row], Any]:
    return lambda row: (row.get(whole) or {}).get(name)


TEXT, NUMBER, BOOL = pa.string(), pa.float64(), pa.bool_()
COLUMNS: Final = (
    ShardColumn("scenario_id", TEXT, _held("scenario_id")),
    ShardColumn("family", TEXT, _held("family")),
    ShardColumn("planner", TEXT, _held("planner")),
    ShardColumn("seed", pa.int64(), _held("seed")),
    ShardColumn("score", NUMBER, _held("score")),
    *(ShardColumn(f"metric_{name}", NUMBER, _metric(name)) for name in row_metrics()),
    ShardColumn("reached_goal", BOOL, _held("reached_goal")),
    ShardColumn("reached_goal_lane", BOOL, lambda row: Brief.of(row).goal_lane),
    ShardColumn("fault_class", TEXT, _part("fault", "class")),
    ShardColumn("fault_message", TEXT, _part("fault", "message")),
    ShardColumn("official", BOOL, lambda row: Brief.of(row).official),
    *(ShardColumn(f"override_{name}", TEXT, _part("overrides", name)) for name in ("density", "behaviour", "traffic")),
    ShardColumn("trace", TEXT, _held("trace")),
    ShardColumn("trace_hash", TEXT, _held("trace_hash")),
    ShardColumn("scenario_hash", TEXT, _held("scenario_hash")),
    ShardColumn("site", TEXT, _held("site")),
    *(ShardColumn(f"{phase}_s", NUMBER, _part("times_s", phase)) for phase in PHASES),
    ShardColumn("versions", TEXT, lambda row: json.dumps(row.get("versions", {}))),
    ShardColumn("scoring_version", pa.int64(), _held("version")),
    ShardColumn("questions", pa.int64(), lambda row: Brief.of(row).questions),
    ShardColumn("unanswered", pa.int64(), lambda row: Brief.of(row).unanswered),
)
SCHEMA: Final = pa.schema([pa.field(column.name, column.type) for column in COLUMNS])
KEY: Final = ("scenario_id", "planner", "seed")
BRIEF: Final = (
    "family",
    "score",
    "fault_class",
    "official",
    "metric_no_collision",
    "metric_drivable_area",
    "reached_goal_lane",
    "total_s",
    "scoring_version",
    "questions",
    "unanswered",
)
"""The columns that make a Brief, in its order."""


def keep_shards(run_folder: Path) -> None:
    """Make the shards that are missing or not of these lines, and take away what is none of them.

    Constant memory; a kill leaves whole shards only. OSError if they cannot be
    written, RunFolderError for a damaged line.
    """
    folder, results = run_folder / FOLDER, run_folder / RESULTS
    folder.mkdir(exist_ok=True)
    wanted: set[str] = set()
    first = 1
    for number, lines in enumerate(whole_lines(results)):
        path = _path(run_folder, number)
        wanted.add(path.name)
        about = _about(lines)
        if _read(path, about) is None:
            with replacing(path) as fresh:
                fresh.write_bytes(_shard(lines, results, first, about))
        first += len(lines)
    for path in folder.iterdir():
        if path.name not in wanted and path.is_file():
            path.unlink()


def read_briefs(run_folder: Path, number: int, lines: Sequence[bytes]) -> Iterator[tuple[JobKey, Brief]] | None:
    """Job and brief of each of these lines by their shard; None if there is none that was made from them."""
    table = _read(_path(run_folder, number), _about(lines), [*KEY, *BRIEF])
    if table is None:
        return None
    names, planners, seeds, *briefs = (column.to_pylist() for column in table.columns)
    return zip(zip(names, planners, seeds, strict=True), map(Brief._make, zip(*briefs, strict=True)), strict=True)


def _path(run_folder: Path, number: int) -> Path:
    return run_folder / FOLDER / f"part-{number:05}.parquet"


def _about(lines: Sequence[bytes]) -> dict[str, Any]:
    """What a shard of these lines says about itself."""
    digest = hashlib.sha256()
    for line in lines:
        digest.update(line)
    return {"format": FORMAT, "rows": len(lines), "sha256": digest.hexdigest()}


def _read(path: Path, about: dict[str, Any], columns: list[str] | None = None) -> pa.Table | None:
    """A shard, or some of its columns; None if the file is damaged, or none that says this about itself."""
    try:
        file = pq.ParquetFile(path, page_checksum_verification=True)
        held = file.schema_arrow
        if not held.equals(SCHEMA) or json.loads((held.metadata or {})[MARK]) != about:
            return None
        return file.read(columns, use_threads=False)
    except (OSError, pa.ArrowException, KeyError, ValueError):
        return None


def _array(column: ShardColumn, values: list[Any], results: Path, first: int) -> pa.Array:
    try:
        return pa.array(values, column.type)
    except (pa.ArrowException, TypeError, ValueError) as error:
        raise RunFolderError(
            f"{results}, lines {first} to {first + len(values) - 1}: {column.name} is no {column.type} everywhere "
            f"({error}); delete the line and repeat the command to do that job again"
        ) from None


def _shard(lines: Sequence[bytes], results: Path, first: int, about: dict[str, Any]) -> bytes:
    """A Parquet file of these lines."""
    columns: list[list[Any]] = [[] for _ in COLUMNS]
    for row in rows_of(lines, results, first):
        for column, values in zip(COLUMNS, columns, strict=True):
            values.append(column.value(row))
    arrays = [_array(column, values, results, first) for column, values in zip(COLUMNS, columns, strict=True)]
    table = pa.Table.from_arrays(arrays, schema=SCHEMA.with_metadata({MARK: json.dumps(about).encode()}))
    file = io.BytesIO()
    pq.write_table(table, file, compression="zstd", write_page_checksum=True)
    return file.getvalue()
