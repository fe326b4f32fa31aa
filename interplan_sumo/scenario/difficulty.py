"""Difficulty: how hard the scenes of a folder are, where they were searched to be hard."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from interplan_sumo.world.csv_tables import number_in, read_table

if TYPE_CHECKING:
    from pathlib import Path

HARD: Final = "hard.csv"


def read_difficulties(folder: Path) -> dict[str, float]:
    """By scene the share of the panel that fails; nothing of a folder without that. InputError if it cannot be read."""
    path = folder / HARD
    if not path.is_file():
        return {}
    rows = read_table(path, ("scenario_id", "difficulty"))
    return {row["scenario_id"]: number_in(row["difficulty"], path) for row in rows}
