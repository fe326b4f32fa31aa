"""Sweep table: what became of the drives for every combination of traffic parameters."""

from __future__ import annotations

import csv
import hashlib
import io
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table as Grid
from rich.text import Text

from interplan_sumo.batch.records import JobKey, Row
from interplan_sumo.batch.sweep import Parameter, Result
from interplan_sumo.families import find_family
from interplan_sumo.report.compare import mean_interval
from interplan_sumo.report.failure_reasons import fault_sentence

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
    return 0.0 if row.fault else 100.0 * bool(row.metrics["lane_changes"].detail["goal"])


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
    Measure("at_fault_collisions", "at fault %", "at-fault collision (% of drives)", _at_fault),
    Measure("collisions", "collision %", "any collision (% of drives)", _collisions),
    Measure("hard_braking_behind", "hard braking %", "a follower brakes hard (% of drives)", _hard_braking_behind),
    Measure("braking_behind_mps2", "braking behind", "hardest braking behind (m/s²)", _braking_behind, highest=True),
)


@dataclass(frozen=True, slots=True)
class Mean:
    """A measure over the drives of one line."""

    value: float
    interval: tuple[float, float] | None
    """95 % of the bootstrap means when scenarios, or the seeds of a single one, are drawn again; None for one drive."""
    drives: int
    highest: float


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
    failure: str | None = None
    """Why drives are missing, where it is known."""

    @property
    def complete(self) -> bool:
        return not self.missing


def sweep_lines(results: Sequence[Result]) -> list[SweepLine]:
    """A line per combination and planner, in the order of the sweep."""
    return [
        _line(result, planner)
        for result in results
        for planner in dict.fromkeys(planner for _, planner, _ in result.combination.keys)
    ]


def _line(result: Result, planner: str) -> SweepLine:
    keys = [key for key in result.combination.keys if key[1] == planner]
    runs = {key: run for run in result.runs for key in run.rows}
    missing = tuple(key for key in result.missing if key[1] == planner)
    figures: set[tuple[str, int, str]] = set()
    values: dict[str, dict[str, list[float]]] = {measure.key: {} for measure in MEASURES}
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
                values[measure.key].setdefault(key[0], []).append(value)
    return SweepLine(
        setting=result.combination.setting,
        planner=planner,
        scenarios=len({scenario for scenario, _, _ in keys}),
        seeds=len({seed for _, _, seed in keys}),
        means={measure.key: None if missing else _mean(values[measure.key]) for measure in MEASURES},
        faults=dict(sorted(faults.items())),
        missing=missing,
        asked=len(keys),
        figures=frozenset(figures),
        failure=result.failure or first_failure,
    )


def _figures_of(row: Row) -> str:
    """A hash of all figures of a drive; of the diagnostics, which time the planner, only what is a measure here.

    Trace hashes would not do: a trace holds the names of the vehicle types, and so of their file.
    """
    metrics = {name: metric for name, metric in row.metrics.items() if name != "diagnostics"}
    text = msgspec.json.encode([row.score, row.fault, metrics, _braking_behind(row)], order="sorted")
    return hashlib.sha256(text).hexdigest()


def _mean(by_scenario: Mapping[str, Sequence[float]]) -> Mean | None:
    """The mean over the scenarios of the mean over the seeds."""
    if not by_scenario:
        return None
    single = len(by_scenario) == 1
    means = np.array([np.mean(found) for found in by_scenario.values()], dtype=np.float64)
    every = np.array([each for found in by_scenario.values() for each in found], dtype=np.float64)
    return Mean(float(means.mean()), mean_interval(every if single else means), len(every), float(every.max()))


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


def sweep_json(lines: Sequence[SweepLine]) -> list[dict[str, Any]]:
    """The lines as plain data; null where there is no figure."""
    return [
        {
            "setting": dict(line.setting),
            "planner": line.planner,
            "scenarios": line.scenarios,
            "seeds": line.seeds,
            "drives": line.asked - len(line.missing),
            "complete": line.complete,
            "measures": {measure.key: _mean_json(measure, line.means[measure.key]) for measure in MEASURES},
            "faults": dict(line.faults),
            "missing": [{"scenario_id": scenario, "seed": seed} for scenario, _, seed in line.missing],
            "failure": line.failure,
        }
        for line in lines
    ]


