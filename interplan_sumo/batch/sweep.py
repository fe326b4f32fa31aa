"""Sweep: one run per combination of parameters, each in a run folder of its own below one folder.

| place | what |
|---|---|
| KEY=VALUE,KEY=VALUE/ | the run folder of a combination |
| KEY=VALUE,.../PART/ | instead, where scenarios use several vehicle-type files or perceptions that are changed |
| traffic/ | the changed vehicle-type files |
"""

from __future__ import annotations

import glob
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import isfinite
from pathlib import Path
from typing import Any

from interplan_sumo.batch.jobs import Selection
from interplan_sumo.batch.options import DENSITIES, SETTINGS, RunOptions
from interplan_sumo.batch.records import JobKey, RequestedJobs, keys_of
from interplan_sumo.batch.run import RunProgress, check_inputs, run
from interplan_sumo.batch.run_folder import MANIFEST, TRAFFIC, StoredRun, read_run
from interplan_sumo.batch.tracks import PLAIN, TRACK, TRACKS, track_settings
from interplan_sumo.batch.traffic_files import Edit, changed_name, write_changed
from interplan_sumo.errors import InputError, RunFolderError, UnknownNameError
from interplan_sumo.planner import RECOMMENDED, find_planner
from interplan_sumo.scenario.scenario import Scenario, perception_named
from interplan_sumo.simulation.vehicle_types import vehicle_type_file

