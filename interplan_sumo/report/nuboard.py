"""nuBoard: the drives of runs as the files that nuPlan's viewer opens. Needs nothing of nuPlan.

`<folder>/interplan-sumo.nuboard`, `metrics/<name>.parquet` with a row per
scenario and planner, and `aggregator_metric/<name>.parquet` with the scores.
Names of metrics are nuPlan's and interPlan's. Its overview and histograms need
no more; its scenario tab would need Python objects of nuPlan, which are not written.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from interplan_sumo.batch.records import MetricRecord, Row
from interplan_sumo.batch.run_folder import StoredRun
from interplan_sumo.errors import InputError
from interplan_sumo.report.table import ResultsTable, make_table
from interplan_sumo.world.files import writing

FILE: Final = "interplan-sumo.nuboard"
METRICS: Final = "metrics"
AGGREGATED: Final = "aggregator_metric"
FINAL: Final = "final_score"
"""The row of a planner's score over everything; nuBoard looks for this name."""

Kind = Literal["BOOLEAN", "COUNT", "MAX", "MIN", "MEAN", "P90", "RATIO", "VALUE"]
"""nuPlan's types of statistics."""


@dataclass(frozen=True, slots=True)
class Statistic:
    """One figure behind a metric, with histograms of its own."""

    name: str
    kind: Kind
    unit: str
    value: Callable[[MetricRecord], float | bool | None]


@dataclass(frozen=True, slots=True)
class NuBoardMetric:
    """One file of metrics: what it is called there, which of our metrics it comes from, and what stands in it."""

    name: str
    source: str
    statistics: tuple[Statistic, ...]
    has_score: bool = True
    category: str = "Planning"


def _score(found: MetricRecord) -> float | None:
    return found.score


def _full(found: MetricRecord) -> bool | None:
    return None if found.score is None else found.score >= 1.0


def _detail(*keys: str, missing: float | None = None) -> Callable[[MetricRecord], float | bool | None]:
    """A figure of the detail; `missing` stands in where it has none."""

    def value(found: MetricRecord) -> float | bool | None:
        at: Any = found.detail
        for key in keys:
            at = at.get(key) if isinstance(at, Mapping) else None
        return missing if at is None else at

    return value


def _comfort(name: str, key: str, unit: str) -> NuBoardMetric:
    """A signal of comfort."""
    return NuBoardMetric(
        name,
        "comfort",
        (
            Statistic(f"max_{name}", "MAX", unit, _detail(key, "max")),
            Statistic(f"min_{name}", "MIN", unit, _detail(key, "min")),
            Statistic(f"avg_{name}", "MEAN", unit, _detail(key, "mean")),
            Statistic(f"p90_{name}", "P90", unit, _detail(key, "p90")),
            Statistic(f"abs_{name}_within_bounds", "BOOLEAN", "boolean", _detail(key, "within")),
        ),
        has_score=False,
        category="Dynamics",
    )


FAULTS: Final = "number_of_at_fault_collisions_with"
PROGRESS: Final = "progress_along_route"
WRONG_WAY: Final = "min_progress_along_driving_direction_in_1_second_interval"
# fmt: off
EXPORTED: Final[tuple[NuBoardMetric, ...]] = (
    NuBoardMetric("no_ego_at_fault_collisions", "no_collision", (
        Statistic("no_ego_at_fault_collisions", "BOOLEAN", "boolean", _full),
        Statistic("number_of_all_at_fault_collisions", "COUNT", "count", _detail("at_fault")),
        Statistic(f"{FAULTS}_VRUs", "COUNT", "count", _detail("at_fault_with", "vru")),
        Statistic(f"{FAULTS}_vehicles", "COUNT", "count", _detail("at_fault_with", "vehicle")),
        Statistic(f"{FAULTS}_objects", "COUNT", "count", _detail("at_fault_with", "object")),
    ), category="Violations"),
    NuBoardMetric("drivable_area_compliance", "drivable_area", (
        Statistic("drivable_area_compliance", "BOOLEAN", "boolean", _full),
    ), category="Violations"),
    NuBoardMetric("corners_in_drivable_area", "drivable_area", (
        Statistic("corners_in_drivable_area", "BOOLEAN", "boolean", _detail("all_corners_inside")),
    ), has_score=False),
    NuBoardMetric("ego_is_making_progress", "making_progress", (
        Statistic("ego_is_making_progress", "BOOLEAN", "boolean", _full),
    )),
    NuBoardMetric("driving_direction_compliance", "driving_direction", (
        Statistic("driving_direction_compliance_score", "VALUE", "value", _score),
        Statistic(WRONG_WAY, "MIN", "meters", _detail("lowest_progress_m")),
    )),
    NuBoardMetric("obstacle_passed", "obstacle_passed", (
        Statistic("obstacle_passed", "BOOLEAN", "boolean", _full),
    )),
    NuBoardMetric("ego_progress_along_expert_route", "progress", (
        Statistic(f"expert_total_{PROGRESS}", "VALUE", "meters", _detail("expert_m")),
        Statistic(f"ego_total_{PROGRESS}", "VALUE", "meters", _detail("ego_m")),
        Statistic("ego_expert_progress_along_route_ratio", "RATIO", "ratio", _detail("ratio")),
    )),
    NuBoardMetric("time_to_collision_within_bound", "time_to_collision", (
        Statistic("min_time_to_collision", "MIN", "seconds", _detail("least_s", missing=math.inf)),
        Statistic("time_to_collision_within_bound", "BOOLEAN", "boolean", _full),
    )),
    NuBoardMetric("lane_changes_to_goal", "lane_changes", (
        Statistic("lane_changes_to_goal", "VALUE", "value", _score),
        Statistic("did_ego_got_to_goal_lane", "BOOLEAN", "boolean", _detail("goal")),
    )),
    NuBoardMetric("speed_limit_compliance", "speed_limit", (
        Statistic("speed_limit_compliance", "BOOLEAN", "boolean", _full),
        Statistic("number_of_violations_of_speed_limit_compliance", "COUNT", "count", _detail("violations")),
    ), category="Violations"),
    NuBoardMetric("ego_is_comfortable", "comfort", (Statistic("ego_is_comfortable", "BOOLEAN", "boolean", _full),)),
    _comfort("ego_lon_acceleration", "longitudinal_acceleration_mps2", "meters_per_second_squared"),
    _comfort("ego_lat_acceleration", "lateral_acceleration_mps2", "meters_per_second_squared"),
    _comfort("ego_jerk", "jerk_mps3", "meters_per_second_cubed"),
    _comfort("ego_lon_jerk", "longitudinal_jerk_mps3", "meters_per_second_cubed"),
    _comfort("ego_yaw_rate", "yaw_rate_radps", "radians_per_second"),
    _comfort("ego_yaw_acceleration", "yaw_acceleration_radps2", "radians_per_second_squared"),
    NuBoardMetric("ego_lane_change", "lane_crossings", (
        Statistic("number_of_ego_lane_change", "COUNT", "count", _detail("count")),
        Statistic("ego_lane_change_fail_rate_below_threshold", "BOOLEAN", "boolean", _detail("failed_share_within")),
    ), has_score=False, category="Dynamics"),
)
# fmt: on


