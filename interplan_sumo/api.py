"""The Python API: what the command line does, with DataFrames in place of tables. Use it as `import interplan_sumo`."""

from __future__ import annotations

import atexit
import contextlib
import functools
import glob
import shutil
import sys
import tempfile
from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from interplan_sumo.batch import run as batch
from interplan_sumo.batch.given_planners import PlannerLike, named_planners
from interplan_sumo.batch.jobs import own_maps, scenario_file, scenario_named
from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.run_folder import StoredRun, read_run
from interplan_sumo.batch.score_job import rescore
from interplan_sumo.batch.stored_drive import StoredDrive, StoredDrives
from interplan_sumo.errors import InputError, clean_line
from interplan_sumo.maps.store import copy_map, load_roads
from interplan_sumo.metrics.metric import informative_metrics
from interplan_sumo.metrics.profile import DEFAULT_PROFILE
from interplan_sumo.metrics.score import ScoreSheet
from interplan_sumo.metrics.score import score as score_trace
from interplan_sumo.report.compare import Comparison, RunComparison, compare_runs
from interplan_sumo.report.failure_reasons import lost_points
from interplan_sumo.report.printing import progress as shown_progress
from interplan_sumo.report.table import make_table
from interplan_sumo.scenario.files import MAPS, read_scenarios, write_scenarios
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import DEFAULT_SUITE, expert, find_suite, suites
from interplan_sumo.world.roads import Roads
from interplan_sumo.world.trace import EgoTrack, Trace

if TYPE_CHECKING:
    from interplan_sumo.batch.run import RunProgress

RunLike = pd.DataFrame | StoredRun | str | PathLike[str]
"""What `run` and `load_run` return, or a run folder."""
ScenarioLike = str | PathLike[str] | Scenario
"""An id, a glob, a YAML file, or the scenario itself."""


def run(
    planner: PlannerLike | Sequence[PlannerLike] | Mapping[str, PlannerLike],
    suite: str | None = None,
    *,
    scenarios: ScenarioLike | Sequence[ScenarioLike] | None = None,
    progress: bool | RunProgress | None = None,
    **options: Any,
) -> pd.DataFrame:
    """Drive and score scenarios; one row per drive, as `load_run` has them.

    `suite` None is `interplan==1`, or what `scenarios` holds: ids, globs, YAML
    files or Scenario objects. The other options are those of the command `run`:
    {options}. `workers` None takes all cores; 0 drives in this
    process, and so do planners that no other process could import: objects,
    functions and classes of a notebook. They are named after their class, or by
    the keys of a mapping. `out` None writes to a temporary folder
    (`df.attrs["run_folder"]`), which is deleted when Python ends; with a folder
    the same call goes on where it was stopped. `progress` None shows a bar on a
    terminal. InputError for anything that cannot be used.
    """
    names, made = named_planners(planner)
    wanted = RunOptions.of(options, names=RUN_KEYWORDS)
    if wanted.workers is None and made:
        _say(f"{', '.join(made)}: only this process knows it, so it drives here, without workers")
        wanted = replace(wanted, workers=0)
    if made and not wanted.who.in_this_process:
        raise InputError(
            f"planner {next(iter(made))!r} exists in this process only, so workers cannot import it; put its class "
            "into a module (mine.py) and give 'mine:Class', or drive in this process with workers=0"
        )
    suite, globs = _chosen(suite, scenarios)
    folder = wanted.out or _temporary_folder() / "run"
    wanted = replace(wanted, planners=tuple(names), suite=suite, scenarios=globs, out=folder)
    here = contextlib.nullcontext() if wanted.who.in_this_process else _main_stays_home()
    with _watching(progress) as watch, here:
        try:
            stored = batch.run(wanted, watch, made=made, command=("interplan_sumo.run", *names))
        except KeyboardInterrupt:
            print(f"stopped; what was done is kept. Go on with the same call and out={str(folder)!r}", file=sys.stderr)
            raise
    return _frame(stored)


RUN_KEYWORDS = tuple(name for name in RunOptions.__match_args__ if name not in ("planners", "suite", "scenarios"))
run.__doc__ = str(run.__doc__).replace("{options}", ", ".join(f"`{name}`" for name in RUN_KEYWORDS))


def load_run(folder: str | PathLike[str]) -> pd.DataFrame:
    """The drives of a run folder, one row each, in the order in which they were asked for.

    Scores are 0 to 1, NaN where there is none; a column per metric with a
    score, NaN where it was not judged. `fault` is the class of the fault and
    `fault_message` what happened, None without one; `reasons` says what cost
    points. `attrs` has run_folder, suite, profile and complete.
    """
    return _frame(read_run(Path(folder)))


