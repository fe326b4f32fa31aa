"""Verified: which rows of a run folder were driven again and came out as they stand there, for whoever reports it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final, Literal

from msgspec import Struct

from interplan_sumo.batch.records import JobKey, RecordError, Row, decode, encode
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.errors import RunFolderError
from interplan_sumo.world.files import replacing

VERIFIED: Final = "verified.json"
"""In the run folder."""

Means = Literal["plans", "planner"]
"""What was driven again: the plans that are stored, or the planner itself."""


class VerifiedRow(Struct, frozen=True):
    """A row that came again; it holds for the row as it was then."""

    scenario_id: str
    planner: str
    seed: int
    trace_hash: str | None
    score: float | None
    means: Means
    judged: dict[str, float | None] = {}
    """Scores of all metrics."""

    @classmethod
    def of(cls, row: Row, means: Means) -> VerifiedRow:
        judged = {name: metric.score for name, metric in row.metrics.items()}
        return cls(row.scenario_id, row.planner, row.seed, row.trace_hash, row.score, means, judged)

    @property
    def key(self) -> JobKey:
        return (self.scenario_id, self.planner, self.seed)


class _Verified(Struct, frozen=True):
    rows: tuple[VerifiedRow, ...]


def verified_rows(run: StoredRun) -> Mapping[JobKey, VerifiedRow]:
    """Rows that came again and have not changed since; RunFolderError if the file is damaged."""
    held = _read(run.path)
    rows = run.rows
    return {key: each for key, each in held.items() if key in rows and VerifiedRow.of(rows[key], each.means) == each}


def keep_verified(run_folder: Path, equal: Iterable[VerifiedRow], differing: Iterable[JobKey]) -> None:
    """Add rows that came again to the file, and take those out that did not; RunFolderError if it cannot be written."""
    held = _read(run_folder) | {each.key: each for each in equal}
    for key in differing:
        held.pop(key, None)
    path = run_folder / VERIFIED
    try:
        with replacing(path) as fresh:
            fresh.write_bytes(encode(_Verified(tuple(held[key] for key in sorted(held)))) + b"\n")
    except OSError as error:
        raise RunFolderError(f"cannot write {path}: {error.strerror or error}") from None


def _read(run_folder: Path) -> dict[JobKey, VerifiedRow]:
    path = run_folder / VERIFIED
    try:
        return {each.key: each for each in decode(path.read_bytes(), _Verified).rows}
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise RunFolderError(f"cannot read {path}: {error.strerror or error}") from None
    except RecordError as error:
        raise RunFolderError(f"{path} is damaged ({error}); delete it and verify again") from None
