"""What choosing is worth, by who chooses in `llm_hybrid`: language models, and what stands in for one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.planner import split_spec
from interplan_sumo.report.table import make_table
from tools.cells import FAMILIES, RARE, best_first, cell_text, family_titles, with_interval

HYBRID: Final = "llm_hybrid"
NOBODY: Final = "pdm_closed"
CHOOSERS: Final[Mapping[str, str]] = {
    "random": "a coin, `model=random`", "rules": "a few rules, `model=rules`",
    "embedded+tuned:hybrid": "the small model tuned for it, `model=embedded+tuned:hybrid`, not zero-shot",
    "embedded": "the same model untuned, `model=embedded`, zero-shot",
}  # fmt: skip
"""Who chooses, by the option `model`."""


def choosers(run: StoredRun) -> list[str]:
    """Scores by who chooses what PDM drives, and how often a model was asked."""
    table = make_table([run])
    titles = ("who chooses", "interPlan", "done %", "unsafe %", *family_titles(table), "asked", "in vain")
    lines = [" | ".join(titles), "---|" * (len(titles) - 1) + "---"]
    for line in best_first(table):
        name, options = split_spec(line.planner)
        if name == HYBRID:
            given = dict(option.split("=", 1) for option in options.split("&"))
            who = CHOOSERS[given["model"]] + (", told its last decisions, `memory=true`" if "memory" in given else "")
        elif line.planner == NOBODY:
            who = f"nobody: `{NOBODY}`"
        else:
            continue
        counts = (str(line.questions), str(line.unanswered)) if name == HYBRID else ("-", "-")
        cells = (cell_text(line.cells[key]) for key in ("done_share", "unsafe_share", *FAMILIES))
        lines.append(" | ".join((who, with_interval(line.cells[RARE]), *cells, *counts)))
    return lines
