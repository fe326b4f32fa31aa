"""Agreement: how near a table comes to the paper's, over the planners that are in both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from statistics import fmean
from typing import Any, Final

import numpy as np

from interplan_sumo.report.published import published_rows
from interplan_sumo.report.table import Line, ResultsTable

COUNTERPARTS: Final[Mapping[str, str]] = {
    "Urban Driver": "urban_driver",
    "GC-PGP": "gc_pgp",
    "GameFormer": "gameformer",
    "PDM-Open": "pdm_open",
    "DTPP": "dtpp",
    "IDM": "idm",
    "IDM+MOBIL": "idm_mobil?published=true",
    "PDM-Closed": "pdm_closed",
}
"""Published planners and ours of the same method. Language models are left out: each is a model of its own."""
CELLS: Final = ("construction", "accident", "jaywalker", "nudge", "overtake", "ltd", "mtd", "htd")
"""The types of scenarios: of these cells the mean difference is taken."""
FEWEST: Final = 3
"""Two planners are in the same order or in the other one, which says nothing."""
_SUITE: Final = "interplan"
_TOTAL: Final = "interplan"


@dataclass(frozen=True, slots=True)
class PaperComparison:
    """Of the `interplan` column's order and of the cells of the eight types, in points of 100."""

    planners: tuple[str, ...]
    rank_correlation: float | None
    """Spearman's, ties at their mean rank; None where one of the two tables has all planners equal."""
    mean_cell_difference: float
    """Absolute, over planners and types."""

    def as_json(self) -> dict[str, Any]:
        rank = None if self.rank_correlation is None else round(self.rank_correlation, 4)
        return {
            "planners": list(self.planners),
            "rank_correlation": rank,
            "mean_cell_difference": round(self.mean_cell_difference, 4),
        }

    def sentence(self) -> str:
        """One line for a reader."""
        rank = "no order (all equal)"
        if self.rank_correlation is not None:
            rank = f"rank correlation {self.rank_correlation:.2f} (Spearman)"
        return (
            f"Against the paper, {len(self.planners)} planners in both: {rank}, cells of the eight types "
            f"{self.mean_cell_difference:.0f} points apart on average."
        )


def agreement(table: ResultsTable) -> PaperComparison | None:
    """How near the table comes to the published one; None with fewer than three planners that are in both.

    A planner counts with the first line that drove the suite `interplan` as it
    is and has a figure for every type.
    """
    lines = {
        line.planner: line
        for line in reversed(table.lines)
        if line.official and all(line.cells[key].value is not None for key in CELLS)
    }
    pairs = [
        (_figures(lines[ours]), row)
        for row in published_rows()
        if (ours := COUNTERPARTS.get(str(row["planner"]))) in lines
    ]
    if table.suite.partition("==")[0] != _SUITE or len(pairs) < FEWEST:
        return None
    return PaperComparison(
        planners=tuple(str(row["planner"]) for _, row in pairs),
        rank_correlation=_rank_correlation([(here[_TOTAL], float(row[_TOTAL] or 0.0)) for here, row in pairs]),
        mean_cell_difference=fmean(abs(here[key] - float(row[key] or 0.0)) for here, row in pairs for key in CELLS),
    )


def _figures(line: Line) -> dict[str, float]:
    return {key: cell.value for key, cell in line.cells.items() if cell.value is not None}


def _rank_correlation(totals: list[tuple[float, float]]) -> float | None:
    from scipy.stats import rankdata  # slow to import, and few reports need it

    here, there = zip(*totals, strict=True)
    if len(set(here)) == 1 or len(set(there)) == 1:
        return None
    return float(np.corrcoef(rankdata(here), rankdata(there))[0, 1])
