"""Paper comparison: the rows of the interPlan paper, and how near a table comes to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from statistics import fmean
from typing import Any, Final

import numpy as np

from interplan_sumo.report.table import Line, ResultsTable

SOURCE = "Hallgarten et al., IROS 2024 (arXiv 2404.07569), on nuPlan's traffic and scenes"

PUBLISHED_COLUMNS: Final = (
    "ordinary", "interplan", "construction", "accident", "jaywalker", "nudge", "overtake", "ltd", "mtd", "htd", "driv",
    "goal", "no_col",
)  # fmt: skip

# In percent, in the order of PUBLISHED_COLUMNS; ordinary driving is Val14, reactive, without the language models.
_ROWS: dict[str, tuple[float | None, ...]] = {
    "Urban Driver": (50, 4, 0, 0, 0, 0, 0, 0, 29, 0, 30, 30, 47),
    "GC-PGP": (55, 10, 0, 0, 0, 0, 0, 18, 16, 44, 73, 17, 67),
    "GameFormer": (75, 11, 0, 0, 48, 0, 0, 0, 20, 21, 30, 30, 87),
    "PDM-Open": (54, 25, 13, 0, 56, 36, 8, 29, 29, 26, 60, 40, 43),
    "DTPP": (73, 25, 18, 18, 44, 10, 0, 40, 36, 34, 60, 33, 93),
    "IDM": (77, 31, 0, 0, 66, 0, 0, 61, 61, 61, 100, 0, 100),
    "IDM+MOBIL": (75, 31, 21, 0, 66, 0, 0, 71, 21, 70, 93, 52, 80),
    "PDM-Closed": (92, 42, 18, 0, 48, 74, 9, 62, 62, 62, 100, 0, 100),
    "HybridLLM Llama-7B": (None, 53, 27, 20, 48, 93, 28, 81, 48, 80, 100, 43, 87),
    "HybridLLM Llama-13B": (None, 48, 36, 10, 48, 82, 19, 71, 40, 77, 97, 43, 83),
    "HybridLLM GPT-3.5": (None, 40, 52, 0, 48, 25, 9, 76, 34, 69, 97, 47, 77),
    "LLMWaypoints Llama-7B": (None, 16, 0, 0, 0, 0, 0, 29, 64, 37, 90, 0, 67),
    "LLMWaypoints Llama-13B": (None, 17, 0, 0, 0, 0, 0, 31, 64, 38, 87, 0, 70),
    "LLMWaypoints GPT-3.5": (None, 22, 0, 0, 0, 0, 0, 64, 41, 69, 93, 0, 100),
}

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
CELLS: Final = PUBLISHED_COLUMNS[2:10]
"""The types of scenarios: of these cells the mean difference is taken."""
FEWEST: Final = 3
"""Two planners are in the same order or in the other one, which says nothing."""
_SUITE: Final = "interplan"
_TOTAL: Final = "interplan"


def published_rows() -> list[dict[str, str | float | None]]:
    """The paper's table, scores 0 to 100, keyed as `report --json`; None where the paper has no figure."""
    return [{"planner": name, **dict(zip(PUBLISHED_COLUMNS, row, strict=True))} for name, row in _ROWS.items()]


def published_figure(row: Mapping[str, object], key: str) -> str:
    """One figure of a published row as text; a dash for what the paper has no column or no figure for."""
    value = row.get(key)
    return "-" if value is None else f"{value:.0f}"


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
