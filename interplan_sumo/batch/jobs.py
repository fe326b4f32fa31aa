"""Jobs: which drives a run consists of, and what is changed in their scenarios."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from interplan_sumo.batch.options import RunOptions
from interplan_sumo.batch.overrides import Overrides
from interplan_sumo.batch.records import JobKey
from interplan_sumo.errors import InputError, UnknownNameError
from interplan_sumo.maps.store import MapFiles, find_map
from interplan_sumo.scenario.files import is_scenario_file, read_scenario, read_scenarios
from interplan_sumo.scenario.scenario import Scenario
from interplan_sumo.scenario.suite import DEFAULT_SUITE, SCENARIOS, Suite, find_scenario, find_suite


@dataclass(frozen=True, slots=True)
class Job:
    """One drive: a scenario (with overrides applied), a planner and a seed."""

    scenario: Scenario
    planner: str
    """As given on the command line, options included."""
    seed: int

    @property
    def key(self) -> JobKey:
        return (self.scenario.id, self.planner, self.seed)


@dataclass(frozen=True, slots=True)
class ScenarioSource:
    """Where the scenarios of a run come from."""

    name: str
    """`name==version` of a suite, or the names of files."""
    hash: str
    """Over the scenarios, and the maps that came along with them."""
    scenarios: tuple[Scenario, ...]
    official: bool

    @classmethod
    def of(cls, suite: str | None, files: Sequence[str]) -> ScenarioSource:
        """A suite (the default one for None), or the scenarios of files; InputError if both are given."""
        if not files:
            found = find_suite(suite or DEFAULT_SUITE)
            return cls(found.key, found.hash(), found.scenarios, official=True)
        if suite is not None:
            raise InputError(f"--suite {suite} and the file {files[0]} are two sources of scenarios; give one of them")
        lines: dict[str, str] = {}
        scenarios: list[Scenario] = []
        for file in dict.fromkeys(files):
            for scenario in read_scenarios(file):
                if lines.setdefault(scenario.id, file) != file:
                    raise InputError(f"{file}: {lines[scenario.id]} holds a scenario {scenario.id}, too; rename one")
                scenarios.append(scenario)
        name = ", ".join(Path(file).name for file in dict.fromkeys(files))
        own = own_maps(scenarios)
        parts = [Suite(name, 0, tuple(scenarios)).hash(), *(f"{each.name} {each.hash()}" for each in own)]
        digest = hashlib.sha256("\n".join(parts).encode()).hexdigest() if own else parts[0]
        return cls(name, digest, tuple(scenarios), official=False)


def own_maps(scenarios: Iterable[Scenario]) -> tuple[MapFiles, ...]:
    """The maps that came along with the scenarios' files, by name; InputError if two have one name."""
    found: dict[str, MapFiles] = {}
    for scenario in scenarios:
        beside = scenario.maps_beside
        if beside is None or not (files := find_map(scenario.map, beside)).folder.is_relative_to(beside):
            continue
        other = found.setdefault(files.name, files)
        if other.folder != files.folder and other.hash() != files.hash():
            raise InputError(f"{other.folder} and {files.folder} are two maps of one name; run their scenarios apart")
    return tuple(found[name] for name in sorted(found))


def scenario_file(text: str) -> str | None:
    """The scenario file that somebody means, by its name or by that of the folder it lies in; None for an id."""
    inside = Path(text) / SCENARIOS
    if inside.is_file():
        return str(inside)
    return text if is_scenario_file(text) else None


def scenario_named(text: str) -> Scenario:
    """An official scenario by its id, or the one of a file."""
    file = scenario_file(text)
    return find_scenario(text) if file is None else read_scenario(file)


def split_files(given: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What `--scenarios` was given, as files and globs."""
    found = [(each, scenario_file(each)) for each in given]
    return tuple(file for _, file in found if file is not None), tuple(each for each, file in found if file is None)


@dataclass(frozen=True, slots=True)
class Selection:
    """The scenarios that options ask for, as they are told of: nothing is overridden yet."""

    source: ScenarioSource
    files: tuple[str, ...]
    """Those of one's own among what was asked for."""
    scenarios: tuple[Scenario, ...]

    @classmethod
    def of(cls, options: RunOptions) -> Selection:
        """InputError for a suite, file or id that is not there."""
        files, globs = split_files(options.scenarios)
        source = ScenarioSource.of(options.suite, files)
        return cls(source, files, chosen(source.scenarios, globs, options.limit))


def chosen(scenarios: Sequence[Scenario], globs: Sequence[str], limit: int | None = None) -> tuple[Scenario, ...]:
    """The scenarios whose ids match any of the globs (all, without globs), in suite order, at most `limit`.

    UnknownNameError for a glob that matches none.
    """
    wanted = matching([s.id for s in scenarios], globs, "scenario", "List them: interplan-sumo scenarios list")
    return tuple([s for s in scenarios if s.id in wanted][:limit])


def matching(ids: Collection[str], globs: Sequence[str], what: str, hint: str = "") -> set[str]:
    """The ids that match any of the globs (all, without globs); UnknownNameError for a glob that matches none."""
    for glob in globs:
        if not any(fnmatchcase(each, glob) for each in ids):
            raise UnknownNameError(what, glob, ids, hint)
    return {each for each in ids if not globs or any(fnmatchcase(each, glob) for glob in globs)}


def interleaved(jobs: Sequence[Job]) -> list[Job]:
    """The jobs in an order every beginning of which resembles the whole: seeds, families and planners take turns."""
    families: dict[str, dict[str, int]] = {}
    for job in jobs:
        within = families.setdefault(job.scenario.family, {})
        within.setdefault(job.scenario.id, len(within))
    turns = {family: number for number, family in enumerate(families)}
    return sorted(
        jobs, key=lambda job: (job.seed, families[job.scenario.family][job.scenario.id], turns[job.scenario.family])
    )


def jobs_for(
    scenarios: Sequence[Scenario], planners: Sequence[str], seeds: int, overrides: Overrides | None = None
) -> tuple[Job, ...]:
    """Every planner on every scenario with every seed 0 ... `seeds` - 1; each job once."""
    changed = [overrides.applied(s) if overrides else s for s in scenarios]
    return tuple(
        Job(scenario, planner, seed)
        for planner in dict.fromkeys(planners)
        for scenario in changed
        for seed in range(seeds)
    )
