"""Drives as the page shows them: one for each row of each line, read once and in one order."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from interplan_sumo.batch.results import Row
from interplan_sumo.batch.run_folder import slug
from interplan_sumo.report.failure_reasons import lost_points
from interplan_sumo.report.table import ResultsTable

WHOLE: Final = 99.95
"""A score from which on it shows as 100.0."""


@dataclass(frozen=True, slots=True)
class ShownDrive:
    """What the page says of a drive; the row itself is let go."""

    line: int
    """Which line of the table it belongs to."""
    label: str
    planner: str
    scenario: str
    family: str
    seed: int
    score: float | None
    """0 to 100; None after a fault that is not the planner's."""
    reached_goal: bool
    fault: bool
    reasons: tuple[str, ...]

    @property
    def replay(self) -> str:
        """File name of its replay."""
        return f"{slug(f'{self.scenario} {self.label} seed {self.seed}')}.html"

    @property
    def lost(self) -> bool:
        return bool(self.reasons) or self.score is None


def shown_drives(table: ResultsTable) -> list[ShownDrive]:
    """All drives, those of one scenario and seed side by side; scenarios in the order of the table's rows."""
    found = [
        ShownDrive(
            line=number,
            label=line.label,
            planner=line.planner,
            scenario=row["scenario_id"],
            family=row["family"],
            seed=row["seed"],
            score=None if row["score"] is None else 100.0 * row["score"],
            reached_goal=bool(row["reached_goal"]),
            fault=bool(row["fault"]),
            reasons=() if _is_whole(row) else tuple(lost_points(row)),
        )
        for number, line in enumerate(table.lines)
        for row in line.rows
    ]
    place = {scenario: i for i, scenario in enumerate(dict.fromkeys(drive.scenario for drive in found))}
    return sorted(found, key=lambda drive: (place[drive.scenario], drive.seed, drive.line))


def _is_whole(row: Row) -> bool:
    """Whether a score shows as 100.0: what it lacks is rounding, and no loss that anybody would look for."""
    return not row["fault"] and row["score"] is not None and 100.0 * row["score"] >= WHOLE


def by_scenario(drives: Iterable[ShownDrive]) -> dict[str, list[ShownDrive]]:
    """The drives of each scenario, in order."""
    found: dict[str, list[ShownDrive]] = {}
    for drive in drives:
        found.setdefault(drive.scenario, []).append(drive)
    return found


def replays_folder(page: Path) -> Path:
    """Where the replays of a page lie: `report-replays/` beside `report.html`."""
    return page.with_name(f"{page.stem}-replays")


def pair_replay(scenario: str) -> str:
    """File name of the replay of a scenario's best and worst drive side by side."""
    return f"{slug(f'{scenario} best and worst')}.html"
