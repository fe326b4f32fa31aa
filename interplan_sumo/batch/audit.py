"""Audit of a run: a finding for each of its scenarios."""

from __future__ import annotations

from collections.abc import Iterator

from interplan_sumo.batch.records import Row
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.batch.stored_drive import StoredDrives
from interplan_sumo.verification.audit import AuditFinding, finding


def findings(run: StoredRun, below: float | None = None) -> Iterator[tuple[Row, AuditFinding]]:
    """A finding for every row with a trace, in order; only rows that score less than `below` (0 to 100), if given."""
    drives = StoredDrives(run)
    briefs = run.briefs
    for key in sorted(run.rows):
        score = briefs[key].score
        if score is None or (below is not None and 100.0 * score >= below):
            continue
        row = run.rows[key]
        if row.trace is None or "no_collision" not in row.metrics:
            continue
        drive = drives.read(row)
        yield row, finding(drive.scenario, drive.roads, drive.trace, row.metrics["no_collision"].detail)
