"""Table: from the rows of runs to the paper's table, one line per planner."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from operator import eq
from typing import Final, overload

from interplan_sumo.batch.briefs import Brief
from interplan_sumo.batch.records import AppliedOverrides, JobKey, Row
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.errors import RunFolderError
from interplan_sumo.families import families, find_family
from interplan_sumo.report.driven import DrivenRun, family_of, together
from interplan_sumo.report.standing import LineValues, Standing, standing
from interplan_sumo.statistics.intervals import POINTS, mean_interval
from interplan_sumo.statistics.scene_values import DriveKey, DriveValue, DriveValues, mean_over_scenes

ORDINARY: Final = "ordinary"
PAPER_PROFILE: Final = "interplan-paper"
BENCHMARK: Final = "interplan"
"""Keys of the columns over all ordinary driving, and over all the rest."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column of the table."""

    key: str
    """In files."""
    title: str
    about: str
    """A few words for pages."""
    covers: Callable[[str], bool]
    """Whether it is a mean over the scenarios of a family."""
    value: Callable[[Brief], float | None]
    """0 to 1, of one drive with a score; None where the profile does not judge it."""
    optional: bool = False
    """Whether it is left out where no drive is judged by it."""
    lower_is_better: bool = False


def table_columns(driven: Iterable[str] = ()) -> tuple[Column, ...]:
    """Ordinary driving, the benchmark, its families in their order, and the three about lane changes.

    Families are those that are installed, and those that were `driven`, which need not be.
    """
    rare = {name: family for name in {*families(), *driven} if not (family := find_family(name)).ordinary}
    of_families = [
        Column(family.column_key or name, family.column or family.title, family.title, partial(eq, name), _score)
        for name, family in sorted(rare.items(), key=lambda item: (item[1].order, item[0]))
    ]
    return (
        # stands where the paper has nuPlan's Val14
        Column(ORDINARY, "Ordinary", "Ordinary driving", lambda family: find_family(family).ordinary, _score),
        Column(BENCHMARK, "interPlan", "interPlan, all families", _is_rare, _score),
        Column("done_share", "Done %", "Task done", _is_rare, _done, optional=True),
        Column("unsafe_share", "Unsafe %", "Unsafe", _is_rare, unsafe_share, optional=True, lower_is_better=True),
        Column("paper_score", "by paper", f"interPlan by {PAPER_PROFILE}", _is_rare, _paper_score, optional=True),
        *of_families,
        Column("driv", "Driv.", "Lane changes: stayed on the road", _changes_lanes, _drivable_area),
        Column("goal", "Goal", "Lane changes: reached the goal lane", _changes_lanes, _reached_goal_lane),
        Column("no_col", "No-Col.", "Lane changes: no collision at fault", _changes_lanes, _no_collision),
    )


def _is_rare(family: str) -> bool:
    return not find_family(family).ordinary


def _done(drive: Brief) -> float | None:
    if drive.fault:
        return 0.0
    return None if drive.done is None else float(drive.done)


def unsafe_share(drive: Brief) -> float | None:
    """1 for an unsafe drive, else 0; None where the profile does not say."""
    if drive.fault:
        return 1.0  # nobody drove on
    return None if drive.unsafe is None else float(drive.unsafe)


def _paper_score(drive: Brief) -> float | None:
    return 0.0 if drive.fault else dict(drive.beside).get(PAPER_PROFILE)


def _changes_lanes(family: str) -> bool:
    return find_family(family).changes_lanes


def _score(drive: Brief) -> float | None:
    return drive.score


def _no_collision(drive: Brief) -> float | None:
    return 0.0 if drive.fault else drive.no_collision  # 0 where the planner failed, whatever it did until then


def _drivable_area(drive: Brief) -> float | None:
    return 0.0 if drive.fault else drive.drivable_area


def _reached_goal_lane(drive: Brief) -> float | None:
    """Whether the drive ended in the goal lane: the boolean, not the partial score."""
    if drive.fault:
        return 0.0
    return None if drive.goal_lane is None else float(drive.goal_lane)


@dataclass(frozen=True, slots=True)
class Cell:
    """One figure of the table, 0 to 100."""

    value: float | None
    """None where the run has no such scenario, where the profile does not judge it, or where rows are missing:
    an incomplete mean is no mean."""
    interval: tuple[float, float] | None
    """95 %, over scenarios like these (`statistics.intervals`); None with fewer than two scenarios."""
    done: int
    asked: int
    """Jobs with a score, and jobs asked for."""

    @property
    def incomplete(self) -> bool:
        return self.done < self.asked


