"""Results: `results.jsonl`, the one truth about what the drives of a run gave, line by line."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, Self

from interplan_sumo.batch.jobs import JobKey
from interplan_sumo.errors import RunFolderError
from interplan_sumo.world.files import replacing

RESULTS = "results.jsonl"
"""In the run folder."""
LINES_AT_ONCE = 2048
"""Lines that are read together, some 8 MB; a Parquet shard has as many rows."""

Row = dict[str, Any]
"""A line of the file."""


class Brief(NamedTuple):
    """What tables need of a row, small enough to keep for every drive of a long run."""

    family: str
    score: float | None
    """0 to 1."""
    fault: str | None
    """Its class."""
    official: bool
    no_collision: float | None
    """Score of the metric, 0 to 1, as `drivable_area`; None where it was not judged."""
    drivable_area: float | None
    goal_lane: bool | None
    """Whether the drive ended in the goal lane."""
    total_s: float | None
    """Wall clock of the whole job."""
    scoring: int | None
    """Version of the scoring of a row that was scored again."""
    questions: int | None
    """How often the planner asked a language model; None where it says nothing about that."""
    unanswered: int | None
    """How often in vain."""

    @classmethod
    def of(cls, row: Row) -> Self:
        metrics: dict[str, Any] = row["metrics"]
        fault = row["fault"]
        questions, unanswered = _asked(row.get("planner_report"))
        return cls(
            family=row["family"],
            score=row["score"],
            fault=fault["class"] if fault else None,
            official=row.get("official", True),
            no_collision=metrics.get("no_collision", {}).get("score"),
            drivable_area=metrics.get("drivable_area", {}).get("score"),
            goal_lane=metrics.get("lane_changes", {}).get("detail", {}).get("goal"),
            total_s=row.get("times_s", {}).get("total"),
            scoring=row.get("version"),
            questions=questions,
            unanswered=unanswered,
        )


def _asked(report: Any) -> tuple[int | None, int | None]:
    """What a planner reports of its questions to a language model, and of those that had no usable answer."""
    if not isinstance(report, dict) or not isinstance(report.get("queries"), int):
        return None, None
    fallbacks = report.get("fallbacks")
    return report["queries"], sum(fallbacks.values()) if isinstance(fallbacks, dict) else 0


def row_key(row: Row) -> JobKey:
    return (row["scenario_id"], row["planner"], row["seed"])


def line_of(row: Row) -> bytes:
    return (json.dumps(row, ensure_ascii=False, allow_nan=False) + "\n").encode()


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


def read_rows(path: Path) -> Iterator[tuple[Row, bytes]]:
    """All whole rows, one by one, with their lines."""
    first = 1
    for lines in whole_lines(path):
        yield from zip(rows_of(lines, path, first), lines, strict=True)
        first += len(lines)


def rows_of(lines: Sequence[bytes], path: Path, first: int) -> Iterator[Row]:
    """Lines as rows, one by one; RunFolderError names the first that is damaged, counted from `first`."""
    for number, line in enumerate(lines, start=first):
        row = row_of(line)
        if row is None:
            raise RunFolderError(
                f"{path}, line {number} is damaged; delete the line and repeat the command to do that job again"
            )
        yield row


def row_of(line: bytes) -> Row | None:
    """A line as a row; None if it is none, or lacks what everybody reads."""
    with contextlib.suppress(ValueError, TypeError, KeyError, AttributeError):
        row: Row = json.loads(line)
        if {"score", "fault", "family", "metrics"} <= row.keys() and row_key(row):
            return row
    return None


def unreadable(path: Path, error: OSError) -> RunFolderError:
    return RunFolderError(f"cannot read {path}: {error.strerror or error}")


def write_lines(path: Path, lines: Iterable[bytes]) -> None:
    """Write results.jsonl anew, in place of what was there. OSError if that cannot be."""
    with replacing(path) as fresh, fresh.open("wb") as file:
        file.writelines(lines)


def write_rows(path: Path, rows: Iterable[Row]) -> None:
    """Write rows as results.jsonl has them; RunFolderError if the file cannot be written."""
    try:
        write_lines(path, map(line_of, rows))
    except OSError as error:
        raise RunFolderError(f"cannot write {path}: {error.strerror}") from None