def table(*runs: RunLike) -> pd.DataFrame:
    """The paper's table of one or more runs: a line per planner, scores 0 to 100, NaN where rows are missing.

    Columns that no planner has anything for are left out. `attrs` has suite,
    profile, complete, the least_detectable_difference in points and the
    intervals: 95 % bounds by planner and column. RunFolderError if the runs
    cannot stand in one table.
    """
    if not runs:
        raise InputError("table() needs a run: a folder, or what run() returned")
    made = make_table([_stored(each) for each in runs])
    columns = [column for column in made.columns if made.asked(column)]
    rows = [
        {c.title: line.cells[c.key].value for c in columns}
        | {"scenarios": line.scenarios, "seeds": line.seeds, "faults": sum(line.faults.values())}
        for line in made.lines
    ]
    found = pd.DataFrame(rows, index=pd.Index([line.label for line in made.lines], name="planner"))
    titles = [c.title for c in columns]
    found[titles] = found[titles].astype(np.float64)
    span = made.standing.detectable.get(made.standing.column)
    found.attrs = {
        "suite": made.suite,
        "profile": made.profile,
        "complete": made.complete,
        "least_detectable_difference": span and span.middle,
        "intervals": {line.label: {c.title: line.cells[c.key].interval for c in columns} for line in made.lines},
    }
    return found


def compare(
    a: RunLike, b: RunLike, planner_a: str | None = None, planner_b: str | None = None, *, profile: str | None = None
) -> Comparison:
    """One planner of run b against one of run a, paired on equal scenario and seed.

    Under another `profile`, both are scored again first. InputError if it is
    not clear which planners are meant; `compare_all` pairs all common ones.
    """
    found, *more = _compared(a, b, planner_a, planner_b, profile).pairs
    if more:
        raise InputError(f"both runs hold {len(more) + 1} planners; name one as planner_a, or take compare_all(a, b)")
    return found


def compare_all(a: RunLike, b: RunLike, *, profile: str | None = None) -> RunComparison:
    """Every planner that both runs hold, in run b against itself in run a; p values are Holm's over all of them."""
    return _compared(a, b, None, None, profile)


def _compared(
    a: RunLike, b: RunLike, planner_a: str | None, planner_b: str | None, profile: str | None
) -> RunComparison:
    first, second = (_stored(each) if profile is None else _rescored(_stored(each), profile) for each in (a, b))
    return compare_runs(first, second, planner_a, planner_b)


def load_drive(run: RunLike, scenario: str, planner: str | None = None, seed: int = 0) -> StoredDrive:
    """One drive with its scenario, trace, roads and expert; `planner` only where the run holds several.

    UnknownNameError if the run holds no such drive, InputError if it left no trace.
    """
    stored = _stored(run)
    held = stored.planners
    if planner is None and len(held) > 1:
        raise InputError(f"{stored.path} holds {len(held)} planners ({', '.join(held)}); say which: planner=NAME")
    (found,) = StoredDrives(stored).of(scenario, seed, (planner or held[0],))
    return found


def load_trace(run: RunLike, scenario: str, planner: str | None = None, seed: int = 0) -> Trace:
    """The record of one drive: `load_drive(...).trace`."""
    return load_drive(run, scenario, planner, seed).trace


def score(
    drive: StoredDrive | Trace,
    scenario: Scenario | str | None = None,
    *,
    roads: Roads | None = None,
    expert_drive: EgoTrack | None = None,
    profile: str = DEFAULT_PROFILE,
) -> ScoreSheet:
    """The score of a drive under a profile, with every metric's series, without simulating.

    A trace alone needs its `scenario`; map and expert are the scenario's own
    unless they are given.
    """
    if isinstance(drive, StoredDrive):
        return drive.sheet(profile)
    if scenario is None:
        raise InputError("a trace alone does not say what was driven; give its scenario, or a drive of load_drive()")
    staged = load_scenario(scenario) if isinstance(scenario, str) else scenario
    where = load_roads(staged.map, staged.maps_beside) if roads is None else roads
    return score_trace(drive, where, expert(staged) if expert_drive is None else expert_drive, staged, profile)


def scenarios(suite: str | PathLike[str] = DEFAULT_SUITE) -> tuple[Scenario, ...]:
    """The scenarios of a suite, or of a YAML file or a folder that holds one."""
    name = fspath(suite)
    file = scenario_file(name)
    return find_suite(name).scenarios if file is None else read_scenarios(file)


def load_scenario(scenario: str | PathLike[str]) -> Scenario:
    """An official scenario by its id, such as `nudge/3`, or the one of a YAML file."""
    return scenario_named(fspath(scenario))


def replay(drives: StoredDrive | Sequence[StoredDrive], path: str | PathLike[str]) -> Path:
    """Write one drive, or two of one scenario side by side, as an HTML page that plays them; where it is."""
    from interplan_sumo.report.replay.page import write_replay

    write_replay([drives] if isinstance(drives, StoredDrive) else list(drives), Path(path))
    return Path(path)


# --- what users give -----------------------------------------------------------------------------