class DriveRows(Sequence[Row]):
    """Rows of one or more runs in an order of their own, each read when it is asked for."""

    def __init__(self, places: Sequence[tuple[Mapping[JobKey, Row], JobKey]]) -> None:
        self.places = places
        """Who holds each row, and under which key."""

    @property
    def keys(self) -> list[JobKey]:
        return [key for _, key in self.places]

    @overload
    def __getitem__(self, at: int) -> Row: ...
    @overload
    def __getitem__(self, at: slice) -> DriveRows: ...
    def __getitem__(self, at: int | slice) -> Row | DriveRows:
        if isinstance(at, slice):
            return DriveRows(self.places[at])
        rows, key = self.places[at]
        return rows[key]

    def __len__(self) -> int:
        return len(self.places)


@dataclass(frozen=True, slots=True)
class Line:
    """One planner in one setting."""

    label: str
    planner: str
    overrides: AppliedOverrides
    cells: Mapping[str, Cell]
    scenarios: int
    seeds: int
    """Of the interPlan columns; of ordinary driving where there is nothing else."""
    rows: DriveRows
    """In suite order, ordinary driving last."""
    faulty: DriveRows
    """Those of the rows that ended in a fault."""
    missing: tuple[JobKey, ...]
    families: Mapping[str, frozenset[str]]
    """Ids of the scenarios that were driven, by family."""
    faults: Mapping[str, int]
    """How many rows ended in each class of fault."""
    official: bool
    questions: int
    """How often the planner asked a language model."""
    unanswered: int
    """How often in vain: then it fell back on something else, and the score says less about the model."""
    begun_again: int
    """How many drives were begun more than once, because a process was killed."""
    verified: int
    """How many rows came again from their stored plans and have not changed since."""

    def drives(self, column: Column) -> frozenset[DriveKey]:
        """Those of its rows that a column is about."""
        about = {each for family, ids in self.families.items() if column.covers(family) for each in ids}
        return frozenset((scenario, seed) for scenario, _, seed in self.rows.keys if scenario in about)


@dataclass(frozen=True, slots=True)
class ResultsTable:
    """What a report is about."""

    suite: str
    ordinary_suite: str | None
    """The suite of ordinary driving that stands beside `suite`, if there is one."""
    profile: str
    columns: tuple[Column, ...]
    lines: tuple[Line, ...]
    shards: tuple[str, ...]
    """Runs of which only some shards are here, in words."""
    standing: Standing
    """Which lines can be told apart, and how large a difference this table would find."""

    def asked(self, column: Column) -> bool:
        """Whether any line was to drive what the column is about, and is judged by it if that is optional."""
        cells = [line.cells[column.key] for line in self.lines]
        return any(cell.asked and (not column.optional or cell.incomplete or cell.value is not None) for cell in cells)

    @property
    def complete(self) -> bool:
        return not any(line.missing for line in self.lines)

    @property
    def families(self) -> dict[str, int]:
        """Scenarios per family over all lines, in order of appearance."""
        found: dict[str, set[str]] = {}
        for line in self.lines:
            for family, ids in line.families.items():
                found.setdefault(family, set()).update(ids)
        return {family: len(ids) for family, ids in found.items()}


def make_table(runs: Sequence[StoredRun]) -> ResultsTable:
    """One line per planner and run; official and overridden rows are never mixed.

    Runs of ordinary driving may stand beside runs of one other suite: a planner
    that has one run of each has one line. RunFolderError if the runs are of
    different suites otherwise, of different profiles or versions, or if one asks for no drive.
    """
    driven = together(runs)
    for each in driven:
        if not each.keys:
            raise RunFolderError(f"{each.run.path} asks for no drive ({each.run.manifest.part}); leave it out")
    ordinary = [each.run for each in driven if each.ordinary]
    others = [each.run for each in driven if not each.ordinary]
    for group, shared in (
        (runs, ("profile", "traffic_version", "scoring_version")),
        (others, ("suite", "suite_hash")),
        (ordinary, ("suite", "suite_hash")),
    ):
        for run in group[1:]:
            check_agree(run, group[0], dict.fromkeys(shared, "report them separately"))
    first = (others or ordinary)[0].manifest
    beside = ordinary[0].manifest.suite if others and ordinary else None
    columns = table_columns({drive.family for each in driven for drive in each.briefs.values()})
    lines, values = zip(*_lines(driven, columns), strict=True)
    shards = tuple(each.shards for each in driven if each.shards is not None)
    apart = standing((BENCHMARK, ORDINARY), values)
    return ResultsTable(first.suite, beside, first.profile, columns, lines, shards, apart)


def check_agree(run: StoredRun, other: StoredRun, ways_out: Mapping[str, str]) -> None:
    """RunFolderError where the manifests differ in something: what, and the way out that goes with it."""
    for what, way_out in ways_out.items():
        mine, theirs = (getattr(each.manifest, what) for each in (run, other))
        if mine != theirs:
            name = what.replace("_", " ")
            raise RunFolderError(f"{run.path} has {name} {mine}, {other.path} has {theirs}; {way_out}")


