"""Rescore: scores of stored traces, under any profile, without simulating."""

from __future__ import annotations

from collections.abc import Callable

from msgspec import structs

from interplan_sumo.batch.records import JobKey, Row, ScoreRecord
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.batch.stored_drive import StoredDrives
from interplan_sumo.errors import InputError
from interplan_sumo.metrics.profile import find_profile


def rescore(
    run: StoredRun, profile: str, watch: Callable[[int, int], None] | None = None
) -> tuple[StoredRun, list[str]]:
    """The run under another profile, and what stood in the way of the rows that it now lacks.

    A planner's fault stays a zero. `watch` is told how many rows are done, of how many.
    """
    used = find_profile(profile)
    drives = StoredDrives(run)
    rows: dict[JobKey, Row] = {}
    problems: list[str] = []
    for number, (key, row) in enumerate(run.rows.items(), start=1):
        try:
            rows[key] = row if row.fault else row.rescored(ScoreRecord.of(drives.read(row).sheet(used)))
        except InputError as error:
            problems.append(str(error))
        if watch is not None:
            watch(number, len(run.rows))
    return StoredRun(run.path, structs.replace(run.manifest, profile=used.name), rows), problems
