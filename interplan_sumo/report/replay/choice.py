"""Choice: which drives of a run a replay shows."""

from __future__ import annotations

from collections.abc import Sequence

from interplan_sumo.batch.records import Row
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.batch.stored_drive import StoredDrive, StoredDrives
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.report.replay.data import MOST_DRIVES


def chosen_drives(
    run: StoredRun, scenario_id: str, planners: Sequence[str] = (), seed: int = 0
) -> tuple[StoredDrive, ...]:
    """The drives of these planners on a scenario, in this order; without names those of the first `MOST_DRIVES`.

    UnknownNameError for a scenario or planner that the run does not have,
    InputError for a seed that it does not have, or a drive that left no trace.
    """
    rows = _rows(run, scenario_id, seed)
    for name in planners:
        if name not in rows:
            raise UnknownNameError(f"planner in {run.path} that drove {scenario_id} with seed {seed}", name, rows)
    wanted = tuple(dict.fromkeys(planners)) or tuple(rows)[:MOST_DRIVES]
    drives = StoredDrives(run)
    return tuple(drives.read(rows[name]) for name in wanted)


def _rows(run: StoredRun, scenario_id: str, seed: int) -> dict[str, Row]:
    """The rows of a scenario and seed by planner, in the order in which the planners were asked for."""
    driven = [row for row in run.rows.values() if row.scenario_id == scenario_id]
    if not driven:
        raise UnknownNameError(f"scenario in {run.path}", scenario_id, {row.scenario_id for row in run.rows.values()})
    found = {row.planner: row for row in driven if row.seed == seed}
    if not found:
        seeds = ", ".join(str(known) for known in sorted({row.seed for row in driven}))
        raise InputError(f"{run.path} has no drive of {scenario_id} with seed {seed}; it has seed {seeds}")
    asked = [planner for request in run.manifest.requests for planner in request.planners]
    return {planner: found[planner] for planner in dict.fromkeys((*asked, *found)) if planner in found}
