"""Table: from the rows of runs to the paper's table, one line per planner."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from interplan_sumo.batch.jobs import JobKey
from interplan_sumo.batch.run_folder import Row, StoredRun
from interplan_sumo.errors import RunFolderError
from interplan_sumo.scenario.ordinary import TYPES

RESAMPLES = 4000
BOOTSTRAP_SEED = 20240407
"""Fixed, so that a report of the same rows is the same report."""

LANE_CHANGES = ("lane_change_ltd", "lane_change_mtd", "lane_change_htd")


@dataclass(frozen=True, slots=True)
class Column:
    """A column of the paper's table."""

    key: str
    title: str
    families: tuple[str, ...]
    """Over whose scenarios it is the mean; none means all but ordinary driving."""
    value: Callable[[Row], float | None]
    """0 to 1, of one row with a score; None where the profile does not judge it."""

    def covers(self, family: str) -> bool:
        return family in self.families if self.families else family not in TYPES


def _score(row: Row) -> float:
    return float(row["score"])


def _judged(name: str) -> Callable[[Row], float | None]:
    """A metric's score; 0 where the planner failed, whatever it did until then."""

    def value(row: Row) -> float | None:
        if row["fault"]:
            return 0.0
        return row["metrics"].get(name, {}).get("score")

    return value


def _reached_goal_lane(row: Row) -> float | None:
    """Whether the drive ended in the goal lane: the boolean, not the partial score."""
    if row["fault"]:
        return 0.0
    lane_changes = row["metrics"].get("lane_changes")
    return None if lane_changes is None else float(lane_changes["detail"]["goal"])


ORDINARY = Column("ordinary", "Ordinary", tuple(TYPES), _score)
"""Stands where the paper has nuPlan's Val14."""
COLUMNS = (
    ORDINARY,
    Column("interplan", "interPlan", (), _score),
    Column("construction", "Constr.", ("construction",), _score),
    Column("accident", "Acc.", ("accident",), _score),
    Column("jaywalker", "Jayw.", ("jaywalker",), _score),
    Column("nudge", "Nudge", ("nudge",), _score),
    Column("overtake", "Overt.", ("overtake",), _score),
    Column("ltd", "LTD", ("lane_change_ltd",), _score),
    Column("mtd", "MTD", ("lane_change_mtd",), _score),
    Column("htd", "HTD", ("lane_change_htd",), _score),
    Column("driv", "Driv.", LANE_CHANGES, _judged("drivable_area")),
    Column("goal", "Goal", LANE_CHANGES, _reached_goal_lane),
    Column("no_col", "No-Col.", LANE_CHANGES, _judged("no_collision")),
)
"""In the paper's order."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One figure of the table, 0 to 100."""

    value: float | None
    """None where the run has no such scenario, where the profile does not judge it, or where rows are missing:
    an incomplete mean is no mean."""
    interval: tuple[float, float] | None
    """95 % of bootstrap means over the seeds of each scenario; None with one seed."""
    done: int
    asked: int
    """Jobs with a score, and jobs asked for."""

    @property
    def incomplete(self) -> bool:
        return self.done < self.asked


@dataclass(frozen=True, slots=True)
class Line:
    """One planner in one setting."""

    label: str
    planner: str
    overrides: Mapping[str, str]
    cells: Mapping[str, Cell]
    scenarios: int
    seeds: int
    """Of the interPlan columns; of ordinary driving where there is nothing else."""
    rows: tuple[Row, ...]
    """In suite order, ordinary driving last."""
    missing: tuple[JobKey, ...]

    @property
    def official(self) -> bool:
        return not self.overrides and all(row.get("official", True) for row in self.rows)

    @property
    def faults(self) -> dict[str, int]:
        """How many rows ended in each class of fault."""
        classes = sorted(row["fault"]["class"] for row in self.rows if row["fault"])
        return {name: len(list(group)) for name, group in groupby(classes)}


@dataclass(frozen=True, slots=True)
class Table:
    """What a report is about."""

    suite: str
    ordinary_suite: str | None
    """The suite of ordinary driving that stands beside `suite`, if there is one."""
    profile: str
    lines: tuple[Line, ...]

    @property
    def complete(self) -> bool:
        return not any(line.missing for line in self.lines)

    @property
    def families(self) -> dict[str, int]:
        """Scenarios per family over all lines, in order of appearance."""
        found: dict[str, set[str]] = {}
        for line in self.lines:
            for row in line.rows:
                found.setdefault(row["family"], set()).add(row["scenario_id"])
        return {family: len(ids) for family, ids in found.items()}


