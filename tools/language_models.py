"""What language models are worth, and what stands in for one: who chooses in the hybrid, and who writes waypoints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from msgspec import json

from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.planner import split_spec
from interplan_sumo.report.paper_comparison import PUBLISHED_COLUMNS, published_figure, published_rows
from interplan_sumo.report.table import POINTS, Cell, Column, ResultsTable, make_table
from interplan_sumo.statistics.intervals import mean_interval
from interplan_sumo.statistics.scene_values import DriveValue, mean_over_scenes
from interplan_sumo.world.csv_tables import number_in, read_table, write_table
from tools.cells import FAMILIES, RARE, best_first, cell_text, family_titles, heading, with_interval
from tools.hard_scores import RESULTS, ROOT

ASKED: Final = "llm==1"
"""The suite for those who take seconds for an answer."""
HYBRID, WAYPOINTS, NOBODY = "llm_hybrid", "llm_waypoints", "pdm_closed"
MODELS: Final[Mapping[str, str]] = {
    "random": "a coin, `model=random`", "rules": "a few rules, `model=rules`",
    "embedded+tuned:hybrid": "the small model tuned for it, `model=embedded+tuned:hybrid`, not zero-shot",
    "embedded+tuned:waypoints": "`model=embedded+tuned:waypoints`, not zero-shot",
    "embedded": "the same model untuned, `model=embedded`, zero-shot",
}  # fmt: skip
"""Who chooses or writes, by the option `model`."""
PUBLISHED: Final = ("LLMWaypoints Llama-7B", "LLMWaypoints GPT-3.5")
ADAPTERS: Final = ROOT / "planners/interplan_llm/adapters"
ORACLE: Final = RESULTS / "oracle.csv"
"""What the best choices that were found led to, scene by scene."""
FOUND: Final = ("scenario", "family", "score", "done", "unsafe", "drives")
"""Its columns: shares 0 to 1, and how many drives the search took."""


def choosers(run: StoredRun) -> list[str]:
    """Scores by who chooses what PDM drives, how often a model was asked, and what the best choices would give."""
    table = make_table([run])
    titles = ("who chooses", "interPlan", "done %", "unsafe %", *family_titles(table), "asked", "in vain")
    sites = {row.scenario_id: row.site for row in run.rows.values()}
    found: list[tuple[str, Mapping[str, Cell], str, str]] = [(*_oracle(table, sites), "-", "-")]
    for line in best_first(table):
        name, options = split_spec(line.planner)
        if name == HYBRID:
            found.append((_who(options), line.cells, str(line.questions), str(line.unanswered)))
        elif line.planner == NOBODY:
            found.append((f"nobody: `{NOBODY}`", line.cells, "-", "-"))
    lines = heading(*titles)
    for who, cells, *counts in sorted(found, key=lambda row: -(row[1][RARE].value or 0.0)):
        shown = (cell_text(cells[key]) for key in ("done_share", "unsafe_share", *FAMILIES))
        lines.append(" | ".join((who, with_interval(cells[RARE]), *shown, *counts)))
    return lines


def waypoints(run: StoredRun) -> list[str]:
    """Scores of those who write waypoints, and of published ones."""
    table, keys = make_table([run]), PUBLISHED_COLUMNS[1:]
    titles = {column.key: column.title for column in table.columns}
    lines = heading("who writes", *(titles[key] for key in keys), "asked", "unusable %")
    for line in best_first(table):
        name, options = split_spec(line.planner)
        if name == WAYPOINTS:
            unusable = f"{100.0 * line.unanswered / max(line.questions, 1):.1f}"
            cells = (cell_text(line.cells[key]) for key in keys)
            lines.append(" | ".join((_who(options), *cells, str(line.questions), unusable)))
    for row in published_rows():
        if row["planner"] in PUBLISHED:
            figures = (published_figure(row, key) for key in keys)
            lines.append(" | ".join((f"{row['planner']} (paper, 80 scenes)", *figures, "-", "-")))
    return lines


def adapters() -> list[str]:
    """What each adapter of the package learned from, how long that took, and what it does with held-out examples."""
    cards = [json.decode(file.read_bytes()) for file in sorted(ADAPTERS.glob("*.json"))]
    shares = {
        f"right choices of them %, {who}{where}": [_right(card["held_out"][key][what]) for card in cards]
        for what, where in (("agreement", ""), ("agreement_where_decisive", ", where it decides"))
        for key, who in (("before", "untuned"), ("after", "tuned"), ("always_first", "of whoever takes the first"))
    }
    told = {
        "": [f"`{card['name']}`" for card in cards],
        "examples": [str(card["examples"]["learned"]) for card in cards],
        "minutes of one core": [f"{_core_minutes(card):.0f}" for card in cards],
        "examples held out": [str(card["examples"]["held_out"]) for card in cards],
        **{
            f"their loss per token, {who}": [f"{card['held_out'][key]['token_loss']:.2f}" for card in cards]
            for key, who in (("before", "untuned"), ("after", "tuned"))
        },
        **shares,
    }
    title, *lines = (" | ".join((name, *of)) for name, of in told.items())
    return [title, "---|" * len(cards) + "---", *lines]


def _core_minutes(card: Mapping[str, Any]) -> float:
    return card["learning"]["seconds"] * card["settings"]["threads"] / 60.0


def _right(found: Mapping[str, Any] | None) -> str:
    """A share of examples, with its interval where there is one."""
    if found is None:
        return "-"
    low, high = (100.0 * bound for bound in found["interval95"])
    return f"{100.0 * found['share']:.0f} [{low:.0f}, {high:.0f}]"


def keep_oracle(rows: Iterable[Mapping[str, Any]]) -> None:
    """Keep what `benchmarks.oracle` found, a row a scene."""
    lines = [
        (
            row["scenario_id"], row["family"], f"{row['score']:.4f}", int(bool(row.get("done"))),
            int(row["fault"] is not None or bool(row.get("unsafe"))), row["drives"],
        )
        for row in rows
    ]  # fmt: skip
    write_table(ORACLE, FOUND, lines)


def _oracle(table: ResultsTable, sites: Mapping[str, str]) -> tuple[str, dict[str, Cell]]:
    """Who it is, and its cells of these columns."""
    rows = read_table(ORACLE, FOUND)
    drives = sum(int(row["drives"]) for row in rows) / len(rows)
    cells = {column.key: _oracle_cell(column, rows, sites) for column in table.columns}
    return f"the oracle, which tries choices out: {drives:.0f} drives a scene", cells


def _oracle_cell(column: Column, rows: Iterable[Mapping[str, str]], sites: Mapping[str, str]) -> Cell:
    what = {"done_share": "done", "unsafe_share": "unsafe"}.get(column.key, "score")
    values = {
        (row["scenario"], 0): DriveValue(row["family"], 100.0 * number_in(row[what], ORACLE), sites[row["scenario"]])
        for row in rows
        if column.covers(row["family"])
    }
    return Cell(mean_over_scenes(values), mean_interval(values, POINTS), len(values), len(values))


def _who(options: str) -> str:
    """In words, by the options of a planner that asks a model."""
    given = dict(option.split("=", 1) for option in options.split("&"))
    return MODELS[given["model"]] + (", told its last decisions, `memory=true`" if "memory" in given else "")