TYPICAL_S = 5.0
"""A drive of half a minute with a rule-based planner on one core, loading included: the guess before any was timed."""
VALUE = re.compile(r"[A-Za-z0-9_.+-]+")
"""Values become parts of folder names."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """What is varied, and its values in the order given."""

    key: str
    """`density`, `behaviour`, `perception`, `track`, a vType attribute or `interplan.*` parameter, or one of a single
    type: `TYPE.KEY`."""
    values: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Parameter:
        """From `KEY=V1,V2,...`; InputError for an unknown key, a value that cannot be, or one given twice."""
        key, equals, listed = text.partition("=")
        values = tuple(listed.split(","))
        if not equals or not all(values):
            raise InputError(f"--param {text!r} has no values; write KEY=V1,V2, such as interplan.reactOverlap=0,0.5,1")
        for number, value in enumerate(values):
            if not VALUE.fullmatch(value):
                raise InputError(f"--param {key}: {value!r} is no value; numbers and plain words are")
            if any(_same(value, other) for other in values[:number]):
                raise InputError(f"--param {key} gives {value} twice; give each value once")
            _check_value(key, value)
        return cls(key, values)

    @property
    def settings(self) -> set[str]:
        """The options of a run that it changes; none for vehicle types."""
        if self.key == TRACK:
            return {changed for value in self.values if (changed := TRACKS[value]) is not None}
        return {self.key} & {*SETTINGS}


def _check_value(key: str, value: str) -> None:
    """InputError for a value that the key cannot have."""
    known = {"density": DENSITIES, TRACK: tuple(TRACKS)}.get(key)
    if known is not None and value not in known:
        raise UnknownNameError(key, value, known)
    if key == "behaviour":
        vehicle_type_file(value)
    elif key == "perception":
        if (named := perception_named(value)) != value:
            raise InputError(f"--param perception: {value} is called {named}")
    elif known is None:
        Edit.of(key, value)


def _same(a: str, b: str) -> bool:
    """Whether two values mean the same: 0.5 and 0.50."""
    first, second = as_number(a), as_number(b)
    return a == b if first is None or second is None else first == second


def as_number(value: str) -> float | None:
    """A value as a finite number; None for a word."""
    try:
        number = float(value)
    except ValueError:
        return None
    return number if isfinite(number) else None


@dataclass(frozen=True, slots=True)
class SweepRun:
    """A run that a combination takes, and its drives."""

    options: RunOptions
    scenarios: tuple[str, ...]
    """Ids."""

    @property
    def folder(self) -> Path:
        return self.options.out or Path()

    @property
    def asked(self) -> RequestedJobs:
        """The request as a manifest has it."""
        return RequestedJobs(self.options.planners or (RECOMMENDED,), self.scenarios, self.options.seeds)

    @property
    def keys(self) -> list[JobKey]:
        return keys_of([self.asked])


@dataclass(frozen=True, slots=True)
class Combination:
    """One value of every parameter."""

    setting: dict[str, str]
    parts: tuple[SweepRun, ...]
    """One run; several where parts of the scenarios need options of their own."""

    @property
    def name(self) -> str:
        """As its folder is called: `density=high,tau=1.5`."""
        return folder_name(self.setting)

    @property
    def keys(self) -> list[JobKey]:
        """Its drives."""
        return [key for part in self.parts for key in part.keys]


def folder_name(setting: Mapping[str, str]) -> str:
    """`KEY=VALUE,KEY=VALUE`."""
    return ",".join(f"{key}={value}" for key, value in setting.items())


@dataclass(frozen=True, slots=True)
class Sweep:
    """What is to be done."""

    folder: Path
    parameters: tuple[Parameter, ...]
    combinations: tuple[Combination, ...]
    unchanged: tuple[str, ...]
    """Ids of scenarios in which nobody drives but the ego and who was recorded, where only the traffic is varied."""

    @property
    def drives(self) -> int:
        return sum(len(combination.keys) for combination in self.combinations)


@dataclass(frozen=True, slots=True)
class Result:
    """What came of one combination."""

    combination: Combination
    runs: tuple[StoredRun, ...]
    """Exactly the drives of this sweep, though a folder may hold others."""
    failure: str | None = None
    """Why it could not be run at all."""

    @property
    def missing(self) -> list[JobKey]:
        """Drives without a score."""
        scored = {key for each in self.runs for key, brief in each.briefs.items() if brief.score is not None}
        return [key for key in self.combination.keys if key not in scored]


def plan_sweep(options: RunOptions, parameters: Sequence[Parameter]) -> Sweep:
    """Work out every combination, write the changed vehicle-type files and check all inputs.

    `options` say what each run has in common, overrides included; their folder
    becomes that of the sweep. InputError for anything that cannot be used.
    """
    if not parameters:
        raise InputError("nothing to vary; name it with --param, such as --param interplan.reactOverlap=0,0.5,1")
    folder = _check_agree(options, parameters)
    for spec in options.planners:
        find_planner(spec)
    selection = Selection.of(options)
    scenarios = selection.scenarios
    settings = [
        dict(zip((parameter.key for parameter in parameters), values, strict=True))
        for values in product(*(parameter.values for parameter in parameters))
    ]
    combinations = tuple(
        Combination(setting, tuple(_parts(options, folder, setting, selection))) for setting in settings
    )
    for overrides in {part.options.overrides for combination in combinations for part in combination.parts}:
        check_inputs([overrides.applied(scenario) for scenario in scenarios], overrides.vehicle_types)
    of_traffic = all("perception" not in parameter.settings for parameter in parameters)
    without = [each.id for each in scenarios if of_traffic and (each.replayed or not each.has_traffic)]
    return Sweep(folder, tuple(parameters), combinations, tuple(without))


def _check_agree(options: RunOptions, parameters: Sequence[Parameter]) -> Path:
    """The sweep's folder; InputError for what is asked twice, and for a folder that is a run's."""
    if options.out is None:
        raise InputError("no folder for the sweep given; name one with --out")
    if options.shard is not None:
        raise InputError(f"--shard {options.shard} splits a run, not a sweep; give each machine values of its own")
    varied: dict[str, str] = {}
    for parameter in parameters:
        key = parameter.key
        if key in [other.key for other in parameters if other is not parameter]:
            raise InputError(f"--param {key} is given twice; give all its values at once: {key}=V1,V2,...")
        for setting in sorted(parameter.settings):
            if getattr(options, setting) is not None:
                raise InputError(f"--set {setting} fixes what --param {key} varies; give only one")
            if setting == "behaviour" and options.traffic is not None:
                raise InputError(f"--traffic replaces the vehicle types that --param {key} varies; give only one")
            if (other := varied.setdefault(setting, key)) != key:
                raise InputError(f"--param {other} and --param {key} both vary {setting}; give only one")
    if (options.out / MANIFEST).exists():
        raise RunFolderError(f"{options.out} holds a run; give another folder as --out")
    return options.out


def _parts(options: RunOptions, sweep: Path, setting: Mapping[str, str], selection: Selection) -> Iterator[SweepRun]:
    """The runs of one combination: one, or one for each part of the scenarios that needs options of its own."""
    folder = sweep / folder_name(setting)
    fixed = {key: value for key, value in setting.items() if key in SETTINGS}
    changes = {key: value for key, value in setting.items() if key not in SETTINGS and key != TRACK}
    edits = [Edit.of(key, value) for key, value in changes.items()]
    files: dict[Path, Path] = {}
    parts: dict[str, tuple[RunOptions, list[Scenario]]] = {}
    for scenario in selection.scenarios:
        of_track = track_settings(setting.get(TRACK, PLAIN), scenario)
        given: dict[str, Any] = fixed | of_track
        own, name = replace(options, **given), [*of_track.values()]
        if edits:
            source = own.traffic or vehicle_type_file(own.behaviour or scenario.traffic.behaviour)
            if source not in files:
                files[source] = sweep / TRAFFIC / changed_name(source, changes)
                write_changed(source, edits, files[source])
            own, name = replace(own, behaviour=None, traffic=files[source]), [*name, source.stem]
        parts.setdefault(",".join(name), (own, []))[1].append(scenario)
    for name, (own, members) in parts.items():
        yield _part(own, folder / name if len(parts) > 1 else folder, members, selection.files)


def _part(options: RunOptions, folder: Path, scenarios: Sequence[Scenario], files: Sequence[str]) -> SweepRun:
    ids = tuple(scenario.id for scenario in scenarios)
    chosen = (*files, *map(glob.escape, ids))
    return SweepRun(replace(options, out=folder, scenarios=chosen, limit=None), ids)


def run_combination(combination: Combination, watch: RunProgress | None = None, command: Sequence[str] = ()) -> Result:
    """Do what its folders do not hold yet. What cannot be run is in the result: the next combination may do."""
    runs: list[StoredRun] = []
    for part in combination.parts:
        try:
            stored = run(part.options, watch, command=command)
        except InputError as error:
            return Result(combination, tuple(runs), str(error))
        runs.append(stored.narrowed(part.asked))
    return Result(combination, tuple(runs))


@dataclass(frozen=True, slots=True)
class Estimate:
    """How long a sweep will take."""

    drives: int
    """Still to be done."""
    drive_s: float
    timed: bool
    """Whether drives of this sweep were timed; else it is a guess."""
    workers: int

    @property
    def wall_s(self) -> float:
        return self.drives * self.drive_s / max(self.workers, 1)


def estimate(sweep: Sweep, workers: int) -> Estimate:
    """What is left to do, and how long that takes by the drives that the sweep's folders hold already."""
    times_s: list[float] = []
    left = 0
    for part in (part for combination in sweep.combinations for part in combination.parts):
        briefs = read_run(part.folder).briefs if (part.folder / MANIFEST).is_file() else {}
        done = [briefs[key] for key in part.keys if key in briefs and briefs[key].score is not None]
        left += len(part.keys) - len(done)
        times_s += [brief.total_s for brief in done if brief.total_s is not None]
    return Estimate(left, sum(times_s) / len(times_s) if times_s else TYPICAL_S, bool(times_s), workers)