def _chosen(
    suite: str | None, given: ScenarioLike | Sequence[ScenarioLike] | None
) -> tuple[str | None, tuple[str, ...]]:
    """Suite and scenarios as a request has them.

    Objects that a suite holds unchanged are run as its own; others are written
    to a file, with the maps that came along with them.
    """
    several = isinstance(given, Iterable) and not isinstance(given, str | PathLike)
    wanted: tuple[Any, ...] = () if given is None else tuple(given) if several else (given,)
    for each in wanted:
        if not isinstance(each, str | PathLike | Scenario):
            told = clean_line(repr(each), 80)
            raise InputError(f"scenarios holds {told}; give ids, globs, YAML files or Scenario objects")
    objects = [each for each in wanted if isinstance(each, Scenario)]
    if not objects:
        return suite, tuple(map(fspath, wanted))
    if len(objects) < len(wanted):
        raise InputError("scenarios holds ids and Scenario objects; give one kind, load_scenario(id) makes an object")
    hashes = {each.id: each.hash() for each in objects}
    for key, held in suites().items():
        if suite in (None, key) and hashes.items() <= {each.id: each.hash() for each in held.scenarios}.items():
            return key, tuple(map(glob.escape, hashes))
    file = _temporary_folder() / "scenarios.yaml"
    for files in own_maps(objects):
        copy_map(files, file.parent / MAPS)
    write_scenarios(objects, file)
    return suite, (str(file),)


def _stored(given: RunLike) -> StoredRun:
    if isinstance(given, StoredRun):
        return given
    if isinstance(given, pd.DataFrame):
        if "run_folder" not in given.attrs:
            raise InputError(
                "this DataFrame does not say of which run it is (attrs['run_folder']); give the run folder"
            )
        return read_run(Path(given.attrs["run_folder"]))
    return read_run(Path(given))


def _rescored(run: StoredRun, profile: str) -> StoredRun:
    scored, problems = rescore(run, profile)
    for problem in problems:
        print(f"not scored: {problem}", file=sys.stderr)
    return scored


# --- what users get ------------------------------------------------------------------------------


def _frame(run: StoredRun) -> pd.DataFrame:
    rows, folder = [run.rows[key] for key in run.keys if key in run.rows], run.path.absolute()
    informative = informative_metrics()
    judged = dict.fromkeys(name for row in rows for name in row.metrics if name not in informative)
    columns: dict[str, Iterable[Any]] = {
        "scenario_id": [row.scenario_id for row in rows],
        "family": [row.family for row in rows],
        "planner": [row.planner for row in rows],
        "seed": np.array([row.seed for row in rows], dtype=np.int64),
        "score": _numbers(row.score for row in rows),
        **{name: _numbers(row.metrics[name].score if name in row.metrics else None for row in rows) for name in judged},
        "reached_goal": np.array([row.reached_goal for row in rows], dtype=np.bool_),
        "fault": _texts(row.fault.kind if row.fault else None for row in rows),
        "fault_message": _texts(row.fault.message if row.fault else None for row in rows),
        "reasons": _texts("; ".join(lost_points(row)) for row in rows),
        "official": np.array([row.official for row in rows], dtype=np.bool_),
        "trace": _texts(str(folder / row.trace) if row.trace else None for row in rows),
        "trace_hash": _texts(row.trace_hash for row in rows),
    }
    found = pd.DataFrame(columns)
    found.attrs = {
        "run_folder": str(folder),
        "suite": run.manifest.suite,
        "profile": run.manifest.profile,
        "complete": not run.missing,
    }
    return found


def _numbers(values: Iterable[float | None]) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def _texts(values: Iterable[str | None]) -> pd.Series[Any]:
    return pd.Series(list(values), dtype=object)


# --- surroundings --------------------------------------------------------------------------------


def _temporary_folder() -> Path:
    """A folder that is deleted when Python ends."""
    folder = Path(tempfile.mkdtemp(prefix="interplan-sumo-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@functools.cache
def _say(text: str) -> None:
    """On stderr, each text once."""
    print(text, file=sys.stderr)


def _watching(progress: bool | RunProgress | None) -> contextlib.AbstractContextManager[RunProgress | None]:
    if progress is None:
        progress = sys.stderr.isatty()
    if isinstance(progress, bool):
        return shown_progress(quiet=not progress)
    if not all(callable(getattr(progress, method, None)) for method in ("begin", "finished")):
        told = clean_line(repr(progress), 80)
        raise InputError(f"progress is {told}; give True, False, None, or an object with begin() and finished()")
    return contextlib.nullcontext(progress)


@contextlib.contextmanager
def _main_stays_home() -> Generator[None]:
    """Inside the block, worker processes do not run the user's script: it needs no `if __name__ == "__main__"`."""
    main = vars(sys.modules["__main__"])
    kept = {name: main[name] for name in ("__file__", "__spec__") if name in main}
    main.pop("__file__", None)
    main["__spec__"] = None
    try:
        yield
    finally:
        main.update(kept)