def _mean_json(measure: Measure, mean: Mean | None) -> dict[str, Any] | None:
    if mean is None:
        return None
    interval = None if mean.interval is None else [round(bound, 4) for bound in mean.interval]
    highest = {"max": round(mean.highest, 4)} if measure.highest else {}
    return {"mean": round(mean.value, 4), "interval": interval, **highest, "drives": mean.drives}


def sweep_csv(lines: Sequence[SweepLine]) -> str:
    """One row per line, empty where there is no figure; `_low` and `_high` bound the 95 % interval of a mean.

    Holds nothing that was measured with a clock: equal sweeps give equal bytes.
    """
    text = io.StringIO()
    keys = list(lines[0].setting)
    titles = [f"{measure.key}{end}" for measure in MEASURES for end in _ends(measure)]
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*keys, "planner", "scenarios", "seeds", "drives", "missing", *titles, "faults"])
    for line in lines:
        figures = [figure for measure in MEASURES for figure in _figures(measure, line.means[measure.key])]
        counts = [line.scenarios, line.seeds, line.asked - len(line.missing), len(line.missing)]
        faults = " ".join(f"{name}:{count}" for name, count in line.faults.items())
        writer.writerow([*line.setting.values(), line.planner, *counts, *figures, faults])
    return text.getvalue()


def _ends(measure: Measure) -> tuple[str, ...]:
    return ("", "_low", "_high", "_max") if measure.highest else ("", "_low", "_high")


def _figures(measure: Measure, mean: Mean | None) -> list[str]:
    values: tuple[float | None, ...] = (None,) * 4
    if mean is not None:
        values = (mean.value, *(mean.interval or (None, None)), mean.highest)
    return ["" if value is None else f"{value:.4f}" for value in values[: len(_ends(measure))]]


def sweep_text(parameters: Sequence[Parameter], lines: Sequence[SweepLine]) -> RenderableType:
    """The table for a terminal, and below it what did not work."""
    shown = [measure for measure in MEASURES if any(line.means[measure.key] for line in lines)]
    grid = Grid(header_style="bold")
    for parameter in parameters:
        grid.add_column(Text(parameter.key), justify="right")
    grid.add_column("planner")
    for title in ("drives", *(measure.title for measure in shown), "faults"):
        grid.add_column(title, justify="right")
    for line in lines:
        cells = [_cell(measure, line.means[measure.key]) for measure in shown]
        drives = f"{line.asked - len(line.missing)}" + (f" of {line.asked}" if line.missing else "")
        faults = ", ".join(f"{count} {name}" for name, count in line.faults.items()) or "-"
        grid.add_row(*map(Text, (*line.setting.values(), line.planner, drives, *cells, faults)))
    parts: list[RenderableType] = [
        grid,
        Text(
            "Means over the scenarios; brackets: 95 % bootstrap interval of the score, scenarios drawn again. Hard "
            f"braking: a follower of the ego brakes harder than {HARD_BRAKING_MPS2} m/s². Braking behind: the hardest "
            "braking of a follower, m/s², mean over the drives (highest)."
        ),
    ]
    parts += [
        Text(f"{key} makes no difference: no figure of any drive depends on it.")
        for key in idle_parameters(parameters, lines)
    ]
    incomplete = [line for line in lines if line.missing]
    for line in incomplete:
        name = ", ".join(f"{key}={value}" for key, value in line.setting.items())
        first = ", ".join(f"{scenario} seed {seed}" for scenario, _, seed in line.missing[:3])
        more = f" and {len(line.missing) - 3} more" if len(line.missing) > 3 else ""
        why = f": {line.failure}" if line.failure else ""
        parts.append(Text(f"no score: {name}, {line.planner}, {first}{more}{why}"))
    if incomplete:
        parts.append(Text("INCOMPLETE: repeat the command to do what is missing."))
    return Group(*parts)


def _cell(measure: Measure, mean: Mean | None) -> str:
    if mean is None:
        return "-"
    if measure.highest:
        return f"{mean.value:.1f} ({mean.highest:.1f})"
    if measure.key != "score":
        return f"{mean.value:.0f}"
    return f"{mean.value:.1f}" + ("" if mean.interval is None else " [{:.0f}, {:.0f}]".format(*mean.interval))
