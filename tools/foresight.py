"""What `foresight` loses its points by, and what a small budget costs it, in sentences."""

from __future__ import annotations

from typing import Final

from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.errors import counted
from interplan_sumo.report.compare import compare_runs
from interplan_sumo.report.costly import LEAST_COLUMN, costs
from interplan_sumo.report.table import ResultsTable
from tools.cells import RARE, cell_text

NAME: Final = "foresight"
SMALL_BUDGET: Final = "foresight?budget=fast"
_SAME: Final = 0.01
"""A point."""


def lost(table: ResultsTable) -> list[str]:
    """What cost it a point of the mean and more, the most first."""
    (line,) = (line for line in table.lines if line.planner == NAME)
    told = [
        f"{counted(round(cost.points), 'point')} by *{cost.words}* ({counted(cost.drives, 'drive')})"
        for cost in costs(line)
        if cost.points >= LEAST_COLUMN
    ]
    return [f"Of {line.scenarios} scenes it has {cell_text(line.cells[RARE])} points, and loses {', '.join(told)}."]


def budget(run: StoredRun) -> list[str]:
    """What it loses on a small budget, drive by drive."""
    (pair,) = compare_runs(run, run, NAME, SMALL_BUDGET).pairs
    both = pair.overall
    assert both.difference is not None
    assert both.interval is not None
    assert both.a is not None
    low, high = (-limit for limit in reversed(both.interval))
    same = sum(abs(change.difference) < _SAME for change in pair.changes)
    return [
        f"On `{pair.suite}` it loses {-both.difference:.1f} [{low:.1f}, {high:.1f}] points of {both.a:.0f}: "
        f"{same} of the {both.scenarios} scenes score the same within a point."
    ]
