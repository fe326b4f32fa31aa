"""Audit of a run: a finding for each of its scenarios."""

from __future__ import annotations

from collections.abc import Iterator

from interplan_sumo.batch.run_folder import Row, StoredRun
from interplan_sumo.batch.stored_drive import StoredDrives
from interplan_sumo.proving.audit import Finding, finding


def findings(run: StoredRun, below: float | None = None) -> Iterator[tuple[Row, Finding]]:
    """A finding for every row with a trace, in order; only rows that score less than `below` (0 to 100), if given."""
    drives = StoredDrives(run)
    for key in sorted(run.rows):
        row = run.rows[key]
        if row["score"] is None or not row.get("trace") or "no_collision" not in row["metrics"]:
            continue
        if below is not None and 100.0 * row["score"] >= below:
            continue
        drive = drives.read(row)
        detail = row["metrics"]["no_collision"].get("detail", {})
        yield row, finding(drive.scenario, drive.roads, drive.trace, detail)
