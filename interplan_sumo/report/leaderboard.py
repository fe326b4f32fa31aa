"""Leaderboard: judged bundles in one table, best first, each with what its card says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from interplan_sumo.batch.judged import Judged, judged_folders, read_judged
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.families import find_family
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

    @property
    def ordinary(self) -> bool:
        """Whether it is of ordinary driving only."""
        return all(find_family(brief.family).ordinary for brief in self.run.briefs.values())


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
    entries = ranked(entries)
    return Leaderboard(make_table([entry.run for entry in entries]), tuple(entries))


def ranked(entries: Sequence[Entry]) -> list[Entry]:
    """Best first, by what stands in the first column: ordinary driving goes with the rest of its planner."""
    best: dict[str, float] = {}
    for entry in entries:
        if not entry.ordinary:
            best[entry.judged.card.name] = max(entry.mean, best.get(entry.judged.card.name, 0.0))

    def rank(entry: Entry) -> tuple[float, float, str, str]:
        name = entry.judged.card.name
        return -(best.get(name, -1.0) if entry.ordinary else entry.mean), -entry.mean, name, entry.judged.sha256

    return sorted(entries, key=rank)