def _lines(driven: Sequence[DrivenRun], columns: Sequence[Column]) -> Iterator[tuple[Line, LineValues]]:
    """A line per planner and run, in order; one for two runs if they are the planner's only ones, one of each kind."""
    named = [(each, planner, planner_label(planner, each.run)) for each in driven for planner in each.keys]
    for each, planner, name in named:
        alike = [(other, spec) for other, spec, label in named if label == name]
        same = sorted((other for other, _ in alike), key=lambda other: other.ordinary)
        versions = {
            other.run.manifest.planners[spec].hash for other, spec in alike if spec in other.run.manifest.planners
        }
        if [other.ordinary for other in same] != [False, True] or len(versions) > 1:
            yield _line([each], columns, planner, f"{name} ({each.run.path.name})" if len(same) > 1 else name)
        elif each is next(other for other, _, label in named if label == name):
            yield _line(same, columns, planner, name)


def planner_label(planner: str, run: StoredRun) -> str:
    """A planner and how its traffic was changed, as tables name it."""
    overrides = run.manifest.overrides.texts()
    said = ", ".join(f"{key}={value.partition(' ')[0]}" for key, value in overrides.items())
    return f"{planner} [{said}]" if said else planner


def _line(driven: Sequence[DrivenRun], columns: Sequence[Column], planner: str, label: str) -> tuple[Line, LineValues]:
    """What a planner did in runs that share no scenario; the first of them says how many scenarios and seeds."""
    first, overrides = driven[0], driven[0].run.manifest.overrides
    scenarios: dict[str, _Scenario] = {}
    rows: list[tuple[Mapping[JobKey, Row], JobKey]] = []
    faulty: list[tuple[Mapping[JobKey, Row], JobKey]] = []
    missing: list[JobKey] = []
    families: dict[str, set[str]] = {}
    faults: Counter[str] = Counter()
    official = not overrides
    questions = unanswered = again = verified = 0
    for each in driven:
        for key in each.keys[planner]:
            drive = each.briefs.get(key)
            scenario = scenarios.setdefault(key[0], _Scenario(family_of(key, each.briefs)))
            scenario.drives[key[0], key[2]] = drive
            if drive is None or drive.score is None:
                missing.append(key)
            if drive is None:
                continue
            scenario.family = drive.family
            rows.append((each.rows_with(key), key))
            families.setdefault(drive.family, set()).add(key[0])
            official = official and drive.official
            questions, unanswered = questions + (drive.questions or 0), unanswered + (drive.unanswered or 0)
            again += drive.tries > 1
            verified += key in each.verified
            if drive.fault:
                faulty.append(rows[-1])
                faults[drive.fault] += 1
    values = {column.key: _values(column, scenarios.values()) for column in columns}
    line = Line(
        label=label,
        planner=planner,
        overrides=overrides,
        cells={key: _cell(*found) for key, found in values.items()},
        scenarios=len({key[0] for key in first.keys[planner]}),
        seeds=len({key[2] for key in first.keys[planner]}),
        rows=DriveRows(rows),
        faulty=DriveRows(faulty),
        missing=tuple(missing),
        families={family: frozenset(ids) for family, ids in families.items()},
        faults=dict(sorted(faults.items())),
        official=official,
        questions=questions,
        unanswered=unanswered,
        begun_again=again,
        verified=verified,
    )
    return line, {key: drives for key, (drives, _, _) in values.items()}


@dataclass(slots=True)
class _Scenario:
    """The drives of one planner on one scenario."""

    family: str
    """A guess by its id until one of the drives is done."""
    drives: dict[DriveKey, Brief | None] = field(default_factory=dict[DriveKey, Brief | None])
    """One per seed; None for one that has not been done."""


def _values(column: Column, scenarios: Iterable[_Scenario]) -> tuple[DriveValues, int, int]:
    """The figures of a column, 0 to 100, how many drives have a score and how many were asked for.

    No figures at all where one is missing or is not judged: an incomplete mean is no mean.
    """
    found: dict[DriveKey, DriveValue] = {}
    asked = done = 0
    for scenario in scenarios:
        if not column.covers(scenario.family):
            continue
        asked += len(scenario.drives)
        for key, drive in scenario.drives.items():
            if drive is None or drive.score is None:
                continue
            done += 1
            value = column.value(drive)
            if value is not None:
                found[key] = DriveValue(scenario.family, 100.0 * value, drive.site)
    return (found if len(found) == asked else {}), done, asked


def _cell(values: DriveValues, done: int, asked: int) -> Cell:
    return Cell(mean_over_scenes(values), mean_interval(values, POINTS), done, asked)