def make_table(runs: Sequence[StoredRun]) -> Table:
    """One line per planner and run; official and overridden rows are never mixed.

    Runs of ordinary driving may stand beside runs of one other suite: a planner
    that has one run of each has one line. RunFolderError if the runs are of
    different suites otherwise, or of different profiles.
    """
    ordinary = [run for run in runs if _is_ordinary(run)]
    others = [run for run in runs if not _is_ordinary(run)]
    _check_agree(runs, "profile")
    for group in (others, ordinary):
        _check_agree(group, "suite", "suite_hash")
    first = (others or ordinary)[0].manifest
    beside = ordinary[0].manifest["suite"] if others and ordinary else None
    return Table(first["suite"], beside, first["profile"], tuple(_lines(runs)))


def _is_ordinary(run: StoredRun) -> bool:
    """Whether a run is of ordinary driving only."""
    return bool(run.keys) and all(_family(run, key) in TYPES for key in run.keys)


def _check_agree(runs: Sequence[StoredRun], *shared: str) -> None:
    for run in runs[1:]:
        for what in shared:
            if run.manifest[what] != runs[0].manifest[what]:
                raise RunFolderError(
                    f"{run.path} has {what} {run.manifest[what]}, {runs[0].path} has {runs[0].manifest[what]}; "
                    "report them separately"
                )


def _lines(runs: Sequence[StoredRun]) -> Iterator[Line]:
    """A line per planner and run, in order; one for two runs if they are the planner's only ones, one of each kind."""
    driven = [(run, planner, planner_label(planner, run)) for run in runs for planner in planners_of(run)]
    for run, planner, name in driven:
        same = sorted((other for other, _, label in driven if label == name), key=_is_ordinary)
        if [_is_ordinary(other) for other in same] != [False, True]:
            yield _line([run], planner, f"{name} ({run.path.name})" if len(same) > 1 else name)
        elif run is next(other for other, _, label in driven if label == name):
            yield _line(same, planner, name)


def planners_of(run: StoredRun) -> list[str]:
    """The planners that a run was asked for, in order."""
    return list(dict.fromkeys(planner for _, planner, _ in run.keys))


def planner_label(planner: str, run: StoredRun) -> str:
    """A planner and how its traffic was changed, as tables name it."""
    overrides = run.manifest["overrides"]
    said = ", ".join(f"{key}={value.partition(' ')[0]}" for key, value in overrides.items())
    return f"{planner} [{said}]" if said else planner


def _family(run: StoredRun, key: JobKey) -> str:
    """A scenario that has no row yet has no family on file; official ids begin with it."""
    return run.rows[key]["family"] if key in run.rows else key[0].partition("/")[0]


def _line(runs: Sequence[StoredRun], planner: str, label: str) -> Line:
    """What a planner did in runs that share no scenario; the first of them says how many scenarios and seeds."""
    found = {key: run for run in runs for key in run.keys if key[1] == planner}
    family = {key: _family(run, key) for key, run in found.items()}
    cells: dict[str, Cell] = {}
    for column in COLUMNS:
        wanted = [key for key in found if column.covers(family[key])]
        cells[column.key] = _cell([found[key].rows.get(key) for key in wanted], column.value)
    counted = [key for key, run in found.items() if run is runs[0]]
    return Line(
        label=label,
        planner=planner,
        overrides=runs[0].manifest["overrides"],
        cells=cells,
        scenarios=len({key[0] for key in counted}),
        seeds=len({key[2] for key in counted}),
        rows=tuple(run.rows[key] for key, run in found.items() if key in run.rows),
        missing=tuple(key for run in runs for key in run.missing if key[1] == planner),
    )


def _cell(rows: Sequence[Row | None], value: Callable[[Row], float | None]) -> Cell:
    scored = [row for row in rows if row is not None and row["score"] is not None]
    by_scenario: dict[str, list[float | None]] = {}
    for row in scored:
        by_scenario.setdefault(row["scenario_id"], []).append(value(row))
    if not rows or len(scored) < len(rows) or any(None in found for found in by_scenario.values()):
        return Cell(None, None, len(scored), len(rows))
    values = [np.array(found, dtype=np.float64) for found in by_scenario.values()]
    mean = 100.0 * float(np.mean([v.mean() for v in values]))
    return Cell(mean, _interval(values), len(scored), len(rows))


def _interval(values: Sequence[NDArray[np.float64]]) -> tuple[float, float] | None:
    """95 % percentile bootstrap of the mean over scenarios of the mean over seeds.

    Scenarios are the benchmark and stay; the seeds of each are drawn again.
    """
    if max(len(v) for v in values) < 2:
        return None
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    total = np.zeros(RESAMPLES)
    for v in values:
        total += v[rng.integers(0, len(v), (RESAMPLES, len(v)))].mean(axis=1)
    low, high = np.percentile(100.0 * total / len(values), (2.5, 97.5))
    return float(low), float(high)


def faulty(lines: Iterable[Line]) -> list[Row]:
    """All rows that ended in a fault."""
    return [row for line in lines for row in line.rows if row["fault"]]