def write_nuboard(runs: Sequence[StoredRun], folder: Path) -> Path:
    """Write the drives that have a score into an empty folder; the file that nuBoard is to open.

    A planner's faults count 0 and have no metrics. The files name no other
    folder, so they may be moved together. InputError if the folder holds
    something or cannot be written, RunFolderError as from `make_table`.
    """
    table = make_table(runs)
    rows = list(_scored(table))
    if not rows:
        raise InputError(
            f"{', '.join(str(run.path) for run in runs)}: no drive has a score yet, nuBoard would be empty"
        )
    with writing(folder, "give another folder"):
        if folder.exists() and any(folder.iterdir()):
            raise InputError(f"{folder} is not empty; name another folder as --nuboard")
        for part in (METRICS, AGGREGATED):
            (folder / part).mkdir(parents=True, exist_ok=True)
        metrics = _exported(rows)
        for metric in metrics:
            content = _metric_table(metric, rows)
            if content is not None:
                pq.write_table(content, folder / METRICS / f"{metric.name}.parquet")
        name = f"{table.profile}_weighted_average_metrics"
        pq.write_table(_aggregated(metrics, rows), folder / AGGREGATED / f"{name}.parquet")
        file = folder / FILE
        # nuBoard looks beside this file first; the paths only count where nothing lies there.
        file.write_bytes(
            pickled_texts(
                {
                    "simulation_main_path": ".",
                    "metric_main_path": ".",
                    "metric_folder": METRICS,
                    "aggregator_metric_folder": AGGREGATED,
                }
            )
        )
    return file


def pickled_texts(texts: Mapping[str, str]) -> bytes:
    """A mapping of texts in protocol 2 of Python's pickle, byte by byte: nuBoard reads no other format.

    Plain data only: there is nothing in it that could be run, and nothing here reads such a file.
    """
    items = b"".join(_pickled_text(text) for pair in texts.items() for text in pair)
    return b"\x80\x02" + b"}" + b"(" + items + b"u" + b"."


def _pickled_text(text: str) -> bytes:
    data = text.encode("utf-8")
    return b"X" + len(data).to_bytes(4, "little") + data


# --- rows ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Drive:
    """A row under the names that nuBoard shows."""

    planner: str
    family: str
    scenario: str
    log: str
    """The map: nuBoard sorts scenarios by logs."""
    score: float
    metrics: Mapping[str, MetricRecord]

    @classmethod
    def of(cls, row: Row, label: str) -> _Drive:
        seed = f"-seed{row.seed}" if row.seed else ""
        scenario = row.scenario_id.replace("/", "_") + seed
        return cls(label, row.family, scenario, row.site.partition("/")[0] or "-", row.score or 0.0, row.metrics)

    def scored(self, metric: NuBoardMetric) -> float | None:
        """The score of a metric that is there."""
        found = self.metrics.get(metric.source) if metric.has_score else None
        return None if found is None else found.score


def _scored(table: ResultsTable) -> Iterator[_Drive]:
    for line in table.lines:
        yield from (_Drive.of(row, line.label) for row in line.rows if row.score is not None)


