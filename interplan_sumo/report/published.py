"""Published: the rows of the interPlan paper, for comparison."""

from __future__ import annotations

from collections.abc import Mapping

SOURCE = "Hallgarten et al., IROS 2024 (arXiv 2404.07569), on nuPlan's traffic and scenes"

_COLUMNS = (
    "ordinary", "interplan", "construction", "accident", "jaywalker", "nudge", "overtake", "ltd", "mtd", "htd", "driv",
    "goal", "no_col",
)  # fmt: skip

# In percent, in the order of _COLUMNS; ordinary driving is Val14, reactive, which the language models did not drive.
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


def published_rows() -> list[dict[str, str | float | None]]:
    """The paper's table, scores 0 to 100, keyed as `report --json`; None where the paper has no figure."""
    return [{"planner": name, **dict(zip(_COLUMNS, row, strict=True))} for name, row in _ROWS.items()]


def published_figure(row: Mapping[str, object], key: str) -> str:
    """One figure of a published row as text."""
    value = row[key]
    return "-" if value is None else f"{value:.0f}"
