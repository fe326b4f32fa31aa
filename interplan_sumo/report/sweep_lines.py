"""Sweep lines: what became of the drives for every combination of traffic parameters."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import msgspec

from interplan_sumo.batch.records import JobKey, Row
from interplan_sumo.batch.sweep import Parameter, Result
from interplan_sumo.batch.tracks import PLAIN, TRACK
from interplan_sumo.families import find_family
from interplan_sumo.report.failure_reasons import fault_sentence
from interplan_sumo.statistics.intervals import DIFFERENCES, Range, mean_interval
from interplan_sumo.statistics.scene_values import (
    DriveKey,
    DriveValue,
    DriveValues,
    differences,
    mean_over_scenes,
)

HARD_BRAKING_MPS2 = 4.05
"""Beyond it nuPlan calls braking uncomfortable."""


@dataclass(frozen=True, slots=True)
class Measure:
    """One figure per combination: the mean of something over its drives."""

    key: str
    """In CSV and JSON."""
    title: str
    """On a terminal, as short as can be."""
    label: str
    """In plots, with the unit."""
    value: Callable[[Row], float | None]
    """Of one drive with a score; None where it says nothing about it."""
    limits: Range = (0.0, 100.0)
    """What a drive can have."""
    lower_is_better: bool = False
    highest: bool = False
    """Whether the highest of the drives is worth telling, too."""


def _score(row: Row) -> float:
    return 100.0 * (row.score or 0.0)


def _goal_reached(row: Row) -> float:
    return 0.0 if row.fault else 100.0 * row.reached_goal


def _goal_lane(row: Row) -> float | None:
    """Of lane-change scenarios only: elsewhere hardly anybody misses it."""
    if not find_family(row.family).changes_lanes:
        return None
    detail = _detail(row, "lane_changes")
    return 0.0 if row.fault else None if detail is None else 100.0 * bool(detail["goal"])


def _at_fault(row: Row) -> float | None:
    detail = _detail(row, "no_collision")
    return None if detail is None else 100.0 * (detail["at_fault"] > 0)


def _collisions(row: Row) -> float | None:
    detail = _detail(row, "no_collision")
    return None if detail is None else 100.0 * bool(detail["contacts"])


def _braking_behind(row: Row) -> float | None:
    """0 where nobody behind the ego ever brakes."""
    detail = _detail(row, "diagnostics")
    return None if detail is None else float((detail["braking_behind"] or {}).get("deceleration_mps2", 0.0))


def _hard_braking_behind(row: Row) -> float | None:
    hardest_mps2 = _braking_behind(row)
    return None if hardest_mps2 is None else 100.0 * (hardest_mps2 > HARD_BRAKING_MPS2)


def _detail(row: Row, metric: str) -> dict[str, Any] | None:
    """What a metric found; None where there is none, as after a fault."""
    return row.metrics[metric].detail or None if metric in row.metrics else None


MEASURES = (
    Measure("score", "score", "score (0 to 100)", _score),
    Measure("goal_reached", "goal line %", "goal line passed (% of drives)", _goal_reached),
    Measure("goal_lane", "goal lane %", "goal lane reached (% of lane changes)", _goal_lane),
    Measure("at_fault_collisions", "at fault %", "at-fault collision (% of drives)", _at_fault, lower_is_better=True),
    Measure("collisions", "collision %", "any collision (% of drives)", _collisions, lower_is_better=True),
    Measure(
        "hard_braking_behind",
        "hard braking %",
        "a follower brakes hard (% of drives)",
        _hard_braking_behind,
        lower_is_better=True,
    ),
    Measure(
        "braking_behind_mps2",
        "braking behind",
        "hardest braking behind (m/s²)",
        _braking_behind,
        (0.0, inf),
        highest=True,
    ),
)


@dataclass(frozen=True, slots=True)
class Mean:
    """A measure over the drives of one line."""

    value: float
    interval: Range | None
    """95 %, for scenarios like these (`statistics.intervals`); None for one scenario."""
    scenarios: int
    drives: int
    highest: float


@dataclass(frozen=True, slots=True)
class Change:
    """By how much the score differs from that of the planner in the combination that all others are held against."""

    value: float
    interval: Range | None
    """95 %, paired scene by scene; None for one scenario."""


@dataclass(frozen=True, slots=True)
class SweepLine:
    """One planner in one combination."""

    setting: Mapping[str, str]
    planner: str
    scenarios: int
    seeds: int
    means: Mapping[str, Mean | None]
    """By measure; None where no drive has it, and everywhere where drives are missing: half a mean is none."""
    faults: Mapping[str, int]
    missing: tuple[JobKey, ...]
    asked: int
    figures: frozenset[tuple[str, int, str]]
    """Scenario, seed and a hash of everything that was measured of its drives, but with a clock."""
    scores: DriveValues
    """Points of each drive; none where drives are missing."""
    failure: str | None = None
    """Why drives are missing, where it is known."""
    change: Change | None = None
    """None for the reference itself, and where drives are missing."""

    @property
    def name(self) -> str:
        """`KEY=VALUE, KEY=VALUE, PLANNER`."""
        return ", ".join([*(f"{key}={value}" for key, value in self.setting.items()), self.planner])

    @property
    def complete(self) -> bool:
        return not self.missing


def sweep_lines(results: Sequence[Result]) -> list[SweepLine]:
    """A line per combination and planner, in the order of the sweep."""
    lines = [
        _line(result, planner)
        for result in results
        for planner in dict.fromkeys(planner for _, planner, _ in result.combination.keys)
    ]
    reference = reference_setting(lines)
    before = {line.planner: line.scores for line in lines if line.setting == reference}
    return [
        line if line.setting == reference else replace(line, change=_change(before.get(line.planner, {}), line.scores))
        for line in lines
    ]


def reference_setting(lines: Sequence[SweepLine]) -> Mapping[str, str]:
    """What all others are held against: the first value of each parameter, of tracks the plain one."""
    first = lines[0].setting
    plain = {key: PLAIN if key == TRACK else value for key, value in first.items()}
    return plain if any(line.setting == plain for line in lines) else first


def _change(before: DriveValues, after: DriveValues) -> Change | None:
    paired = differences(before, after)
    value = mean_over_scenes(paired)
    return None if value is None else Change(value, mean_interval(paired, DIFFERENCES))


def _line(result: Result, planner: str) -> SweepLine:
    keys = [key for key in result.combination.keys if key[1] == planner]
    runs = {key: run for run in result.runs for key in run.rows}
    missing = tuple(key for key in result.missing if key[1] == planner)
    figures: set[tuple[str, int, str]] = set()
    values: dict[str, dict[DriveKey, DriveValue]] = {measure.key: {} for measure in MEASURES}
    faults: Counter[str] = Counter()
    first_failure: str | None = None
    for key in keys:
        if key not in runs:
            continue
        row = runs[key].rows[key]
        figures.add((key[0], key[2], _figures_of(row)))
        if row.fault:
            faults[row.fault.kind] += 1
        if row.score is None:
            first_failure = first_failure or fault_sentence(row)
            continue
        for measure in MEASURES:
            value = measure.value(row)
            if value is not None:
                values[measure.key][key[0], key[2]] = DriveValue(row.family, value, row.site)
    return SweepLine(
        setting=result.combination.setting,
        planner=planner,
        scenarios=len({scenario for scenario, _, _ in keys}),
        seeds=len({seed for _, _, seed in keys}),
        means={measure.key: None if missing else _mean(measure, values[measure.key]) for measure in MEASURES},
        faults=dict(sorted(faults.items())),
        missing=missing,
        asked=len(keys),
        figures=frozenset(figures),
        scores={} if missing else values["score"],
        failure=result.failure or first_failure,
    )


def _figures_of(row: Row) -> str:
    """A hash of all figures of a drive; of the diagnostics, which time the planner, only what is a measure here.

    Trace hashes would not do: a trace holds the names of the vehicle types, and so of their file.
    """
    metrics = {name: metric for name, metric in row.metrics.items() if name != "diagnostics"}
    text = msgspec.json.encode([row.score, row.fault, metrics, _braking_behind(row)], order="sorted")
    return hashlib.sha256(text).hexdigest()


def _mean(measure: Measure, drives: DriveValues) -> Mean | None:
    """The mean over the scenarios of the mean over the seeds."""
    value = mean_over_scenes(drives)
    if value is None:
        return None
    return Mean(
        value=value,
        interval=mean_interval(drives, measure.limits),
        scenarios=len({scenario for scenario, _ in drives}),
        drives=len(drives),
        highest=max(drive.value for drive in drives.values()),
    )


def idle_parameters(parameters: Sequence[Parameter], lines: Sequence[SweepLine]) -> list[str]:
    """Keys whose values all gave the same figures for every drive, whatever the others were."""
    idle: list[str] = []
    for parameter in parameters:
        groups: dict[tuple[object, ...], set[frozenset[tuple[str, int, str]]]] = {}
        for line in lines:
            others = tuple((key, value) for key, value in line.setting.items() if key != parameter.key)
            groups.setdefault((line.planner, others), set()).add(line.figures)
        same = all(len(figures) == 1 for figures in groups.values())
        if same and len(parameter.values) > 1 and all(line.complete for line in lines):
            idle.append(parameter.key)
    return idle