def _exported(drives: Sequence[_Drive]) -> tuple[NuBoardMetric, ...]:
    """nuPlan's and interPlan's metrics, then those with a score that plug-ins added, under their own names."""
    known = {metric.source for metric in EXPORTED}
    others = sorted({name for drive in drives for name, found in drive.metrics.items() if found.score is not None})
    return (
        *EXPORTED,
        *(
            NuBoardMetric(name, name, (Statistic(name, "VALUE", "value", _score),))
            for name in others
            if name not in known
        ),
    )


def _metric_table(metric: NuBoardMetric, drives: Sequence[_Drive]) -> pa.Table | None:
    """The drives that were judged by a metric, with those statistics that all of them have; None if there is none."""
    there = [(drive, drive.metrics[metric.source]) for drive in drives if metric.source in drive.metrics]
    if metric.has_score:
        there = [(drive, found) for drive, found in there if found.score is not None]
    values = {each: [each.value(found) for _, found in there] for each in metric.statistics}
    whole = {each: column for each, column in values.items() if None not in column}
    if not there or not whole:
        return None
    columns: dict[str, Any] = {
        "log_name": [drive.log for drive, _ in there],
        "scenario_name": [drive.scenario for drive, _ in there],
        "scenario_type": [drive.family for drive, _ in there],
        "planner_name": [drive.planner for drive, _ in there],
        "metric_computator": [metric.name] * len(there),
        "metric_statistics_name": [metric.name] * len(there),
        "metric_score": pa.array([drive.scored(metric) for drive, _ in there], pa.float64()),
        "metric_score_unit": pa.array(["float" if metric.has_score else None] * len(there), pa.string()),
        "metric_category": [metric.category] * len(there),
    }
    for each, column in whole.items():
        columns[f"{each.name}_stat_type"] = [each.kind] * len(there)
        columns[f"{each.name}_stat_unit"] = [each.unit] * len(there)
        kind = pa.bool_() if each.kind == "BOOLEAN" else pa.float64()
        columns[f"{each.name}_stat_value"] = pa.array([_as_stored(each, value) for value in column], kind)
    columns["time_series_unit"] = pa.nulls(len(there), pa.string())
    columns["time_series_timestamps"] = pa.nulls(len(there), pa.list_(pa.int64()))
    columns["time_series_values"] = pa.nulls(len(there), pa.list_(pa.float64()))
    columns["time_series_selected_frames"] = pa.nulls(len(there), pa.list_(pa.int64()))
    return pa.table(columns)


def _as_stored(statistic: Statistic, value: float | bool | None) -> float | bool | None:
    """A value as its column has it."""
    return value if value is None else bool(value) if statistic.kind == "BOOLEAN" else float(value)


# --- scores ----------------------------------------------------------------------------------------


def _aggregated(exported: Sequence[NuBoardMetric], drives: Sequence[_Drive]) -> pa.Table:
    """Per planner a row for every scenario, one for every type, and the final one, as nuBoard's overview wants them.

    Its table needs the same types from every planner: where one has none, the score is NaN.
    """
    types = sorted({drive.family for drive in drives})
    metrics = sorted((metric for metric in exported if metric.has_score), key=lambda metric: metric.name)
    rows: list[dict[str, Any]] = []
    for planner in dict.fromkeys(drive.planner for drive in drives):
        mine = [drive for drive in drives if drive.planner == planner]
        rows += [_aggregate_row(metrics, [drive], drive.scenario, drive.family, None, drive.log) for drive in mine]
        for family in types:
            part = [drive for drive in mine if drive.family == family]
            others = [drive for drive in drives if drive.family == family]
            rows.append(_aggregate_row(metrics, part, family, family, len(part) or len(others), None, planner))
        rows.append(_aggregate_row(metrics, mine, FINAL, FINAL, len(mine), None))
    names = ["scenario", "log_name", "scenario_type", "num_scenarios", "planner_name", "aggregator_type"]
    types_of = [pa.string(), pa.string(), pa.string(), pa.int64(), pa.string(), pa.string()]
    fields = [*zip(names, types_of, strict=True), *((m.name, pa.float64()) for m in metrics), ("score", pa.float64())]
    return pa.Table.from_pylist(rows, schema=pa.schema(fields))


def _aggregate_row(
    metrics: Sequence[NuBoardMetric], drives: Sequence[_Drive], name: str, family: str, count: int | None,
    log: str | None, planner: str | None = None,
) -> dict[str, Any]:  # fmt: skip
    row: dict[str, Any] = {
        "scenario": name,
        "log_name": log,
        "scenario_type": family,
        "num_scenarios": count,
        "planner_name": planner or drives[0].planner,
        "aggregator_type": "weighted_average",
    }
    row |= {metric.name: _mean(drive.scored(metric) for drive in drives) for metric in metrics}
    return row | {"score": _mean(drive.score for drive in drives)}


def _mean(values: Iterator[float | None]) -> float:
    """Of those that are there, NaN for none."""
    found = [value for value in values if value is not None]
    return float(np.mean(found)) if found else math.nan
