"""Drives as the page shows them: one for each row of each line, read once and in one order."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from interplan_sumo.batch.records import Row
from interplan_sumo.batch.run_folder import slug
from interplan_sumo.report.failure_reasons import lost_points
from interplan_sumo.report.table import ResultsTable

WHOLE: Final = 99.95
"""A score from which on it shows as 100.0."""
BANDS: Final = {"b0": "0", "b1": "below 40", "b2": "40 to 80", "b3": "80 to 100", "b4": "100"}
"""Where a score lies, by the class of its colour."""


@dataclass(frozen=True, slots=True)
class ShownDrive:
    """What the page says of a drive; the row itself is let go."""

    anchor: str
    """What a link to its row names."""
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
    trace_hash: str

    @property
    def replay(self) -> str:
        """File name of its replay: another one if it is driven again and comes out otherwise."""
        return replay_name(self.scenario, self.label, self.seed, self.trace_hash)

    @property
    def lost(self) -> bool:
        return bool(self.reasons) or self.score is None

    @property
    def rank(self) -> float:
        """The lower, the worse; a drive without a score is worst."""
        return -1.0 if self.score is None else self.score

    @property
    def band(self) -> str:
        return band(self.score)


def shown(score: float) -> str:
    """A score as the page tells it: 80, 79.6."""
    return f"{round(score, 1):g}"


def band(score: float | None) -> str:
    """Class of a score's colour: one of BANDS, `none` without a score."""
    if score is None:
        return "none"
    score = round(score, 1)  # what is shown alike has one colour
    return "b0" if score <= 0.0 else "b1" if score < 40.0 else "b2" if score < 80.0 else "b3" if score < 100.0 else "b4"


def shown_drives(table: ResultsTable) -> list[ShownDrive]:
    """All drives, those of one scenario and seed side by side; scenarios in the order of the table's rows."""
    found = [
        ShownDrive(
            anchor="",
            line=number,
            label=line.label,
            planner=line.planner,
            scenario=row.scenario_id,
            family=row.family,
            seed=row.seed,
            score=None if row.score is None else 100.0 * row.score,
            reached_goal=row.reached_goal,
            fault=bool(row.fault),
            reasons=() if _is_whole(row) else tuple(lost_points(row)),
            trace_hash=row.trace_hash or "",
        )
        for number, line in enumerate(table.lines)
        for row in line.rows
    ]
    place = {scenario: i for i, scenario in enumerate(dict.fromkeys(drive.scenario for drive in found))}
    found.sort(key=lambda drive: (place[drive.scenario], drive.seed, drive.line))
    return [replace(drive, anchor=f"drive-{number}") for number, drive in enumerate(found)]


def _is_whole(row: Row) -> bool:
    """Whether a score shows as 100.0: what it lacks is rounding, and no loss that anybody would look for."""
    return not row.fault and row.score is not None and 100.0 * row.score >= WHOLE


def by_scenario(drives: Iterable[ShownDrive]) -> dict[str, list[ShownDrive]]:
    """The drives of each scenario, in order."""
    found: dict[str, list[ShownDrive]] = {}
    for drive in drives:
        found.setdefault(drive.scenario, []).append(drive)
    return found


def replays_folder(page: Path) -> Path:
    """Where the replays of a page lie: `report-replays/` beside `report.html`."""
    return page.with_name(f"{page.stem}-replays")


def replay_name(scenario: str, label: str, seed: int, trace_hash: str) -> str:
    """File name of the replay of a drive."""
    return f"{slug(f'{scenario} {label} seed {seed} {trace_hash}')}.html"


def pair_replay(drives: Sequence[ShownDrive]) -> str:
    """File name of the replay of the best and the worst of the drives of a scenario side by side."""
    scenario, traces = drives[0].scenario, " ".join(sorted(drive.trace_hash for drive in drives))
    return f"{slug(f'{scenario} best and worst {traces}')}.html"
