"""What the shipped networks learned, from their model cards, and how they drive; what a plan of any planner costs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from interplan_learned.card import Card, read_card
from interplan_learned.network import shipped_cards
from interplan_sumo.report.table import ResultsTable
from interplan_sumo.world.csv_tables import read_table, write_table
from tools.cells import DRIVEN, RARE, cell_text, heading
from tools.hard_scores import RESULTS

PLAN_TIMES: Final = RESULTS / "plan_times.csv"
"""What `benchmarks.planner_speed --keep` found last."""
TIMES: Final = ("planner", "mean", "median", "p90", "most", "first", "x_idm", "clock")
"""Its columns: milliseconds, but for `x_idm`."""
DATA_SCALING: Final = RESULTS / "data_scaling.csv"
"""Errors of shipped networks that learned from a part of their data."""
PARTS: Final = ("network", "data", "samples", "val", "test")
"""Its columns: the hash of the data, how many samples of it, and metres."""
LATE: Final = 5
"""Epochs in which a network that has learned what it can gains next to nothing."""
DRIVES: Final = {"pdm_offset": "pdm_hybrid"}
"""Who drives with a network that has another name."""


def networks(rare: ResultsTable, ordinary: ResultsTable) -> list[str]:
    """Open-loop errors, what a plan costs, and the scores of both suites, of each shipped network."""
    lines = heading(
        "planner", "network", "weights", "samples", "epochs", "new traffic m", "new district m", "of late", "ordinary",
        "rare", "plan ms",
    )  # fmt: skip
    cards = [read_card(path) for path in shipped_cards().values()]
    took = {line["planner"]: line["mean"] for line in _plan_times()}
    lines.append(" | ".join(("constant velocity", *[""] * 4, *_errors(cards[0], "constant_velocity"), *[""] * 4)))
    scores = [
        {line.planner: cell_text(line.cells[key]) for line in table.lines}
        for table, key in ((ordinary, DRIVEN), (rare, RARE))
    ]
    for card in sorted(cards, key=lambda card: _error(card, "val", "network")):
        name, training = DRIVES.get(card.planner, card.planner), card.training
        epochs = f"{training['best_epoch']} of {training['epochs_done']}"
        about = (f"`{name}`", card.size, f"{card.parameters:,}", f"{card.data['samples']['train']:,}", epochs)
        driven = (of.get(name, "-") for of in scores)
        of_late = gained_of_late(training.get("held_out_m", []))
        lines.append(" | ".join((*about, *_errors(card, "network"), of_late, *driven, _short(took.get(name)))))
    return lines


def keep_scaling(cards: Iterable[Path]) -> None:
    """Keep the errors of networks that learned from parts of the data, in place of earlier ones of the same networks.

    Ends the program for a network whose shipped weights learned from other data: those are the end of its line.
    """
    fresh: list[tuple[Any, ...]] = []
    for card in map(read_card, cards):
        shipped = read_card(shipped_cards()[card.planner])
        if card.data["hash"] != shipped.data["hash"]:
            raise SystemExit(
                f"{card.planner} learned from {card.data['hash']}, the shipped from {shipped.data['hash']}"
            )
        errors = (f"{_error(card, split, 'network'):.4f}" for split in ("val", "test"))
        fresh.append((card.planner, card.data["hash"], card.data["samples"]["train"], *errors))
    again = {line[0] for line in fresh}
    lines = [*fresh, *(tuple(line[name] for name in PARTS) for line in _parts() if line["network"] not in again)]
    lines.sort(key=lambda line: (line[0], int(line[2])))
    write_table(DATA_SCALING, PARTS, lines)


def data_scaling() -> list[str]:
    """What more data are worth: errors of a network by the number of samples, the shipped one's last.

    Ends the program if a shipped network has learned from other data since.
    """
    lines = heading("network", "samples", "new traffic m", "new district m")
    parts = _parts()
    for name in dict.fromkeys(line["network"] for line in parts):
        shipped = read_card(shipped_cards()[name])
        mine = [line for line in parts if line["network"] == name]
        if any(line["data"] != shipped.data["hash"] for line in mine):
            raise SystemExit(f"{DATA_SCALING}: {name} has learned from other data since; train its parts anew")
        told = [(int(line["samples"]), *(f"{float(line[split]):.2f}" for split in ("val", "test"))) for line in mine]
        told.append((shipped.data["samples"]["train"], *_errors(shipped, "network")))
        lines += [f"`{name}` | {samples:,} | {val} | {test}" for samples, val, test in told]
    return lines


def _parts() -> list[dict[str, str]]:
    return read_table(DATA_SCALING, PARTS) if DATA_SCALING.is_file() else []


def gained_of_late(held_out_m: Sequence[float]) -> str:
    """By how much the least of these errors, one an epoch, fell in the last `LATE` of them; a dash for no more."""
    if len(held_out_m) <= LATE:
        return "-"
    return f"{100.0 * (1.0 - min(held_out_m) / min(held_out_m[:-LATE])):.1f} %"


def plan_times() -> list[str]:
    """What a call of `plan` costs, by planner."""
    lines = heading("planner", "mean", "median", "90 %", "x IDM")
    for line in _plan_times():
        shown = (_short(line[key]) for key in ("mean", "median", "p90", "x_idm"))
        lines.append(" | ".join((f"`{line['planner']}`", *shown)))
    return lines


def keep_plan_times(rows: list[tuple[Any, ...]]) -> None:
    """Keep what was measured in one run, in place of what was before; a row as `TIMES`."""
    write_table(PLAN_TIMES, TIMES, rows)


def _plan_times() -> list[dict[str, str]]:
    return read_table(PLAN_TIMES, TIMES)


def _errors(card: Card, whose: str) -> tuple[str, str]:
    return f"{_error(card, 'val', whose):.2f}", f"{_error(card, 'test', whose):.2f}"


def _error(card: Card, split: str, whose: str) -> float:
    return float(card.errors[split][whose]["ade"])


def _short(value: str | None) -> str:
    """Two digits, or a dash."""
    if value is None:
        return "-"
    number = float(value)
    return f"{number:.0f}" if number >= 10.0 else f"{number:.1f}"
