"""Leaderboard: judged bundles in one table, best first, each with what its card says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from interplan_sumo.batch.judged import Judged, judged_folders, read_judged
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.report.table import Line, ResultsTable, make_table


@dataclass(frozen=True, slots=True)
class Entry:
    """A judged bundle."""

    run: StoredRun
    judged: Judged

    @property
    def mean(self) -> float:
        """Over its drives, 0 to 1; what has no score counts as none."""
        scores = [brief.score or 0.0 for brief in self.run.briefs.values()]
        return sum(scores) / len(scores) if scores else 0.0


@dataclass(frozen=True, slots=True)
class Leaderboard:
    """What is known of all that was handed in."""

    table: ResultsTable
    entries: tuple[Entry, ...]

    def of(self, line: Line) -> tuple[Entry, ...]:
        """The bundles that a line of the table is of: one, or that of ordinary driving beside it."""
        named = [entry for entry in self.entries if entry.judged.card.name == line.planner]
        alone = [entry for entry in named if line.label.endswith(f"({entry.run.path.name})")]
        return tuple(alone or named)


def make_leaderboard(places: Sequence[Path]) -> Leaderboard:
    """Of the judged run folders among these and right below them.

    RunFolderError if there is none, if one is damaged, or if they are of
    different suites, profiles or traffic.
    """
    entries = [Entry(read_run(folder), read_judged(folder)) for folder in judged_folders(tuple(places))]
    entries.sort(key=lambda entry: (-entry.mean, entry.judged.card.name, entry.judged.sha256))
    return Leaderboard(make_table([entry.run for entry in entries]), tuple(entries))
